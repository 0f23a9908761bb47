"""The interface between ``remesh`` and the adapters to mesh generators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:  # the child processes do not need the mesh classes
    from adaptsize.background import SimplexMesh
    from adaptsize.remeshing.sizing import MetricAt

#: The task: fill a surface with tetrahedra, or remesh with the same kind of cells.
Task: TypeAlias = Literal["surface to tetrahedra", "tetrahedra", "plane triangles", "surface"]
Arrays: TypeAlias = Mapping[str, npt.NDArray[Any]]


class Runner(Protocol):
    """Runs a function of arrays in a child process; see ``isolation.IsolatedRunner``."""

    def __call__(
        self, function: str, text: str, arrays: Arrays, options: Mapping[str, Any]
    ) -> dict[str, npt.NDArray[Any]]:
        """Run ``function`` ("module:name") and return its arrays.  Report ``text`` meanwhile."""
        ...


@dataclass(frozen=True)
class Problem:
    """One request to a generator, after checks and repairs.

    Attributes
    ----------
    task : str
    mesh : SimplexMesh
        Every node is used; cells of full dimension have positive measure.
    size : callable or None
        Requested edge length at float64[n, dim] points, as float64[n], finite and positive.
        None selects the generator's default (for a first mesh that carries the sizes).
    metric : callable or None
        Requested `Metric` at float64[n, dim] points, with finite sizes.  None if the sizes do not
        depend on the direction.  With a metric, ``size`` is the geometric mean of its sizes.
    size_nodes : float64[n, dim]
        Points between which the size function interpolates.  May be empty.
    tolerance : float
        Allowed distance of the new boundary from the old one, in the unit of the coordinates.
    facet_nodes : int32[n, cell_dim]
        All facets to preserve: boundary, interfaces, tagged, required.
    facet_groups : int32[n]
        Their groups, 0, 1, ...; facets of different groups stay separate.
    required : bool[n]
        Which of these facets must not change.
    regions : int32[n_cells]
        Region of each cell, 0, 1, ...
    has_free_facets : bool
        Whether some of these facets lie inside one region.
    ridges : int32[n, 2]
        Edges of the boundary that must stay sharp, beside those that the generator detects.
    is_adapted : bool
        Whether the boundary of the mesh has the requested edge lengths already.
    seconds : float
        Limit of processor time for one run of the generator, where there is one.
    """

    task: Task
    mesh: SimplexMesh
    size: Callable[[FloatArray], FloatArray] | None
    size_nodes: FloatArray
    tolerance: float
    facet_nodes: IntArray
    facet_groups: IntArray
    required: npt.NDArray[np.bool_]
    regions: IntArray
    has_free_facets: bool = False
    ridges: IntArray = field(default_factory=lambda: np.empty((0, 2), np.int32))
    metric: MetricAt | None = None
    is_adapted: bool = False
    seconds: float = np.inf


@dataclass(frozen=True)
class RawMesh:
    """The result of an adapter: arrays that are not checked yet.

    Attributes
    ----------
    points : float64[n_points, dim]
    cells : int32[n_cells, k + 1]
    regions : int32[n_cells] or None
        As in ``Problem``.  None if the generator does not preserve them.
    facets, facet_groups : int32[n, k], int32[n], or None
        The same for facets.
    """

    points: FloatArray
    cells: IntArray
    regions: IntArray | None = None
    facets: IntArray | None = None
    facet_groups: IntArray | None = None


class Backend(Protocol):
    """An adapter to one mesh generator.

    It disables the generator's gradation and its own sizes, and passes the sizes in the
    form that the generator follows.  It calls the generator only through ``run``, in child
    processes, so the generator cannot affect the caller.

    An adapter that uses ``Problem.metric`` has the attribute ``follows_metrics``, which is True.
    """

    @property
    def name(self) -> str:
        """Name for ``remesh(backend=...)``."""
        ...

    @property
    def package(self) -> str:
        """Name of the Python package that must be importable."""
        ...

    @property
    def install(self) -> str:
        """The command line that installs the generator."""
        ...

    @property
    def tasks(self) -> frozenset[Task]:
        """Supported tasks."""
        ...

    @property
    def keeps_required_facets(self) -> bool:
        """Whether it can keep given facets unchanged."""
        ...

    @property
    def needs_volume(self) -> bool:
        """Whether it fills a surface only with a first volume mesh from another generator."""
        ...

    def solve(self, problem: Problem, run: Runner) -> RawMesh:
        """Return the new mesh."""
        ...
