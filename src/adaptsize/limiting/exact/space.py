"""Exact limiting in a solid that is not convex: see `adaptsize._kernels.exact_space`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypedDict

import numpy as np

from adaptsize._kernels.space_paths import Field
from adaptsize._kernels.space_sight import Sight
from adaptsize.background._curve import along_curve
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.network import Network, key_of, network_of
from adaptsize.limiting.exact.reflex_edges import Knots, find_knots
from adaptsize.limiting.exact.space_sight import build_sight
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.geometry.boundary import FlatBoundary


# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12

# Share by which paths may be longer than those along edges of the mesh.
_TIE = 1e-10


# Largest number of iterations; each allows paths one more bend.
_ROUNDS = 200


class _Options(TypedDict):
    """Options for running kernels."""

    threads: int
    report: ProgressCallback


class Solid(NamedTuple):
    """A solid, its reflex edges, and the nodes at which sizes are computed."""

    points: FloatArray
    """float64[n, 3]: the nodes; on one of many processes, its own and those at the boundary."""
    nodes: IntArray
    """int32[k]: the nodes to solve along a Morton curve; nodes of reflex edges are among them."""
    sight: Sight
    knots: Knots


class Entries(NamedTuple):
    """The sources, in lexicographic order of their nodes.

    The first of several sources that allow the same size counts, so that their order matters.
    """

    table: FloatArray
    """float64[m, 12] (see exact.py)"""
    nodes: IntArray
    """int32[m, 3]: their nodes, padded with -1; points between the nodes have none."""


class SpaceResult(NamedTuple):
    """Limited sizes in a solid."""

    h: FloatArray
    """float64[n]"""
    entry: IntArray
    """int32[n]: the source at the origin of the path; -1 if not known, or if there is none."""
    start: IntArray
    """int32[n]: the node of a reflex edge where the path starts, -1 if there is none.  The size at
    that node comes along edges of the mesh."""
    bend: FloatArray
    """float64[n, 3]: last bend of the path, nan if it is straight."""
    proved: BoolArray
    """bool[n]: the size is exact, since ``h`` equals ``lower``."""
    lower: FloatArray
    """float64[n]: the smallest size that the sources allow, without regard to visibility."""
    network: Network | None
    """Paths that determine the size at any point; None if each node sees its source."""
    finished: bool
    """Whether sizes along reflex edges converged within the largest number of iterations."""


#: Lowers sizes (float64[n]) that exceed a neighbour by more than g allows along the edge between.
Spread: TypeAlias = Callable[[FloatArray], FloatArray]


def solid_of(mesh: SimplexMesh, boundary: FlatBoundary, nodes: IntArray | None = None) -> Solid:
    """Return a solid with all nodes of a mesh, or some of them, to solve.

    Parameters
    ----------
    mesh : SimplexMesh
        Has all cells with a node on the boundary, others do not matter.
    boundary : FlatBoundary
    nodes : int32[k], optional
        Nodes to solve besides those of reflex edges; by default all.
    """
    sight = build_sight(mesh, boundary)
    knots = find_knots(mesh.points, boundary, sight.walls.slack)
    if nodes is None:
        return Solid(mesh.points, along_curve(mesh.points), sight, knots)
    nodes = np.union1d(nodes, knots.nodes).astype(np.int32)
    order = along_curve(np.ascontiguousarray(mesh.points[nodes]))
    return Solid(mesh.points, nodes[order], sight, knots)


def spread_along_edges(mesh: SimplexMesh, g: float, report: ProgressCallback) -> Spread:
    """Return the function that lowers sizes along the edges of a mesh."""
    return lambda h: limit_along_edges(mesh, h, g, report)


def solve_in_space(
    solid: Solid,
    h0: FloatArray,
    g: float,
    entries: Entries,
    lower: FloatArray,
    nearest: IntArray,
    spread: Spread,
    report: ProgressCallback,
    *,
    threads: int = 1,
) -> SpaceResult:
    """Return the limited sizes in a solid that is not convex.

    Parameters
    ----------
    solid : Solid
    h0 : float64[n]
    g : float
    entries : Entries
    lower, nearest : float64[n], int32[n]
        The smallest size that the entries allow, without regard to visibility, and the entry.
    spread : callable
    report : callable
    threads : int, optional

    Notes
    -----
    Sizes do not depend on the order in which nodes and paths are tested, bit for bit.  Where
    several sources allow nearly the same size at a node, it suffices that one of them is visible;
    the size is ``lower`` whichever is found first.  At nodes of reflex edges it matters which
    source it is, and the first one counts.
    """
    n, nodes, knots = len(solid.points), solid.nodes, solid.knots.nodes
    network = network_of(*entries, g, solid.sight, solid.knots)
    everyone = np.arange(n, dtype=np.int32)
    with_: _Options = {"threads": threads, "report": report}
    nearly = lower + _EQUAL * np.abs(lower)
    field = Field(nearly.copy(), np.full(n, -1, np.int32), np.full((n, 3), np.nan))
    none = network.choice(np.empty(0, np.int32))
    is_knot = np.isin(nodes, knots)
    others = nodes[~is_knot]
    network.lower(solid.points, everyone, others, none, field, hints=nearest, **with_)
    hidden = nodes[is_knot | ((field.way < 0) & (h0 > lower))[nodes]]
    network.lower(solid.points, everyone, hidden, network.sources(), field, **with_)
    proved = (field.way >= 0) | (h0 <= lower)
    upper = spread(np.where(proved, lower, h0))
    proved |= np.isinf(upper)  # not reached by any source
    # Keep paths as short as those along edges of the mesh: they may continue over other edges.
    field.sizes[:] = np.where(proved, np.minimum(lower, upper), upper + _TIE * np.abs(upper))
    hidden = nodes[~proved[nodes]]
    finished = True
    if len(hidden):
        finished = _solve_hidden(network, field, hidden, everyone, with_)
    sizes = np.maximum(np.minimum(field.sizes, upper), lower)
    h = spread(np.where(sizes <= nearly, lower, sizes))
    return _result(network, field, sizes, h, lower, finished)


def _solve_hidden(
    network: Network, field: Field, hidden: IntArray, everyone: IntArray, with_: _Options
) -> bool:
    """Lower nodes (In/Out: field) from which their smallest source is not visible.

    Returns whether the iteration converged within _ROUNDS iterations.
    """
    points, knots = network.sight.stars.points, network.knots.nodes
    network.lower(points, everyone, hidden, network.sources(), field, **with_)
    waiting = np.isin(knots, hidden)
    order = knots[waiting]
    changed = np.flatnonzero(field.way[knots] >= 0).astype(np.int32)
    for _ in range(_ROUNDS):
        if len(changed) == 0:
            break
        network.set_knots(field.sizes[knots])
        fresh = np.concatenate([network.n_sources + changed, network.extend(changed, field)])
        if len(order) == 0:  # all paths are built, and no node of an edge is left
            changed = order
            break
        before = field.sizes[knots]
        network.lower(points, everyone, order, network.choice(fresh), field, **with_)
        fallen = before - field.sizes[knots]
        changed = np.flatnonzero(fallen > _EQUAL * np.abs(before)).astype(np.int32)
    network.set_knots(field.sizes[knots])
    network.used = network.choice(_in_use(network, field))
    rest = hidden[~np.isin(hidden, knots)]
    network.lower(points, everyone, rest, network.used, field, **with_)
    return len(changed) == 0


def _in_use(network: Network, field: Field) -> IntArray:
    """Return the paths from nodes of reflex edges, and those over edges that reach such a node."""
    ways, knots = network.ways, network.knots
    bent = np.flatnonzero(ways.edge >= 0)
    edge, way, _, _ = network.candidates(np.arange(len(knots.nodes), dtype=np.int32), field)
    used = np.isin(key_of(ways.edge[bent], ways.parent[bent]), key_of(edge, way))
    straight = network.n_sources + np.arange(len(knots.nodes))
    return np.concatenate([straight, bent[used]])


def _result(
    network: Network,
    field: Field,
    sizes: FloatArray,
    h: FloatArray,
    lower: FloatArray,
    finished: bool,
) -> SpaceResult:
    """Return sizes h, which satisfy the limit g along all edges, and the sources of ``sizes``."""
    ways = network.ways
    m = network.n_sources
    reached = np.flatnonzero(field.way >= 0)  # none if the bounds satisfy the limit
    base, bend = np.full(len(h), -1, ways.base.dtype), np.full_like(field.last, np.nan)
    base[reached] = ways.base[field.way[reached]]
    base[h < sizes * (1.0 - _TIE)] = -1
    bent = reached[ways.edge[field.way[reached]] >= 0]
    bend[bent] = field.last[bent]
    entry = np.where(base < m, base, -1).astype(np.int32)
    knots = np.append(network.knots.nodes, np.int32(-1))
    start = knots[np.where(base < m, -1, base - m)].astype(np.int32)
    proved = h <= lower + _EQUAL * np.abs(lower)
    return SpaceResult(h, entry, start, bend, proved, lower, network, finished)
