"""Pictures of meshes and sizes, also on machines without a display.

Names are imported on first use: matplotlib takes a while.
"""

from typing import TYPE_CHECKING

from adaptsize._lazy import lazily

if TYPE_CHECKING:
    from adaptsize.plot.pictures import plot_causes, plot_mesh, plot_metric, plot_size

__all__ = ["plot_causes", "plot_mesh", "plot_metric", "plot_size"]

__getattr__, __dir__ = lazily(__name__, dict.fromkeys(__all__, "pictures"))
