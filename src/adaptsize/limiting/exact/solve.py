"""Exact limiting on one component: sources at nodes, edges, faces and corners, allowed sizes."""

from dataclasses import replace
from functools import partial

import numpy as np

from adaptsize._kernels import exact_candidates as candidates
from adaptsize._kernels.origins import name_along_edges
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.candidates import (
    EQUAL,
    TIE,
    Component,
    candidates_of,
    entries_of_nodes,
    sources_on_cells,
)
from adaptsize.limiting.exact.expansion import expand_from_points
from adaptsize.limiting.exact.field import (
    ComponentSolution,
    Entries,
    ExactField,
    Points,
    node_entries,
)
from adaptsize.limiting.exact.kept import corners_in, ground_in, plane_in, solid_in
from adaptsize.limiting.exact.obstacles_in_plane import (
    Plane,
    along_walls,
    at_nodes,
    favours_expansion,
    has_many_corners,
    with_corners,
    with_known_corners,
)
from adaptsize.limiting.exact.paths_in_space import solve_in_solid
from adaptsize.limiting.exact.solid import WholeSolid, solid_of
from adaptsize.limiting.problem import TooManyCorners
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Sizes that rise by less than this share over the diagonal are equal to rounding on any path.
# Which path is shortest would be lost to rounding, and with it where it may bend.
_NO_RISE = 1e-14


def hardly_rises(least: float, g: float, diagonal: float) -> bool:
    """Return whether the least bound holds in all of a component, but for rounding."""
    return g * diagonal <= _NO_RISE * least


def solve_on_mesh(component: Component, boundary: FlatBoundary, convex: bool) -> ComponentSolution:
    """Solve on one component of triangles in the plane or of tetrahedra."""
    mesh, component = component.mesh, component.with_margin()
    if len(boundary.facets) == 0:
        return _along_edges(component)
    if convex:
        return solve_by_sight(component, None, boundary)
    if hardly_rises(component.least, component.g, mesh.diagonal):
        return _level(component)
    if mesh.dim == 3:
        if component.links is None:
            solid = solid_in(mesh, boundary)
        else:
            solid = solid_of(mesh, boundary, around=component.links.cells)
        found, start = solve_in_solid(WholeSolid(component, solid))
        _name_all(component, found, start)
        return found
    n_corners = corners_in(mesh, boundary)
    if favours_expansion(n_corners, mesh.n_points):
        too_many = has_many_corners(n_corners, mesh.n_points)
        expanded = _solve_by_expansion(component, boundary, too_many)
        if expanded is not None:
            return expanded
        if too_many and not component.at_any_price:
            raise TooManyCorners
    plane = plane_in(mesh, boundary)
    found = solve_by_sight(component, plane, boundary)
    if rises_too_fast(component, found.h):
        _keep_edges(component, found)
    return found


def _solve_by_expansion(
    component: Component, boundary: FlatBoundary, too_many: bool
) -> ComponentSolution | None:
    """Solve by triangular expansion; None if edges are sources, or cells overlap.

    Whether edges are sources shows on the way, and is worth the search if corners are too many.
    """
    nodes, steep = candidates_of(component)
    if not component.face_sources:
        steep = None
    if not (steep is None or too_many):
        return None

    def is_lost(h: FloatArray) -> bool:
        return steep is not None and len(sources_on_cells(component, steep, h).nodes) > 0

    ground = ground_in(component.mesh, boundary)
    expanded = None if ground is None else expand_from_points(component, ground, nodes, is_lost)
    if expanded is None:
        return None
    mesh, extra = component.mesh, component.extra
    h, root, bend = expanded
    places, sizes, names = mesh.points, h, np.arange(len(h), dtype=np.int32)
    if extra is not None:
        places = np.concatenate([places, extra.points])
        sizes = np.concatenate([sizes, extra.sizes])
        names = np.concatenate([names, extra.numbers])
    used = np.flatnonzero(np.bincount(root[np.isfinite(h)], minlength=len(names)))
    field = ExactField(component.g, None, False)
    field.groups.append(node_entries(places[used], sizes[used], names[used]))
    named = np.full((len(h), 2), -1, np.int32)
    named[:, 0] = names[root]
    found = ComponentSolution(h, np.full(len(h), -1, np.int32), field, bend, nodes=named)
    own = used[np.append(root, np.arange(len(h), len(names)))[used] == used]
    sources = node_entries(places[own], sizes[own], names[own])
    into = mesh.points - places[root]  # of paths, 0 at nodes that keep their bounds
    corners = None if too_many else (h, into)
    found.later = partial(field_of_plane, mesh, boundary, sources, corners, component.g)
    found.interpolates = too_many
    return found


def field_of_plane(
    mesh: SimplexMesh,
    boundary: FlatBoundary,
    sources: Entries,
    corners: tuple[FloatArray, FloatArray] | None,
    g: float,
) -> ExactField:
    """Return the field of sources, and of corners if these are given.

    ``corners``: the sizes at all nodes, and the last straight pieces of their paths, 0 for none.
    """
    plane = plane_in(mesh, boundary)
    entries = at_nodes(sources, plane)
    if corners is not None:
        entries = with_known_corners(entries, plane, *corners)
    return ExactField(g, plane.sight, False, [entries])


def rises_too_fast(component: Component, h: FloatArray) -> bool:
    """Return whether sizes grow faster than g along any edge, as they may if cells overlap."""
    mesh = component.mesh
    axes = (0,) * mesh.dim
    return bool(candidates.any_edge_exceeds(mesh.points, axes, mesh.cells, h, component.g))


def solve_by_sight(
    component: Component, plane: Plane | None, boundary: FlatBoundary
) -> ComponentSolution:
    """Solve in a convex domain (no ``plane``) or in the plane."""
    mesh, h0, g = component.mesh, component.h0, component.g
    order = component.order
    if order is None:
        order = along_curve(mesh.points, component.workers.threads)
    points = Points(mesh.points, order)
    if plane is not None:
        points = points._replace(on_wall=plane.boundary.rows)
    nodes, steep = candidates_of(component)
    linear = steep is not None and component.face_sources
    entries, workers = entries_of_nodes(component, nodes), component.workers
    field = ExactField(g, None, linear, [entries])
    if plane is not None:
        field = ExactField(g, plane.sight, linear, [at_nodes(entries, plane)])
    # In the plane, all nodes are kept if no bounds meet.
    if (steep is not None or plane is None) and len(entries.nodes):
        field.keep_survivors(component.margin, workers.part(0.0, 0.1))
    if component.complete is not None:
        field.groups[0] = component.complete(field.groups[0])
    if plane is not None:
        field.groups[0] = with_corners(field.groups[0], g, plane, linear, workers.report)
    h, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    field.lower_by_last(points, h, source, workers.part(0.1, 0.5 if linear else 1.0))
    if not linear or steep is None:
        return ComponentSolution(h, source, field)
    entries = sources_on_cells(component, steep, h, (source, field) if plane is None else None)
    if len(entries.nodes) or (plane is not None and plane.merge is not None):
        if plane is not None:
            entries = along_walls(entries, mesh.points, boundary.facets)
            entries = with_corners(entries, g, plane, linear, workers.report)
        field.groups.append(entries)
        field.lower_by_last(points, h, source, workers.part(0.5, 1.0))
    workers.report("limiting the gradient", 1.0)
    return ComponentSolution(h, source, field)


def _name_all(component: Component, found: ComponentSolution, start: IntArray) -> None:
    """Name the sources of sizes that come along edges (In/Out: found)."""
    mesh, h = component.links or component.mesh, found.h
    named, bend = found.named(), found.bends().copy()
    if len(bend) == 0:
        bend = np.full(mesh.points.shape, np.nan)
    known: BoolArray = (found.source >= 0) | (h >= component.h0)
    if not known.all():
        n = len(h)
        scratch = tuple(np.empty(n, np.int32) for _ in range(4))
        given = (read_only(mesh.points), read_only(mesh.cells), *mesh.rings)
        name_along_edges(
            given, (h, component.g, TIE), start, known, (named, bend), (*scratch, np.empty(n))
        )
        found.nodes, found.bend = named, bend


def _level(component: Component) -> ComponentSolution:
    """Return the least bound of all: g is 0, or so small that sizes hardly rise."""
    mesh, h0, least, extra = component.mesh, component.h0, component.least, component.extra
    name, place = int(np.argmin(h0)), mesh.points[np.argmin(h0)]
    if extra is not None and least < h0[name]:
        k = int(np.argmin(extra.sizes))
        name, place = int(extra.numbers[k]), extra.points[k]
    entry = node_entries(place[None], np.array([least]), np.array([name], np.int32))
    source = np.where(h0 > least, 0, -1).astype(np.int32)
    bend = np.full(mesh.points.shape, np.nan)
    field = ExactField(component.g, None, False, [entry])
    return ComponentSolution(np.full(mesh.n_points, least), source, field, bend)


def _along_edges(component: Component) -> ComponentSolution:
    """Solve by paths along edges: if no cell has a measure."""
    mesh, h0, g = component.mesh, component.h0, component.g
    nowhere = np.empty((0, mesh.dim))
    none = node_entries(nowhere, np.empty(0), np.empty(0, np.int32))
    field = ExactField(g, None, False, [none])
    found = ComponentSolution(h0.copy(), np.full(mesh.n_points, -1, np.int32), field, nowhere)
    _keep_edges(component, found)
    return found


def _keep_edges(component: Component, found: ComponentSolution) -> None:
    """Lower sizes that exceed a neighbour by more than g allows (In/Out: found).

    Around folds, lines of sight end where paths along edges continue.  There, a size is proved
    exact only if it equals the size that would result if all sources were visible.
    """
    mesh, g = component.mesh, component.g
    along = limit_along_edges(mesh, found.h, g, component.workers.report)
    with np.errstate(invalid="ignore"):
        lowered = along < found.h * (1.0 - EQUAL)
    if len(found.field.groups[0].nodes) and not lowered.any():
        return
    found.h[lowered] = along[lowered]
    found.source[lowered] = -1
    _name_all(component, found, np.full(mesh.n_points, -1, np.int32))
    points = Points(mesh.points, along_curve(mesh.points))
    unhidden = replace(found.field, sight=None)
    found.lower, _ = unhidden.lowered(points, component.h0, component.workers)
    found.proved = found.h <= found.lower * (1.0 + EQUAL)
