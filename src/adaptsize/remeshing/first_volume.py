"""Tetrahedra in a surface for Mmg to start from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import renumbered_edges
from adaptsize.errors import BackendError
from adaptsize.remeshing import netgen
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.mmg_surface import adapt_surface
from adaptsize.remeshing.protocol import Problem, RawMesh
from adaptsize.remeshing.registry import backend_named
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.slivers import remove_slivers
from adaptsize.remeshing.surface import THINNEST, refine_surface, sliver_height
from adaptsize.typing import IntArray

#: Where feature edges meet at small angles, Mmg makes edges much shorter than the size.  Those
#: shorter than this share of the tolerance are removed.
_SHORTEST = 0.5


@dataclass(frozen=True)
class FirstVolume:
    """Tetrahedra in a surface, made by a generator that does not follow the sizes."""

    raw: RawMesh
    generator: str
    ridges: IntArray
    """Edges that must stay sharp."""
    is_adapted: bool = False
    """Whether the surface has the requested sizes already."""


def first_volume(problem: Problem, size: Size, run: IsolatedRunner) -> FirstVolume:
    """Return tetrahedra in a surface.

    Mmg adapts the surface to the sizes, and Netgen fills it, without moving a node.  If one of
    them fails, Netgen fills the given surface, with divided edges.  fTetWild fills every surface,
    with edges of its default length, and without feature edges.
    """
    if netgen.can_fill(problem.mesh):
        found = _by_netgen(problem, size, run)
        if found is not None:
            return found
    raw = backend_named("tetwild").solve(
        replace(problem, size=None), replace(run, backend="tetwild")
    )
    return FirstVolume(raw, "tetwild", np.empty((0, 2), np.int32))


def _by_netgen(problem: Problem, size: Size, run: IsolatedRunner) -> FirstVolume | None:
    for thinnest in THINNEST:
        surface, ridges = refine_surface(problem.mesh, size, problem.tolerance, thinnest)
        if thinnest == THINNEST[0]:
            adapted = _adapted(surface, ridges, problem, size, run)
            if adapted is not None:
                return adapted
        raw = netgen.fill(surface, run)
        if raw is not None:
            return FirstVolume(raw, "netgen", ridges)
    return None


def _adapted(
    surface: SimplexMesh, ridges: IntArray, problem: Problem, size: Size, run: IsolatedRunner
) -> FirstVolume | None:
    """Return tetrahedra in a surface of the requested sizes, or None if a generator fails."""
    try:
        surface, ridges = adapt_surface(surface, ridges, size, problem.tolerance, run)
    except BackendError:
        return None
    height = sliver_height(surface, size, _SHORTEST * problem.tolerance)
    surface, new_node = remove_slivers(surface, height)
    raw = netgen.fill(surface, run)
    if raw is None:
        return None
    return FirstVolume(raw, "netgen", renumbered_edges(ridges, new_node), is_adapted=True)
