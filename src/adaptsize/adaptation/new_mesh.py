"""A mesh with given sizes, and with a requested number of elements or nodes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from adaptsize.adaptation.boundary_moves import BoundaryMoves, ProjectionLike, move_to_boundary
from adaptsize.adaptation.next_sizes import NextSizes, Request
from adaptsize.adaptation.report import BUDGET_TOLERANCE, boundary_distance
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.errors import BoundaryWarning
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import remesh
from adaptsize.typing import ProgressCallback

M = TypeVar("M", SimplexMesh, PartitionedMesh)

#: A mesh within this share of the requested number is accepted, by dimension of the cells.  Within
#: 5 %, 54 loops of triangles took 62 meshes in place of 54, and 12 of tetrahedra 22 in place of 13.
_ACCEPTED = {2: 0.05, 3: BUDGET_TOLERANCE}


@dataclass(frozen=True)
class NewMesh:
    """A new mesh and how it was made; the old mesh if ``n_meshes`` is 0."""

    mesh: SimplexMesh
    sizes: NextSizes
    backend: str
    n_meshes: int = 0
    boundary_distance: float = 0.0
    moves: BoundaryMoves | None = None

    def projected(self, project: ProjectionLike, corner_angle: float) -> NewMesh:
        """Return the mesh with its boundary nodes on the true boundary."""
        mesh, moves = move_to_boundary(self.mesh, project, corner_angle)
        return replace(self, mesh=mesh, moves=moves)


def make_mesh(
    mesh: SimplexMesh, first: NewMesh, request: Request, report: ProgressCallback
) -> NewMesh:
    """Return a mesh with the sizes of ``first``; repeat if it misses the requested number."""
    given = request.options
    options: RemeshOptions = {
        "backend": first.backend,
        "target": "triangles" if mesh.cell_dim < mesh.dim else "auto",
        "tolerance": given["boundary_tolerance"],
        "max_elements": given["max_elements"],
        "timeout": given["timeout"],
    }

    def make(chosen: NextSizes) -> SimplexMesh:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BoundaryWarning)  # the caller measures the distance
            new: SimplexMesh = remesh(mesh, chosen.requested(mesh), progress=report, **options)
        return new

    def count(new: SimplexMesh) -> int:
        return new.n_cells if request.options["nodes"] is None else new.n_points

    def again(factor: float) -> NextSizes:
        return request.next(mesh, factor)

    best = meet_target(request, first.sizes, make, count, again)
    distance = boundary_distance(mesh, best.mesh)
    return NewMesh(best.mesh, best.sizes, first.backend, best.n_meshes, distance)


@dataclass(frozen=True)
class BestMesh(Generic[M]):
    """The mesh whose number of elements or nodes is closest to the request, and its sizes."""

    sizes: NextSizes
    mesh: M
    n_meshes: int
    """Number of meshes made."""


def meet_target(
    request: Request,
    sizes: NextSizes,
    make: Callable[[NextSizes], M],
    count: Callable[[M], int],
    again: Callable[[float], NextSizes],
) -> BestMesh[M]:
    """Make meshes, at most three, until the number of elements or nodes is the requested one.

    Parameters
    ----------
    request : Request
    sizes : NextSizes
        Those of the first mesh.
    make, count : callable
        Return a mesh with sizes, and the number of its nodes, if that is requested, or cells.
    again : callable
        Return sizes, given how many cells the generator makes per predicted cell.
    """
    elements, nodes = request.options["elements"], request.options["nodes"]
    target = elements if nodes is None else nodes
    new = make(sizes)
    best, n_meshes = (sizes, new), 1
    requested: list[float] = []
    actual: list[float] = []
    while target is not None and elements is not None and sizes.in_reach and n_meshes < 3:
        requested.append(math.log(sizes.simplices))
        actual.append(math.log(count(new)))
        if abs(math.expm1(actual[-1] - math.log(target))) <= _ACCEPTED[new.cell_dim]:
            break
        sizes = again(elements / math.exp(_next_request(requested, actual, math.log(target))))
        new = make(sizes)
        n_meshes += 1
        if abs(math.log(count(new) / target)) < abs(math.log(count(best[1]) / target)):
            best = (sizes, new)
    return BestMesh(*best, n_meshes)


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
