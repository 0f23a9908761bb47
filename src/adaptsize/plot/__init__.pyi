"""The names of `adaptsize.plot` for type checkers; tests/test_types.py writes this file."""

from adaptsize.plot.pictures import plot_causes as plot_causes
from adaptsize.plot.pictures import plot_mesh as plot_mesh
from adaptsize.plot.pictures import plot_metric as plot_metric
from adaptsize.plot.pictures import plot_size as plot_size

__all__ = [
    "plot_causes",
    "plot_mesh",
    "plot_metric",
    "plot_size",
]
