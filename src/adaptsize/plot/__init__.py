"""Pictures of meshes and sizes, also on machines without a display.

Names are imported on first use: matplotlib takes a while.
"""

from adaptsize._lazy import lazily

_HOMES = dict.fromkeys(("plot_causes", "plot_mesh", "plot_metric", "plot_size"), "pictures")

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
