"""A mesh with given sizes, and with a requested number of elements or nodes."""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from adaptsize._stopwatch import Stopwatch
from adaptsize.adaptation import tuning
from adaptsize.adaptation.boundary_moves import BoundaryMoves
from adaptsize.adaptation.next_sizes import CycleRequest, NextSizes
from adaptsize.adaptation.report import boundary_distance, numbers_of
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.bisection import Resolved
from adaptsize.errors import BackendError, BoundaryWarning, TooManyElementsError
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import remesh
from adaptsize.remeshing.driver import trial
from adaptsize.sizes.search import Search
from adaptsize.typing import ProgressCallback


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
    given = request.options
    options: RemeshOptions = {
        "backend": first.backend,
        "target": "triangles" if mesh.cell_dim < mesh.dim else "auto",
        "tolerance": given["boundary_tolerance"],
        "max_elements": given["max_elements"],
        "how": given["how"],
        "rounds": given["rounds"],
    }
    bare, d, time = _without_data(mesh), mesh.cell_dim, Stopwatch(given["timeout"])
    if isinstance(bare, SimplexMesh):
        bare = bare.with_original(original)

    def make(sizes: NextSizes) -> NewMesh:
        wanted = sizes.requested(mesh)
        # The clocks of ranks differ.
        left = mesh.ranks.allreduce(time.for_next_mesh() or math.inf, "min")
        options["timeout"] = None if math.isinf(left) else left
        if isinstance(bare, PartitionedMesh):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", BoundaryWarning)  # the distance is measured below
                new = remesh(bare, wanted, progress=report, **options)
            return replace(first, mesh=new, sizes=sizes)
        made = trial(bare, wanted, periodic=request.motions, progress=report, **options)
        return replace(first, mesh=made.mesh, sizes=sizes, warn=made.warn_of_sizes)

    sizes = first.sizes
    new = make(sizes)
    goal = goal_of(mesh, new, request)
    accepted = tuning.ACCEPTED_IN_SPACE if d == 3 else None
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
