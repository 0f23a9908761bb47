"""Exact limiting in a solid that is not convex: see `adaptsize._kernels.exact_space`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np

from adaptsize._kernels.space_paths import Field
from adaptsize._kernels.space_sight import Sight
from adaptsize.limiting.edge_based import solve_edge_based
from adaptsize.limiting.exact.network import Network, key_of, network_of
from adaptsize.limiting.exact.reflex_edges import find_knots
from adaptsize.limiting.exact.space_sight import build_sight
from adaptsize.limiting.exact.work import along_curve
from adaptsize.limiting.gradient_limit import Slope
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


class SpaceResult(NamedTuple):
    """Limited sizes in a solid."""

    h: FloatArray
    """float64[n]"""
    entry: IntArray
    """int32[n]: the source at the origin of the path, -1 if there is none."""
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


def solve_in_space(
    mesh: SimplexMesh,
    h0: FloatArray,
    g: float,
    table: FloatArray,
    nodes: IntArray,
    lower: FloatArray,
    nearest: IntArray,
    boundary: FlatBoundary,
    report: ProgressCallback,
    *,
    sight: Sight | None = None,
    threads: int = 1,
) -> SpaceResult:
    """Return the limited sizes in a solid that is not convex.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra.
    h0 : float64[n]
    g : float
    table : float64[m, 12]
        Survivors, as entries (see exact.py).
    nodes : int32[m, 3]
        Nodes of each entry, padded with -1.
    lower, nearest : float64[n], int32[n]
        The smallest size that the entries allow, without regard to visibility, and the entry.
    boundary : FlatBoundary
    report : callable
    sight : Sight, optional
        Visibility data, if already built.
    threads : int, optional
    """
    n = mesh.n_points
    sight = build_sight(mesh, boundary) if sight is None else sight
    network = network_of(
        table, nodes, g, sight, find_knots(mesh.points, boundary, sight.walls.slack)
    )
    everyone = np.arange(n, dtype=np.int32)
    with_: _Options = {"threads": threads, "report": report}
    field = Field(lower + _EQUAL * np.abs(lower), np.full(n, -1, np.int32), np.full((n, 3), np.nan))
    order = along_curve(mesh.points)
    none = network.choice(np.empty(0, np.int32))
    network.lower(mesh.points, everyone, order, none, field, hints=nearest, **with_)
    proved = (field.way >= 0) | (h0 <= lower)
    upper = _spread(mesh, np.where(proved, lower, h0), g, report)
    proved |= np.isinf(upper)  # not reached by any source
    # Keep paths as short as those along edges of the mesh: they may continue over other edges.
    field.sizes[:] = np.where(proved, np.minimum(lower, upper), upper + _TIE * np.abs(upper))
    hidden = order[~proved[order]]
    finished = True
    if len(hidden):
        finished = _solve_hidden(network, field, hidden, everyone, with_)
    return _result(mesh, network, field, upper, lower, finished, report)


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


def _spread(mesh: SimplexMesh, h: FloatArray, g: float, report: ProgressCallback) -> FloatArray:
    """Return sizes lowered so that none exceeds a neighbour by more than g allows."""
    return solve_edge_based(mesh, h, Slope(np.array([g])), residual=False, report=report).h


def _result(
    mesh: SimplexMesh,
    network: Network,
    field: Field,
    upper: FloatArray,
    lower: FloatArray,
    finished: bool,
    report: ProgressCallback,
) -> SpaceResult:
    """Return sizes that satisfy the limit g along all edges, and their sources."""
    ways = network.ways
    sizes = np.maximum(np.minimum(field.sizes, upper), lower)
    h = _spread(mesh, sizes, network.g, report)
    m = network.n_sources
    base = np.where(field.way >= 0, ways.base[field.way], -1)
    base[h < sizes - _TIE * np.abs(sizes)] = -1
    bend = np.where((ways.edge[field.way] >= 0)[:, None], field.last, np.nan)
    entry = np.where(base < m, base, -1)
    proved = h <= lower + _EQUAL * np.abs(lower)
    return SpaceResult(h, entry.astype(np.int32), bend, proved, lower, network, finished)
