"""Pictures of meshes and sizes, also on machines without a display."""

from adaptsize.plot.pictures import plot_causes, plot_mesh, plot_metric, plot_size

__all__ = ["plot_causes", "plot_mesh", "plot_metric", "plot_size"]
