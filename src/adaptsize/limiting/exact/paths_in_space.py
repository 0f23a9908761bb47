"""Exact limiting in a solid that is not convex: see `adaptsize._kernels.exact_space`."""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.space_paths import Field
from adaptsize._workers import Workers
from adaptsize.limiting.exact.candidates import (
    EQUAL,
    TIE,
    entries_of_nodes,
    sources_on_cells,
)
from adaptsize.limiting.exact.field import (
    ComponentSolution,
    Entries,
    ExactField,
    Points,
)
from adaptsize.limiting.exact.network import Network, network_of
from adaptsize.limiting.exact.relayed import propagate_paths
from adaptsize.limiting.exact.solid import WholeSolid
from adaptsize.typing import FloatArray, IntArray

# Largest number of iterations; each allows paths one more bend.
_ROUNDS = 200

# In rough solids the paths may grow exponentially: 250 000 on 369 nodes, in two minutes, where a
# few thousand are usual.  With more than these and so many for each node the search is given up.
_MOST_PATHS, _PATHS_PER_NODE = 2000, 2

# Paths are propagated where the product of straight reflex edges and hidden nodes is larger than
# this number times that of all nodes.  On combs, stairs and bores of 280 to 1 500 nodes the search
# takes 8 to 94 times as long as fast marching above this, and 2 to 12 times below, but for some of
# a few hundred nodes (up to 27, 17 ms); propagation takes 2 to 10 times as long everywhere.
# Fewer nodes than ``_FEW`` count as so many, since a search among them takes milliseconds.
_DEAR, _FEW = 4, 400


def solve_in_solid(known: WholeSolid) -> tuple[ComponentSolution, IntArray]:
    """Return the solution, and where the known part of the path to each node starts.

    This is a node of a reflex edge, whose size comes along edges of the mesh; -1 if there is none.
    """
    component, solid = known.component, known.solid
    nodes, steep = known.candidates()
    linear = steep is not None and component.face_sources
    exact = ExactField(component.g, None, linear)
    lower, source = known.h0.copy(), np.full(len(known.h0), -1, np.int32)
    points = Points(solid.points, solid.nodes)
    numbers = []

    def lower_by(entries: Entries) -> None:
        every, names = known.with_others(entries)
        exact.groups.append(every)
        numbers.append(names)
        exact.lower_by_last(points, lower, source, component.workers)

    lower_by(entries_of_nodes(component, nodes))
    if linear and steep is not None:
        lower_by(sources_on_cells(component, steep, known.own(lower)))
    # The first of several sources that allow the same size counts: their order is that of nodes.
    named = np.concatenate(numbers)
    order = np.lexsort(named.T[::-1]).astype(np.int32)
    place = np.empty(len(order) + 1, np.int32)  # of each entry in this order
    place[order], place[-1] = np.arange(len(order)), -1
    network = network_of(exact.table[order], known.known(named)[order], component.g, solid)
    field = Field(
        np.empty_like(lower), np.full_like(source, -1), np.full_like(solid.points, np.nan)
    )
    h, sizes, finished, propagated = _solve(known, network, field, lower, place[source])
    entry, start, bend = _origins(network, field, sizes, h)
    source = np.append(order, np.int32(-1))[entry]
    proved = h <= lower + EQUAL * np.abs(lower)
    solution = ComponentSolution(h, source, exact, bend, proved, lower, finished=finished)
    solution.propagated = propagated
    return solution, start


class Found(NamedTuple):
    """Limited sizes."""

    h: FloatArray
    sizes: FloatArray
    """Those of the paths over reflex edges."""
    finished: bool
    """Whether all paths were found."""
    propagated: bool
    """Whether paths were propagated instead."""


def _solve(
    known: WholeSolid, network: Network, field: Field, lower: FloatArray, nearest: IntArray
) -> Found:
    """Return the limited sizes.

    Parameters
    ----------
    known : WholeSolid
    network : Network
        The straight paths from the sources (In/Out).
    field : Field
        Out: the paths.
    lower : float64[n]
        The smallest size that the sources allow, without regard to visibility.
    nearest : int32[n]
        The source that allows it.

    Notes
    -----
    Sizes do not depend on the order in which nodes and paths are tested, bit for bit.  Where
    several sources allow nearly the same size at a node, it suffices that one of them is visible;
    the size is ``lower`` whichever is found first.  At nodes of reflex edges it matters which
    source it is, and the first one counts.
    """
    solid, h0, spread, workers = known.solid, known.h0, known.spread, known.component.workers
    nodes = solid.nodes
    nearly = lower + EQUAL * np.abs(lower)
    field.sizes[:] = nearly
    on_reflex_edge = np.zeros(len(lower), np.bool_)
    on_reflex_edge[solid.reflex_edges.nodes] = True
    on_reflex_edge = on_reflex_edge[nodes]
    none = network.choice(np.empty(0, np.int32))
    network.lower(nodes[~on_reflex_edge], none, field, workers, nearest)
    hidden = nodes[on_reflex_edge | ((field.path < 0) & (h0 > lower))[nodes]]
    network.lower(hidden, network.sources(), field, workers)
    proved = (field.path >= 0) | (h0 <= lower)
    upper = spread(np.where(proved, lower, h0))
    proved |= np.isinf(upper)  # not reached by any source
    # Keep paths as short as those along edges of the mesh: they may continue over other edges.
    nearly_upper = upper + TIE * np.abs(upper) + 10.0 * network.g * solid.moved
    field.sizes[:] = np.where(proved, np.minimum(lower, upper), nearly_upper)
    hidden = nodes[~proved[nodes]]
    n_nodes = known.total(nodes)
    propagated = _is_dear(network, known.total(hidden), n_nodes)
    finished = True
    if not propagated:
        before = network.copied(), Field(*(array.copy() for array in field))
        is_over = len(hidden) > 0
        if is_over:
            finished, is_over = _solve_hidden(network, field, hidden, n_nodes, workers)
        # If the search of one rank is given up, that of all is.
        propagated = known.any(is_over)
        if propagated:
            finished = True
            network.paths, network.depth, network.origin = before[0]
            for array, old in zip(field, before[1], strict=True):
                array[:] = old
    if propagated:
        known.need_all_cells()
        if network.n_sources > 1:  # else it is known to be hidden from these nodes
            network.lower(hidden, network.sources(), field, workers)
        propagate_paths(known, network, field, proved)
    sizes = np.maximum(np.minimum(field.sizes, upper), lower)
    h = spread(np.where(sizes <= nearly, lower, sizes))
    return Found(h, sizes, finished, propagated)


def _is_dear(network: Network, n_hidden: int, n_nodes: int) -> bool:
    """Return whether paths are to be propagated, since the search would take too long."""
    return len(network.reflex_edges.obstacles) * n_hidden > _DEAR * max(n_nodes, _FEW)


def _solve_hidden(
    network: Network, field: Field, hidden: IntArray, n_nodes: int, workers: Workers
) -> tuple[bool, bool]:
    """Lower nodes (In/Out: field) from which their smallest source is not visible.

    Returns whether the iteration converged within _ROUNDS iterations, and whether it was given up,
    since there were too many paths.
    """
    most = _MOST_PATHS + _PATHS_PER_NODE * n_nodes
    reflex_nodes = network.reflex_edges.nodes
    network.lower(hidden, network.sources(), field, workers)
    order = np.flatnonzero(np.isin(reflex_nodes, hidden)).astype(np.int32)
    waiting = reflex_nodes[order]
    changed = np.flatnonzero(field.path[reflex_nodes] >= 0).astype(np.int32)
    fresh = np.arange(network.n_sources, dtype=np.int32)
    for _ in range(_ROUNDS):
        if len(changed) == 0 and len(fresh) == 0:
            break
        bases = network.set_reflex_nodes(changed, field.sizes[reflex_nodes[changed]])
        new = network.extend(np.concatenate([fresh, bases]), field)
        if len(network.paths.base) > most:
            return False, True
        changed = order[:0]
        if len(waiting):
            before = field.sizes[waiting]
            network.lower(waiting, network.choice(np.concatenate([bases, new])), field, workers)
            changed = order[before - field.sizes[waiting] > EQUAL * np.abs(before)]
        fresh = network.seen(new, workers) if len(new) else new
    rest = hidden[~np.isin(hidden, reflex_nodes)]
    network.lower(rest, network.alive(), field, workers)
    return len(changed) == 0 and len(fresh) == 0, False


def _origins(
    network: Network, field: Field, sizes: FloatArray, h: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return where paths come from, for those of ``sizes``.

    Returns
    -------
    entry : int32[n]
        The source at the origin of the path; -1 if not known, or if there is none.
    start : int32[n]
        As in `solve_in_solid`.
    bend : float64[n, 3]
        Last bend of the path, nan if it is straight.
    """
    paths = network.paths
    m = network.n_sources
    reached = np.flatnonzero(field.path >= 0)  # none if the bounds satisfy the limit
    base, bend = np.full(len(h), -1, paths.base.dtype), np.full_like(field.last, np.nan)
    base[reached] = network.origin[paths.base[field.path[reached]]]
    base[h < sizes * (1.0 - TIE)] = -1
    bent = reached[paths.edge[field.path[reached]] >= 0]
    bend[bent] = field.last[bent]
    entry = np.where(base < m, base, -1).astype(np.int32)
    reflex_nodes = np.append(network.reflex_edges.nodes, np.int32(-1))
    start = reflex_nodes[np.where(base < m, -1, base - m)].astype(np.int32)
    return entry, start, bend
