"""Tetrahedra in a surface for Mmg to start from, and the surface adapted before."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import renumbered_edges
from adaptsize.errors import BackendError
from adaptsize.remeshing import netgen
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.mmg import GOOD_SHARE, band_and_median, job_of, run_adapt
from adaptsize.remeshing.preparation import number_regions
from adaptsize.remeshing.protocol import Facets, Problem, RawMesh, Runner
from adaptsize.remeshing.registry import backend_named
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.surface import THINNEST, refine_surface, remove_slivers, sliver_height
from adaptsize.typing import IntArray

#: Mmg's ``hausd`` over the tolerance in the two runs on a surface.  Mmg divides edges whose middle
#: is farther than that from the tangent planes at their ends, which is twice the distance from an
#: arc.  With ``hausd`` the tolerance, it divides all edges longer than the bound that
#: `size_function` takes from curvature.
_HAUSD = (2.0, 1.2)


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
    # Where feature edges meet at small angles, Mmg makes edges much shorter than the size.  Those
    # shorter than this share of the tolerance are removed.
    height = sliver_height(surface, size, 0.5 * problem.tolerance)
    surface, new_node = remove_slivers(surface, height)
    raw = netgen.fill(surface, run)
    if raw is None:
        return None
    return FirstVolume(raw, "netgen", renumbered_edges(ridges, new_node), is_adapted=True)


def adapt_surface(
    surface: SimplexMesh, ridges: IntArray, size: Size, tolerance: float, run: Runner
) -> tuple[SimplexMesh, IntArray]:
    """Return a surface with the requested edge lengths, and the ridges as they are divided now.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Facets of different cell tags stay separate.
    ridges : int32[n, 2]
        Edges that stay sharp.
    size : callable
    tolerance : float
        Allowed distance, in the unit of the coordinates, of the boundary of a volume that Mmg
        makes afterwards.

    Raises
    ------
    BackendError
        If Mmg fails.
    """
    regions, tags = number_regions(surface)
    none = np.empty(0, np.int32)
    facets = Facets(none.reshape(0, 2), none, none.astype(bool), none.astype(np.int64), False)
    problem = Problem("surface", surface, tolerance, facets, regions, tags, ridges=ridges)
    made, options = job_of(problem)
    factor = 1.0
    # The first run, on triangles of all shapes, makes too many, and the more the smaller its
    # ``hausd``.  The second one corrects that.
    for hausd in _HAUSD:
        options["hausd"] = hausd * tolerance
        sizes = factor * size(made["points"])
        made = run_adapt(made, sizes, options, run, "adapting the surface with Mmg")
        if len(made["cells"]) == 0:
            raise BackendError("mmg returned an empty surface")
        share, median = band_and_median(size, made)
        if share >= GOOD_SHARE:
            break
        limit = 1.25
        factor = float(np.clip(factor / median, 1.0 / limit, limit))
    new_tags = None if surface.cell_tags is None else tags[made["regions"]]
    new = SimplexMesh(
        made["points"], made["cells"], cell_tags=new_tags, tag_names=surface.tag_names
    )
    return new, made["ridges"]
