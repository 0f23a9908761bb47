"""The number of elements that curved boundaries need to stay within the tolerance."""

from __future__ import annotations

from functools import cache

import numpy as np

from adaptsize._checks import count_text
from adaptsize.adaptation.need import count_simplices
from adaptsize.adaptation.next_sizes import NextSizes, Request
from adaptsize.adaptation.report import BUDGET_TOLERANCE
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.splitting import bisect_edges
from adaptsize.errors import TooManyElementsError
from adaptsize.sizes.search import smallest_tolerance

#: A mesh is refined until the number on it falls by less, and at most to so many cells.  Between
#: the nodes of coarse meshes, sizes do not grow away from the boundary.
_SETTLED, _MOST_CELLS = 0.05, 100_000
#: Bisections after which there are about eight times as many tetrahedra.
_BISECTIONS = 3


def refuse_too_few(
    mesh: AnyMesh, sizes: NextSizes, request: Request, original: SimplexMesh | None
) -> None:
    """Raise if the boundary within the tolerance needs more elements than requested; collective.

    The answer is that of the first mesh of a loop, if it is known, so that it is the same in all
    cycles.  Limits that depend on the present mesh, like ``max_coarsen``, are no reason to refuse,
    nor are ``hmin`` and ``hmax``.  Where the gradient limit differs from node to node, the number
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
    if sizes.predicted <= (1.0 + BUDGET_TOLERANCE) * target:
        return
    in_parts = isinstance(mesh, PartitionedMesh)
    whole = mesh.gather() if isinstance(mesh, PartitionedMesh) else original or mesh
    per_simplex = sizes.predicted / sizes.simplices

    def check() -> None:
        if whole is not None:
            _check(whole, request, per_simplex, original if in_parts else None)

    mesh.ranks.agree(check)


def _check(
    mesh: SimplexMesh, request: Request, per_simplex: float, original: SimplexMesh | None
) -> None:
    """Raise if the boundary of a mesh needs more elements than requested."""
    options = request.options
    target, nodes, tolerance = options["elements"], options["nodes"], options["boundary_tolerance"]
    assert target is not None
    first, alone = original or mesh, request.for_boundary()

    def load_on(fine: SimplexMesh, allowed: float) -> float:
        sizes = alone.within(fine, allowed, first).without_number(fine)
        return per_simplex * count_simplices(fine, sizes) / target

    load, fine = load_on(mesh, tolerance), mesh
    while load > 1.0 + BUDGET_TOLERANCE and fine.n_cells < _MOST_CELLS:
        before = load
        for _ in range(_BISECTIONS):
            fine = bisect_edges(fine, np.ones(len(fine.edges), np.bool_)).mesh
        load = load_on(fine, tolerance)
        if load > (1.0 - _SETTLED) * before:
            break
    if load <= 1.0 + BUDGET_TOLERANCE:
        return
    what, number = ("elements", target) if nodes is None else ("nodes", nodes)
    text = (
        f"within boundary_tolerance = {tolerance:g} the curved boundary needs about "
        f"{count_text(load * number)} {what}; {count_text(number)} are not enough"
    )
    offer = smallest_tolerance(tolerance, load, cache(lambda allowed: load_on(fine, allowed)))
    raise TooManyElementsError(text if offer is None else f"{text}: boundary_tolerance={offer:g}")
