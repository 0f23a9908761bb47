"""Tetrahedra in a surface: a first volume for Mmg to start from, adapted and improved."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from adaptsize._checks import place_text
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import renumbered_edges
from adaptsize.errors import (
    BackendError,
    BackendTimeoutError,
    ResolutionWarning,
    TooManyElementsError,
)
from adaptsize.quality.boundary import distances_from, keeps_topology, overlapping_cells
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing import netgen
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.mmg import adapted
from adaptsize.remeshing.preparation import as_problem, number_regions, restore
from adaptsize.remeshing.protocol import Arrays, Backend, Facets, Problem
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.surface import THINNEST, refine_surface, remove_slivers, sliver_height
from adaptsize.remeshing.tetwild import TetWildBackend
from adaptsize.sizes import predict
from adaptsize.typing import IntArray

#: Mmg's ``hausd`` over the tolerance in the two runs on a surface.  Mmg divides edges whose middle
#: is farther than that from the tangent planes at their ends, which is twice the distance from an
#: arc.  With ``hausd`` the tolerance, it divides all edges longer than the bound that
#: `size_function` takes from curvature.
_HAUSD = (2.0, 1.2)


#: If cells have a smaller dihedral angle in degrees, fTetWild is tried alone.
_LEAST_ANGLE = 2.0
#: Processor time, in all and per cell, after which the generator is stopped while it adapts a first
#: volume.  On closed parts, it needed a fifth of that.
_SECONDS = 10.0
_SECONDS_PER_CELL = 1e-3
#: Cells that a first volume requires over those that were predicted, above which this is reported.
MANY_MORE = 1.5


def filled(
    problem: Problem,
    chosen: Backend,
    run: IsolatedRunner,
    n_cells: float,
    max_elements: float,
    union: SimplexMesh | None = None,
) -> SimplexMesh:
    """Return the tetrahedra in a surface, adapted from a first volume by a generator, and improved.

    If cells are still flat, fTetWild fills the surface with the same sizes.  Its mesh is returned
    if the smallest angle is larger, and topology and tolerance of the boundary are kept: of a fin
    thinner than the tolerance, it may leave an edge in more than two facets.  It also fills the
    surface if the generator fails on the first volume, or makes cells that overlap.

    ``union`` is the boundary of the solid if bodies of the surface overlap.
    """
    surface = problem.mesh if union is None else union
    inner = _first_volume(problem, run, is_simple=union is None)
    if not inner.is_adapted:
        _check_number(inner, n_cells, max_elements)
    seconds = _SECONDS + _SECONDS_PER_CELL * max(inner.mesh.n_cells, n_cells)
    inner = replace(inner, seconds=seconds)
    if problem.in_volume is not None:
        inner = problem.in_volume(inner)
    new, angle, failure = None, -np.inf, None
    try:
        new = _without_overlaps(restore(chosen.solve(inner, run), inner, chosen.name), chosen.name)
        new = improved(new, surface, problem.tolerance, inner.size)
        angle = float(minimum_angles(new).min())
    except BackendTimeoutError:
        raise
    except BackendError as error:
        failure = error
    if angle >= _LEAST_ANGLE:
        assert new is not None
        return new
    try:
        raw = TetWildBackend().solve(problem, replace(run, backend="tetwild"))
        other = _without_overlaps(restore(raw, problem, "tetwild"), "tetwild")
        other = improved(other, surface, problem.tolerance, problem.size)
    except BackendError as error:
        if new is None:
            raise failure or error from None
        return new
    if new is None:
        return other
    fits, other_fits = (_fits(mesh, surface, problem.tolerance) for mesh in (new, other))
    is_better = float(minimum_angles(other).min()) > angle and other_fits >= fits
    return other if is_better else new


def _without_overlaps(mesh: SimplexMesh, generator: str) -> SimplexMesh:
    """Return a mesh; refuse one whose cells overlap, as they may where bodies nearly touch.

    Raises
    ------
    BackendError
        With the number of cells and a place.
    """
    found = overlapping_cells(mesh)
    if found is not None:
        raise BackendError(
            f"{generator} returned a mesh in which {found}, one at {place_text(found.place)}"
        )
    return mesh


def _fits(mesh: SimplexMesh, surface: SimplexMesh, tolerance: float) -> bool:
    """Return whether the boundary has the topology of the surface, and is within the tolerance."""
    skin = mesh.boundary().mesh
    distances = distances_from(skin, surface), distances_from(surface, skin)
    is_near = max(found.largest for found in distances) <= tolerance
    return is_near and keeps_topology(skin, surface)


def _check_number(inner: Problem, n_cells: float, max_elements: float) -> None:
    """Warn if the sizes require many more cells in a first volume than in the surface.

    Of open surfaces, generators may fill more than what the surface encloses.

    Raises
    ------
    TooManyElementsError
        If these are also more than ``max_elements``.
    """
    assert inner.size is not None
    found = predict(inner.mesh, inner.size, backend="mmg").cells
    if found <= MANY_MORE * n_cells:
        return
    text = (
        f"about {found:.3g} elements instead of the predicted {n_cells:.3g}: the first mesh "
        "fills more than the surface encloses; close the surface or increase the sizes"
    )
    if found > max_elements:
        raise TooManyElementsError(f"{text}, or raise max_elements = {max_elements:.3g}")
    warnings.warn(text, ResolutionWarning, stacklevel=4)


def _first_volume(problem: Problem, run: IsolatedRunner, *, is_simple: bool) -> Problem:
    """Return the request to adapt tetrahedra in a surface, which do not follow the sizes yet.

    Mmg adapts the surface to the sizes, and Netgen fills it, without moving a node.  If one of
    them fails, Netgen fills the given surface, with divided edges.  fTetWild fills every surface,
    with edges of its default length, and without feature edges.  Only that makes unions: it is the
    first one if the surface is not simple, where bodies overlap.
    """
    assert problem.size is not None
    can_fill = is_simple and netgen.can_fill(problem.mesh)
    found = _by_netgen(problem, problem.size, run) if can_fill else None
    if found is not None:
        return found
    raw = TetWildBackend().solve(replace(problem, size=None), replace(run, backend="tetwild"))
    return _inside(problem, raw, "tetwild")


def _inside(problem: Problem, raw: Arrays, generator: str, **known: Any) -> Problem:
    """Return the request to adapt tetrahedra in the surface of another one."""
    volume = restore(raw, problem, generator)
    plain = as_problem("tetrahedra", volume, problem.tolerance / volume.diagonal)
    return replace(plain, size=problem.size, size_nodes=problem.size_nodes, **known)


def _by_netgen(problem: Problem, size: Size, run: IsolatedRunner) -> Problem | None:
    for thinnest in THINNEST:
        surface, ridges = refine_surface(problem.mesh, size, problem.tolerance, thinnest)
        if thinnest == THINNEST[0]:
            adapted = _adapted(surface, ridges, problem, size, run)
            if adapted is not None:
                return adapted
        raw = netgen.fill(surface, run)
        if raw is not None:
            return _inside(problem, raw, "netgen", ridges=ridges)
    return None


def _adapted(
    surface: SimplexMesh, ridges: IntArray, problem: Problem, size: Size, run: IsolatedRunner
) -> Problem | None:
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
    ridges = renumbered_edges(ridges, new_node)
    return _inside(problem, raw, "netgen", ridges=ridges, is_adapted=True)


def adapt_surface(
    surface: SimplexMesh, ridges: IntArray, size: Size, tolerance: float, run: IsolatedRunner
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
    problem = Problem(
        "surface", surface, tolerance, Facets(), regions, tags, size=size, ridges=ridges
    )
    # The first run, on triangles of all shapes, makes too many, and the more the smaller its
    # ``hausd``.  The second one corrects that.
    made = adapted(problem, _HAUSD, run, largest=1.25, text="adapting the surface with Mmg")
    new_tags = None if surface.cell_tags is None else tags[made["regions"]]
    new = SimplexMesh(
        made["points"], made["cells"], cell_tags=new_tags, tag_names=surface.tag_names
    )
    return new, made["ridges"]
