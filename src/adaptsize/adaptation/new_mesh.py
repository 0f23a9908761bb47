"""A mesh with given sizes, and with a requested number of elements or nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adaptsize.adaptation.boundary_moves import BoundaryMoves, ProjectionLike, move_to_boundary
from adaptsize.adaptation.next_sizes import NextSizes, Request
from adaptsize.adaptation.report import BUDGET_TOLERANCE, boundary_distance
from adaptsize.background import SimplexMesh
from adaptsize.remeshing import remesh

#: Maximum number of meshes that are made to meet a number of elements.
_MOST_MESHES = 3


@dataclass(frozen=True)
class NewMesh:
    """A new mesh and how it was made; the old mesh if ``n_meshes`` is 0."""

    mesh: SimplexMesh
    n_meshes: int = 0
    boundary_distance: float = 0.0
    moves: BoundaryMoves | None = None

    def projected(self, project: ProjectionLike, corner_angle: float) -> NewMesh:
        """Return the mesh with its boundary nodes on the true boundary."""
        mesh, moves = move_to_boundary(self.mesh, project, corner_angle)
        return replace(self, mesh=mesh, moves=moves)


def make_mesh(
    mesh: SimplexMesh, sizes: NextSizes, request: Request, options: dict[str, Any]
) -> tuple[NextSizes, NewMesh]:
    """Return a mesh with the sizes; repeat if it misses the requested number."""
    new = remesh(mesh, sizes.requested(mesh), **options)
    best, n_meshes = (sizes, new), 1
    elements, nodes = request.target_elements, request.target_nodes
    target = elements if nodes is None else nodes
    requested: list[float] = []
    actual: list[float] = []
    while (
        target is not None and elements is not None and sizes.in_reach and n_meshes < _MOST_MESHES
    ):
        requested.append(math.log(sizes.simplices))
        actual.append(math.log(_count(new, nodes)))
        if abs(math.expm1(actual[-1] - math.log(target))) <= BUDGET_TOLERANCE:
            break
        number = math.exp(_next_request(requested, actual, math.log(target)))
        sizes = request.next(mesh, elements / number)
        new = remesh(mesh, sizes.requested(mesh), **options)
        n_meshes += 1
        if _miss(new, nodes, target) < _miss(best[1], nodes, target):
            best = (sizes, new)
    sizes, new = best
    return sizes, NewMesh(new, n_meshes, boundary_distance(mesh, new))


def _count(mesh: SimplexMesh, nodes: float | None) -> int:
    """Return the number of nodes if that is requested, else of cells."""
    return mesh.n_cells if nodes is None else mesh.n_points


def _miss(mesh: SimplexMesh, nodes: float | None, target: float) -> float:
    return abs(math.log(_count(mesh, nodes) / target))


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
