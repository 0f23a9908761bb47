"""A mesh with given sizes, and with a requested number of elements or nodes."""

import warnings
from dataclasses import dataclass, replace

from adaptsize.adaptation import tuning
from adaptsize.adaptation.boundary_moves import BoundaryMoves
from adaptsize.adaptation.next_sizes import CycleRequest, NextSizes
from adaptsize.adaptation.report import boundary_distance, numbers_of
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.errors import BoundaryWarning
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import remesh
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
    mesh: AnyMesh, first: NewMesh, request: CycleRequest, report: ProgressCallback
) -> NewMesh:
    """Return a mesh with the sizes of ``first``.

    If it misses the requested number of elements or nodes, others are made, at most three, and the
    one closest to the request is returned.  Collective.
    """
    given = request.options
    options: RemeshOptions = {
        "backend": first.backend,
        "target": "triangles" if mesh.cell_dim < mesh.dim else "auto",
        "tolerance": given["boundary_tolerance"],
        "max_elements": given["max_elements"],
        "timeout": given["timeout"],
        "how": given["how"],
        "rounds": given["rounds"],
    }
    elements, nodes = given["elements"], given["nodes"]
    bare = _without_data(mesh)
    target = elements if nodes is None else nodes

    def make(sizes: NextSizes) -> tuple[NewMesh, int]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BoundaryWarning)  # the caller measures the distance
            new = remesh(bare, sizes.requested(mesh), progress=report, **options)
        n_points, n_cells = numbers_of(new)
        return replace(first, mesh=new, sizes=sizes), n_cells if nodes is None else n_points

    sizes, d = first.sizes, mesh.cell_dim
    new, count = make(sizes)
    accepted = tuning.ACCEPTED_IN_SPACE if d == 3 else None
    search: Search[NewMesh] = Search.by_meshes(target or count, d, accepted)
    search.add(sizes.predicted, new, count)
    while elements is not None and (factor := search.factor) is not None:
        if abs(sizes.predicted / elements - 1.0) > tuning.REACHED:
            break
        simplices = first.sizes.simplices * factor**-d
        sizes = request.next(mesh, elements / simplices)
        new, count = make(sizes)
        share = sizes.simplices / first.sizes.simplices
        search.add(first.sizes.predicted * share, new, count, factor=share ** (-1.0 / d))
    best = search.best.result
    distance = boundary_distance(mesh, best.mesh)
    return replace(best, n_meshes=len(search.trials), boundary_distance=distance)
