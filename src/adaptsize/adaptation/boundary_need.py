"""The number of elements that curved boundaries need to stay within the tolerance."""

from __future__ import annotations

import numpy as np

from adaptsize._checks import count_text
from adaptsize._messages import Message
from adaptsize.adaptation import tuning
from adaptsize.adaptation.next_sizes import CycleRequest, NextSizes
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.splitting import bisect_edges
from adaptsize.background.topology import rows_among
from adaptsize.errors import TooManyElementsError
from adaptsize.sizes.curvature import curves_of
from adaptsize.sizes.search import smallest_tolerance


def refuse_too_few(
    mesh: AnyMesh, sizes: NextSizes, request: CycleRequest, original: SimplexMesh | None
) -> None:
    """Raise if the boundary within the tolerance needs more elements than requested; collective.

    The answer is that of the first mesh of a loop, if it is known, so that it is the same in all
    cycles.  Limits that depend on the present mesh, like ``max_coarsen``, are no reason to refuse,
    nor is ``hmax``.  Where the gradient limit differs from node to node, the number
    is not known on other meshes.

    Parameters
    ----------
    sizes : NextSizes
        Those for the requested number.
    original : SimplexMesh or None
        The first mesh of the loop, or its boundary for a mesh in parts.

    Raises
    ------
    TooManyElementsError
        With the number needed, and the smallest tolerance for which the requested one is enough.
    """
    target, g = request.options["elements"], request.options["g"]
    is_graded = g is None or isinstance(g, str | int | float)
    if mesh.dim < 3 or target is None or not is_graded:
        return
    if sizes.predicted <= (1.0 + tuning.BUDGET) * target:
        return
    in_parts = isinstance(mesh, PartitionedMesh)
    whole = mesh.gather() if isinstance(mesh, PartitionedMesh) else original or mesh
    per_simplex = sizes.predicted / sizes.simplices

    def check() -> None:
        if whole is not None:
            _check(whole, request, target, per_simplex, original if in_parts else None)

    mesh.ranks.agree(check)


def _check(
    mesh: SimplexMesh,
    request: CycleRequest,
    target: float,
    per_simplex: float,
    original: SimplexMesh | None,
) -> None:
    """Raise if the boundary of a mesh needs more elements than requested."""
    options = request.options
    nodes, tolerance = options["nodes"], options["boundary_tolerance"]
    first, alone = original or mesh, request.for_boundary()
    fine = _without_bridges(mesh, alone.within(mesh, tolerance, first))

    def load_of(allowed: float) -> float:
        return per_simplex * alone.within(fine, allowed, first).simplices(fine) / target

    load, before = load_of(tolerance), np.inf
    while load < (1.0 - tuning.SETTLED) * before and fine.n_cells < tuning.MOST_CELLS:
        if load <= 1.0 + tuning.BUDGET:
            return
        fine = _halved(fine)
        load, before = load_of(tolerance), load
    if load <= 1.0 + tuning.BUDGET:
        return
    what, number = ("elements", target) if nodes is None else ("nodes", nodes)
    text = Message(
        "within {boundary_tolerance} = {:g} the curved boundary needs about {} {}; {} are not "
        "enough",
        *(tolerance, count_text(load * number), what, count_text(number)),
    )
    offer, enough = smallest_tolerance(tolerance, load, load_of), {}
    if offer is not None:
        text = Message("{}: {}", text, Message.name("boundary_tolerance", f"{offer:g}"))
        enough["boundary_tolerance"] = offer
    raise TooManyElementsError(text, load * target, enough)


def _halved(mesh: SimplexMesh) -> SimplexMesh:
    """Return a mesh with at least twice as many cells."""
    n_cells = mesh.n_cells
    while mesh.n_cells < 2 * n_cells:
        mesh = bisect_edges(mesh, mesh.edges).mesh
    return mesh


def _without_bridges(mesh: SimplexMesh, request: CycleRequest) -> SimplexMesh:
    """Return a mesh with nodes on all edges inside that connect curved boundaries.

    Sizes along such an edge do not grow away from the boundary.  The number that coarse meshes
    without nodes inside show is twice that of fine ones.
    """
    bounded = request.at_curves(mesh)
    while mesh.cell_dim == mesh.dim and mesh.n_cells < tuning.MOST_CELLS:
        inside = bounded[mesh.edges[:, 0]] & bounded[mesh.edges[:, 1]]
        for curve in curves_of(mesh):
            if curve is not None:
                facets, nodes = curve
                own = rows_among(np.sort(nodes[facets.edges], axis=1), mesh.edges)
                inside[own[own >= 0]] = False
        if not inside.any():
            break
        mesh = bisect_edges(mesh, mesh.edges[inside]).mesh
        bounded = np.append(bounded, np.zeros(mesh.n_points - len(bounded), np.bool_))
    return mesh
