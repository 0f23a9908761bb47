"""A mesh with given sizes, and with a requested number of elements or nodes."""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from adaptsize._defaults import refused_above
from adaptsize._size_function import SizeFunction
from adaptsize._stopwatch import Stopwatch
from adaptsize.adaptation import tuning
from adaptsize.adaptation.boundary_moves import BoundaryMoves
from adaptsize.adaptation.next_sizes import CycleRequest, NextSizes
from adaptsize.adaptation.patch import patched, remade_alone
from adaptsize.adaptation.report import boundary_distance, numbers_of
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.bisection import Resolved
from adaptsize.errors import BackendError, BoundaryWarning, TooManyElementsError
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import remesh
from adaptsize.remeshing.boundary_repair import repaired
from adaptsize.remeshing.driver import Remeshed, trial
from adaptsize.sizes.search import Search
from adaptsize.typing import IntArray, ProgressCallback


@dataclass(frozen=True)
class NewMesh:
    """A new mesh and how it was made; the old mesh if ``n_meshes`` is 0."""

    mesh: AnyMesh
    sizes: NextSizes
    backend: str
    n_meshes: int = 0
    boundary_distance: float = 0.0
    moves: BoundaryMoves | None = None
    divided: Resolved | None = None
    """How the cells of the old mesh were bisected, if they were."""
    is_local: bool = False
    """Whether many cells are those of the old mesh."""
    warn: Callable[[], object] = lambda: None
    """Warns of what the mesh lacks of its sizes."""


def _without_data(mesh: AnyMesh) -> AnyMesh:
    """Return a mesh without the fields that `remesh` would warn of; collective."""
    if isinstance(mesh, SimplexMesh):
        return mesh.without_data()
    own = mesh.mesh
    held = own is not None and bool(own.point_data or own.cell_data)
    if not mesh.ranks.allreduce(int(held), "max"):
        return mesh
    bare = None if own is None else own.without_data()
    return PartitionedMesh(bare, mesh.global_ids, mesh.owner, mesh.ranks, cell_ids=mesh.cell_ids)


def make_mesh(
    mesh: AnyMesh,
    first: NewMesh,
    request: CycleRequest,
    report: ProgressCallback,
    original: SimplexMesh | None = None,
) -> NewMesh:
    """Return a mesh with the sizes of ``first``.

    If it misses the requested number of elements or nodes, others are made, at most three, and the
    one closest to the request is returned.  A generator leaves edges that are nearly as long as
    their sizes: a mesh that gains too little towards a tolerance is made anew for the predicted
    number.  ``original`` is the mesh whose boundary a new one has to keep, by default the present
    one.  Collective.
    """
    d, sizes = mesh.cell_dim, first.sizes
    make = _Maker(mesh, first, request, report, original)
    new = make(sizes)
    goal = goal_of(mesh, new, request)
    accepted = tuning.ACCEPTED_IN_SPACE if d == 3 or new.is_local else None
    search: Search[NewMesh] = Search.by_meshes(goal.number, d, accepted)
    search.add(sizes.predicted, new, goal.of(new))
    while (factor := search.factor) is not None and _is_near(sizes.predicted, goal.cells):
        simplices = first.sizes.simplices * factor**-d
        sizes = request.for_number(mesh, simplices, goal.cells / simplices)
        share = sizes.simplices / first.sizes.simplices
        try:
            new = make(sizes)
        except (TooManyElementsError, BackendError):  # the meshes before are good
            break
        search.add(first.sizes.predicted * share, new, goal.of(new), factor=share ** (-1.0 / d))
    best = search.best.result
    best.warn()
    distance = boundary_distance(mesh, best.mesh)
    if isinstance(mesh, SimplexMesh) and original is not None:
        # Kept within the tolerance of the first boundary, a new one may be farther from the old.
        distance = min(distance, boundary_distance(original, best.mesh))
    return replace(best, n_meshes=len(search.trials), boundary_distance=distance)


class _Maker:
    """Makes meshes of an old one, within one limit of time; collective."""

    def __init__(
        self,
        mesh: AnyMesh,
        first: NewMesh,
        request: CycleRequest,
        report: ProgressCallback,
        original: SimplexMesh | None,
    ) -> None:
        given = request.options
        self.mesh, self.first, self.report, self.motions = mesh, first, report, request.motions
        self.options: RemeshOptions = {
            "backend": first.backend,
            "target": "triangles" if mesh.cell_dim < mesh.dim else "auto",
            "tolerance": given["boundary_tolerance"],
            "max_elements": given["max_elements"],
            "how": given["how"],
            "rounds": given["rounds"],
        }
        self.is_local = given["local"]
        self.time = Stopwatch(given["timeout"])
        bare = _without_data(mesh)
        self.bare = bare.with_original(original) if isinstance(bare, SimplexMesh) else bare

    def __call__(self, sizes: NextSizes) -> NewMesh:
        """Return a mesh with sizes."""
        bare, wanted = self.bare, sizes.requested(self.mesh)
        # The clocks of ranks differ.
        left = self.mesh.ranks.allreduce(self.time.for_next_mesh() or math.inf, "min")
        self.options["timeout"] = None if math.isinf(left) else left
        if isinstance(bare, PartitionedMesh):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", BoundaryWarning)  # it is measured by `make_mesh`
                new = remesh(bare, wanted, progress=self.report, **self.options)
            return replace(self.first, mesh=new, sizes=sizes)
        if self.is_local:
            made = self._around_misses(bare, sizes)
            if made is not None:
                return made
        whole = trial(bare, wanted, periodic=self.motions, progress=self.report, **self.options)
        return replace(self.first, mesh=whole.mesh, sizes=sizes, warn=whole.warn_of_sizes)

    def _around_misses(self, mesh: SimplexMesh, sizes: NextSizes) -> NewMesh | None:
        """Return a mesh in which the cells that have their sizes stay; None if they are too few.

        Neither is there one if it has to be refused, or if the generator fails in the patch.
        """
        gone = remade_alone(mesh, sizes.at_nodes)
        if gone is None or sizes.predicted > refused_above(self.options["max_elements"]):
            return None
        wanted, found = sizes.requested(self.mesh), list[Remeshed]()

        def remade(part: SimplexMesh, cut: IntArray) -> SimplexMesh:
            own: RemeshOptions = {**self.options, "max_elements": math.inf}
            own["tolerance"] = min(1.0, own["tolerance"] * mesh.diagonal / part.diagonal)
            found.append(trial(part, wanted, cut, progress=self.report, **own))
            return found[0].mesh

        try:
            made = patched(mesh, gone, remade)
        except BackendError:
            return None
        if made is None:
            return None
        if isinstance(wanted, SizeFunction):
            made = repaired(made, mesh, self.options["tolerance"] * mesh.diagonal, wanted)
        warn = partial(found[0].warn_of_sizes, made)
        return replace(self.first, mesh=made, sizes=sizes, is_local=True, warn=warn)


class Goal(NamedTuple):
    """The number of cells or nodes that a mesh should have."""

    number: float
    cells: float
    """The number of cells to be predicted for it."""
    by_nodes: bool = False

    def of(self, made: NewMesh) -> int:
        """Return the number that a mesh has."""
        n_points, n_cells = numbers_of(made.mesh)
        return n_points if self.by_nodes else n_cells


def goal_of(mesh: AnyMesh, new: NewMesh, request: CycleRequest) -> Goal:
    """Return the number that is wanted: that of the first new mesh if it can stay as it is."""
    predicted = new.sizes.predicted
    elements, nodes = request.options["elements"], request.options["nodes"]
    if elements is not None and _is_near(predicted, elements):
        return Goal(elements, elements) if nodes is None else Goal(nodes, elements, by_nodes=True)
    # Otherwise limits do not allow the number, or the tolerance needs fewer elements.
    before, after = numbers_of(mesh)[1], numbers_of(new.mesh)[1]
    gains_little = after - before < tuning.GAINED * (predicted - before)
    return Goal(predicted if request.is_missed and gains_little else after, predicted)


def _is_near(predicted: float, elements: float) -> bool:
    return abs(predicted / elements - 1.0) <= tuning.REACHED
