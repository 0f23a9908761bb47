"""Pictures of meshes and their sizes, on machines without a display too."""

from adaptsize.plot.pictures import plot_causes, plot_mesh, plot_size

__all__ = ["plot_causes", "plot_mesh", "plot_size"]
