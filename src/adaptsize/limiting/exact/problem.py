"""The input of the exact method: a mesh with bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from adaptsize.typing import FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh


class Extra(NamedTuple):
    """Sources between the nodes."""

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]"""
    numbers: IntArray
    """int32[k]: numbers that follow those of the nodes."""


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

    @property
    def cells(self) -> IntArray:
        """Simplices on which h0 is linear."""
        return self.mesh.cells if self.linear is None else self.linear
