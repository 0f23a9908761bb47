"""The input of the exact method: a mesh with bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from adaptsize.typing import FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh


# Share of the largest size by which a source must be better to make another one unnecessary.
_MARGIN = 1e-9


class Extra(NamedTuple):
    """Sources between the nodes."""

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]"""
    numbers: IntArray
    """int32[k]: numbers that follow those of the nodes."""


class Kinks(NamedTuple):
    """Edges and faces at which bounds have a kink, once for each of their cells."""

    edges: IntArray
    """int32[r, 5], as from `kinks.list_edges`."""
    faces: IntArray
    """int32[s, 5], as from `kinks.list_faces`."""
    points: FloatArray
    """float64[n, dim]: the nodes of all these cells."""
    h0: FloatArray


#: Returns the rows of other processes, too, with their nodes added at the end.
MergeRows: TypeAlias = Callable[[Kinks], Kinks]


class Problem(NamedTuple):
    """A mesh with bounds."""

    mesh: SimplexMesh
    h0: FloatArray
    g: float
    face_sources: bool
    threads: int
    report: ProgressCallback
    extra: Extra | None = None
    linear: IntArray | None = None
    """int32[m, dim + 1]: simplices on which h0 is linear, if not the cells."""

    order: IntArray | None = None
    """int32[n_points]: the nodes along a Morton curve, if known."""
    meet: bool | None = None
    """Whether two nodes of any simplex have bounds, if known."""
    margin: float = 0.0
    """Source i makes source j unnecessary if it allows less than the bound of j by more than this.

    This is well above rounding, and above the tolerances of lines of sight.  Hence no size depends
    on which sources are found to be unnecessary, bit for bit, and neither does it depend on
    whether all other sources are known, as they are not on one of many processes.
    """
    merge: MergeRows | None = None
    """Adds what other processes know about edges and faces; None on a single one."""

    @property
    def cells(self) -> IntArray:
        """Simplices on which h0 is linear."""
        return self.mesh.cells if self.linear is None else self.linear

    def with_margin(self) -> Problem:
        """Return the problem with the margin for a domain with these nodes and bounds."""
        least = float(self.h0.min())
        if self.extra is not None:
            least = min(least, float(self.extra.sizes.min(initial=np.inf)))
        return self._replace(margin=margin_for(least, self.g, self.mesh.diagonal))


def margin_for(least: float, g: float, diagonal: float) -> float:
    """Return the margin of a problem with a least bound in a domain of a given diagonal."""
    return _MARGIN * (least + g * diagonal)
