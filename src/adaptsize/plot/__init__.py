"""Pictures of meshes and their sizes, on machines without a display too."""

from adaptsize.plot.pictures import plot_mesh, plot_size

__all__ = ["plot_mesh", "plot_size"]
