"""A mesh with given sizes, and with a requested number of elements or nodes."""

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from adaptsize.adaptation.boundary_moves import BoundaryMoves
from adaptsize.adaptation.next_sizes import NextSizes, Request
from adaptsize.adaptation.report import BUDGET_TOLERANCE, boundary_distance, numbers_of
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.errors import BoundaryWarning
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import remesh
from adaptsize.typing import ProgressCallback

#: A mesh within this share of the requested number is accepted, by dimension of the cells.  Within
#: 5 %, 54 loops of triangles took 62 meshes in place of 54, and 12 of tetrahedra 22 in place of 13.
_ACCEPTED = {2: 0.05, 3: BUDGET_TOLERANCE}

#: The limits allow a requested number if the prediction is this close to it.
_REACHED = 0.05


@dataclass(frozen=True)
class NewMesh:
    """A new mesh and how it was made; the old mesh if ``n_meshes`` is 0."""

    mesh: AnyMesh
    sizes: NextSizes
    backend: str
    n_meshes: int = 0
    boundary_distance: float = 0.0
    moves: BoundaryMoves | None = None


def make_mesh(mesh: AnyMesh, first: NewMesh, request: Request, report: ProgressCallback) -> NewMesh:
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
    target = elements if nodes is None else nodes

    def make(sizes: NextSizes) -> tuple[NewMesh, int]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BoundaryWarning)  # the caller measures the distance
            bare = mesh.without_data() if isinstance(mesh, SimplexMesh) else mesh
            new = remesh(bare, sizes.requested(mesh), progress=report, **options)
        n_points, n_cells = numbers_of(new)
        return replace(first, mesh=new, sizes=sizes), n_cells if nodes is None else n_points

    sizes = first.sizes
    new, count = make(sizes)
    best, best_count, n_meshes = new, count, 1
    requested: list[float] = []
    actual: list[float] = []
    while target is not None and elements is not None and n_meshes < 3:
        if abs(sizes.predicted / elements - 1.0) > _REACHED:
            break
        requested.append(math.log(sizes.simplices))
        actual.append(math.log(count))
        if abs(math.expm1(actual[-1] - math.log(target))) <= _ACCEPTED[mesh.cell_dim]:
            break
        factor = elements / math.exp(_next_request(requested, actual, math.log(target)))
        sizes = request.next(mesh, factor)
        new, count = make(sizes)
        n_meshes += 1
        if abs(math.log(count / target)) < abs(math.log(best_count / target)):
            best, best_count = new, count
    distance = boundary_distance(mesh, best.mesh)
    return replace(best, n_meshes=n_meshes, boundary_distance=distance)


def _next_request(requested: list[float], actual: list[float], target: float) -> float:
    """Return the number to request next; all numbers are logarithms."""
    order = np.argsort(actual)
    below = [i for i in order if actual[i] < target]
    above = [i for i in order if actual[i] >= target]
    if below and above and requested[below[-1]] < requested[above[0]]:
        i, j = below[-1], above[0]
        return float(np.interp(target, [actual[i], actual[j]], [requested[i], requested[j]]))
    nearest = int(np.argmin(np.abs(np.subtract(actual, target))))
    return requested[nearest] + target - actual[nearest]
