"""Meshes whose cells are bisected in place of a new mesh."""

from __future__ import annotations

import math
from dataclasses import replace

from adaptsize._defaults import refused_above
from adaptsize._messages import Message
from adaptsize.adaptation import tuning
from adaptsize.adaptation.need import smallest
from adaptsize.adaptation.new_mesh import NewMesh, goal_of
from adaptsize.adaptation.next_sizes import CycleRequest
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import Resolved, bisected
from adaptsize.errors import TooManyElementsError
from adaptsize.sizes import tuning as of_sizes
from adaptsize.sizes.search import Search

#: The name among those of mesh generators.
BISECTION = "bisection"


def divide_cells(mesh: SimplexMesh, first: NewMesh, request: CycleRequest) -> NewMesh:
    """Return a mesh in which the cells that are larger than their sizes are bisected.

    For a number of elements or nodes that the limits allow, and where the mesh would gain too
    little towards a tolerance, the sizes are scaled until the number is met.  If no cell is too
    large, the result has the old mesh, and ``n_meshes`` is 0.

    Raises
    ------
    TooManyElementsError
        If there would be more cells than ``max_elements``.
    """
    h, most = smallest(first.sizes.at_nodes), refused_above(request.options["max_elements"])

    def made(scale: float) -> NewMesh:
        divided = bisected(mesh, h, scale * tuning.LONGEST_OVER_SIZE, max_cells=most)
        return replace(first, mesh=divided.mesh, n_meshes=1, divided=divided)

    new = made(1.0)
    goal = goal_of(mesh, new, request)
    # Below the largest number there is room for steps: a division adds several cells.
    room = 0.0 if goal.by_nodes else goal.number * (1.0 + of_sizes.ACCEPTED) / most - 1.0
    wanted = goal.number / (1.0 + max(room, 0.0))
    search: Search[NewMesh] = Search(
        wanted, mesh.cell_dim, math.log1p(of_sizes.ACCEPTED), most=tuning.MOST_DIVISIONS, reach=3.0,
        bounds=(tuning.LEAST_SCALE, math.inf), resolution=tuning.ACCURACY,
    )  # fmt: skip
    search.add(first.sizes.predicted, new, goal.of(new))
    while (factor := search.factor) is not None:
        new = made(factor)
        search.add(first.sizes.predicted, new, goal.of(new))
    found = [trial for trial in search.trials if _is_within(trial.result.divided, most)]
    if not found:
        text = (
            "the sizes require more elements than {max_elements} = {:.0f}; increase the sizes or "
            "raise {max_elements}"
        )
        raise TooManyElementsError(Message(text, most))
    best = min(found, key=lambda trial: abs(math.log(trial.number / goal.number))).result
    return first if best.mesh is mesh else best


def _is_within(divided: Resolved | None, most: float) -> bool:
    return divided is not None and divided.is_complete and divided.mesh.n_cells <= most
