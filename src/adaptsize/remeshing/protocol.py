"""What a mesh generator is asked for, and what an adapter to one must offer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:  # the adapters' child processes do without the mesh classes
    from adaptsize.background import SimplexMesh

#: What is made of what: a volume from its surface, or the same kind of mesh anew.
Task: TypeAlias = Literal["surface to tetrahedra", "tetrahedra", "plane triangles", "surface"]
Arrays: TypeAlias = Mapping[str, npt.NDArray[Any]]


class Runner(Protocol):
    """Runs a function of arrays in a child process; see ``isolation.IsolatedRunner``."""

    def __call__(
        self, function: str, text: str, arrays: Arrays, options: Mapping[str, Any]
    ) -> dict[str, npt.NDArray[Any]]:
        """Run ``function`` ("module:name"), report ``text`` meanwhile, return its arrays."""
        ...


@dataclass(frozen=True)
class Problem:
    """One request to a generator, checked and mended.

    Attributes
    ----------
    task : str
    mesh : SimplexMesh
        Every node is used; cells of full dimension have positive measure.
    size : callable or None
        Wanted edge length at float64[n, dim] points, as float64[n], finite and positive.
        None: whatever edge length suits the generator (a first mesh to put sizes on).
    size_nodes : float64[n, dim]
        Where the size was given as a number; between them it is interpolated.  May be empty.
    tolerance : float
        How far the new boundary may be from the old one, in the unit of the coordinates.
    facet_nodes : int32[n, cell_dim]
        All facets that matter: boundary, between regions, tagged, required.
    facet_groups : int32[n]
        Their groups, 0, 1, ...; facets of different groups stay apart.
    required : bool[n]
        Which of these facets must stay as they are.
    regions : int32[n_cells]
        Region of each cell, 0, 1, ....
    has_free_facets : bool
        Whether some of these facets lie inside one region.
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


@dataclass(frozen=True)
class RawMesh:
    """What an adapter returns: arrays that nobody has checked yet.

    Attributes
    ----------
    points : float64[n_points, dim]
    cells : int32[n_cells, k + 1]
    regions : int32[n_cells] or None
        As in ``Problem``; None if the generator does not know them.
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

    Its generator is switched to no gradation and no sizes of its own, and gets
    the sizes in the form it obeys.  It works through ``run`` only, in child
    processes, so nothing a generator does reaches the caller.
    """

    @property
    def name(self) -> str:
        """What ``remesh(backend=...)`` calls it."""
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
        """What it can do."""
        ...

    @property
    def keeps_required_facets(self) -> bool:
        """Whether it can leave given facets exactly as they are."""
        ...

    @property
    def needs_volume(self) -> bool:
        """Whether it makes a volume of a surface only from a first volume mesh of another."""
        ...

    def solve(self, problem: Problem, run: Runner) -> RawMesh:
        """Return the new mesh."""
        ...
