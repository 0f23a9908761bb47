"""Meshes whose cells are bisected in place of a new mesh."""

from __future__ import annotations

import math
from dataclasses import replace

from adaptsize._messages import Message
from adaptsize.adaptation import tuning
from adaptsize.adaptation.need import smallest
from adaptsize.adaptation.new_mesh import NewMesh
from adaptsize.adaptation.next_sizes import CycleRequest
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import Resolved, bisected
from adaptsize.errors import TooManyElementsError
from adaptsize.sizes.search import ACCEPTED, scale_to

#: The name among those of mesh generators.
BISECTION = "bisection"


def divide_cells(mesh: SimplexMesh, first: NewMesh, request: CycleRequest) -> NewMesh:
    """Return a mesh in which the cells that are larger than their sizes are bisected.

    For a number of elements or nodes, the sizes are scaled until that number is met.  If no cell is
    too large, the result has the old mesh, and ``n_meshes`` is 0.

    Raises
    ------
    TooManyElementsError
        If there would be more cells than ``max_elements``.
    """
    h = smallest(first.sizes.at_nodes)
    elements, nodes = request.options["elements"], request.options["nodes"]
    wanted = elements if nodes is None else nodes
    most = request.options["max_elements"]

    def made(scale: float) -> Resolved:
        return bisected(mesh, h, scale * tuning.LONGEST_OVER_SIZE, max_cells=most)

    def number(divided: Resolved) -> float:
        return divided.mesh.n_cells if nodes is None else divided.mesh.n_points

    divided = made(1.0)
    is_goal = request.options["tolerance"] is None
    if wanted is not None and (is_goal or number(divided) > wanted):
        divided = scale_to(
            wanted, made, number, 1.0, mesh.cell_dim, math.log1p(ACCEPTED),
            most=tuning.MOST_DIVISIONS,
        )  # fmt: skip
    if not divided.is_complete or divided.mesh.n_cells > most:
        text = (
            "the sizes require more elements than {max_elements} = {:.3g}; increase the sizes or "
            "raise {max_elements}"
        )
        raise TooManyElementsError(Message(text, most))
    if divided.mesh.n_cells == mesh.n_cells:
        return first
    return replace(first, mesh=divided.mesh, n_meshes=1, divided=divided)
