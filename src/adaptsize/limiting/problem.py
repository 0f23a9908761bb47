"""What a scheme solves, what it returns, and what all schemes have in common."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_sizes
from adaptsize._progress import silent
from adaptsize.background import AnyMesh, CartesianGrid, PartitionedMesh, SimplexMesh
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.periodic import Periodicity
from adaptsize.options.records import check_fields
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback


class PointBounds(NamedTuple):
    """Bounds at points that need not be nodes, transformed like ``h0``."""

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]"""


@dataclass(frozen=True)
class Problem:
    """Checked arguments; sizes are transformed where g depends on them (see `SizeTransform`)."""

    domain: AnyMesh | CartesianGrid
    h0: FloatArray
    """float64, of the nodal shape; inf where there is no bound, and at inactive nodes."""
    slope: Slope
    initial: FloatArray | None = None
    """Start of an iteration, at most ``h0``."""
    point_sources: PointBounds | None = None
    periodic: Periodicity | None = None
    report: ProgressCallback = silent
    at_any_price: bool = True
    """Whether the exact method solves domains in which it is slow, instead of raising
    `TooManyCorners`."""

    @property
    def grid(self) -> CartesianGrid:
        """The domain, for schemes that have been asked whether they support it."""
        if not isinstance(self.domain, CartesianGrid):
            raise TypeError(f"a grid is needed, got {self.domain!r}")
        return self.domain

    @property
    def any_mesh(self) -> AnyMesh:
        """The domain, as above."""
        if isinstance(self.domain, CartesianGrid):
            raise TypeError(f"a mesh is needed, got {self.domain!r}")
        return self.domain

    @property
    def part(self) -> PartitionedMesh:
        """The domain, as above."""
        if not isinstance(self.domain, PartitionedMesh):
            raise TypeError(f"a mesh in parts is needed, got {self.domain!r}")
        return self.domain

    @property
    def mesh(self) -> SimplexMesh:
        """The domain, as above."""
        if not isinstance(self.domain, SimplexMesh):
            raise TypeError(f"a whole mesh is needed, got {self.domain!r}")
        return self.domain


class TooManyCorners(Exception):
    """The exact method would be much slower than fast marching."""


class NeedsWholeMesh(Exception):
    """A scheme does not solve this problem on a mesh in parts; raised on all ranks."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one scheme; its arrays are not modified afterwards."""

    h: FloatArray
    iterations: int
    missed_by: float | Callable[[], float] = 0.0
    """The residual, or a function that computes it."""
    unfinished: str = ""
    """Message for the user if the scheme stopped before convergence; empty if it converged."""

    @property
    def residual(self) -> float:
        """Residual of the discrete equations of the scheme; collective on meshes in parts."""
        return self.missed_by() if callable(self.missed_by) else self.missed_by


def as_nodal_sizes(
    name: str, sizes: npt.ArrayLike, shape: tuple[int, ...], active: BoolArray | None
) -> FloatArray:
    """Return checked nodal sizes, inf at inactive nodes; one number is used for all nodes."""
    given = as_float_array(name, sizes)
    if given.ndim == 0:
        given = np.full(shape, as_sizes(name, given, ()))
    if active is not None:
        given = np.where(active, as_float_array(name, given, shape), np.inf)
    return as_sizes(name, given, shape)


class Scheme:
    """A numerical scheme for gradient limiting; an instance holds its options."""

    name: ClassVar[str]
    optional: ClassVar[frozenset[str]] = frozenset()
    """Those of ``initial``, ``point_sources`` and ``periodic`` that the scheme supports."""

    def supports(self, domain: AnyMesh | CartesianGrid) -> str:
        """Return an empty string, or which backgrounds the scheme needs instead of this one."""
        return ""

    def solve(self, problem: Problem) -> Solution:
        """Solve a problem; collective on meshes in parts."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        """Check the options: fields that are annotated with an `Option`."""
        check_fields(self)


def checked_start(initial: FloatArray | None, marched: FloatArray) -> FloatArray:
    """Return the start of an iteration, by default the fast marching solution, inf where it is.

    Raises
    ------
    ValueError
        If it is inf at a node that a bound reaches.
    """
    if initial is None:
        return marched
    if np.isinf(initial[np.isfinite(marched)]).any():
        raise ValueError("initial must be finite in every component with a finite h0")
    return np.where(np.isinf(marched), np.inf, initial)
