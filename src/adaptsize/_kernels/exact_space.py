"""The limited size in a solid that is not convex: paths over reflex edges of the boundary.

Shortest paths in a polyhedral domain are straight except for bends on *reflex* edges, at which the
domain fills more than a half space, and at nodes of these.  A *path* leads from its *base*, a
source or a node of a reflex edge with the size there, over a chain of reflex edges to a point x.
Turned about the last edge into the half plane opposite to x, the rest of the path is a
straight line: with f and r the place along the edge and the distance from it of the base as
turned, the *image*, and s and d those of x, the path is not shorter than

    ((s - f)^2 + (d + r)^2)^(1/2),  and bends at  t = (f d + s r) / (d + r).

The length is this one if all edges of the chain are in one plane pairwise; otherwise the bends
are improved in turn.  Sizes are computed from the actual pieces of the path, each of
which is tested for visibility (space_sight.py); no size is too small.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.exact import BLOCK, fill_values, gather
from adaptsize._kernels.local_updates import SPACE, WITH_BC, minimum_on_edge, minimum_on_triangle
from adaptsize._kernels.space_paths import (
    PATH_SLACK,
    beside_edge,
    in_sector,
    length_between,
    length_from,
    promise_of,
    straighten,
)
from adaptsize._kernels.space_sight import AHEAD, without_hidden, without_leaving
from adaptsize._kernels.trees import LEAF
from adaptsize._kernels.vectors import column, dot, minus, norm, triple, without

# Part of the ends of an edge that belongs to its nodes.
_END = 1e-12

# A place in an edge or triangle with less weight of a vertex lies opposite to it.
_AT_VERTEX = 1e-9

# Times that the start of a path on an edge or face is moved, at most.
_TURNS = 30


@lean
def _estimate(paths, w, x, count, g, slack, values):
    """Fill lower bounds of the sizes that a path over edges allows, inf where it does not act."""
    edges, e, f, r = paths.edges, paths.edge[w], paths.image[w, 0], paths.image[w, 1]
    start, along, length = triple(edges.start, e, 0), triple(edges.along, e, 0), edges.length[e]
    offset, skew, low, high = paths.offset[w], paths.skew[w], paths.part[w, 0], paths.part[w, 1]
    outward, one, other = (
        triple(paths.sector, w, 0), triple(paths.sector, w, 3), triple(paths.sector, w, 6),
    )  # fmt: skip
    for i in range(count):  # no branches and no division: this is vectorised
        p = minus(column(x, i), start)
        s = dot(p, along)
        d = norm(without(p, s, along))
        near = beside_edge(d, r, slack)
        served = dot(outward, p) <= slack
        served &= (dot(one, p) >= -near) | (dot(other, p) >= -near)
        t = f * d + s * r  # the bend, times d + r
        before, beyond = t <= low * (d + r), t >= high * (d + r)
        served &= (d > _END * length) & (skew | ~(before | beyond))
        # Earlier bends may move the last one into the edge; its part of the edge is a bound.
        c = low if before else high
        short = math.sqrt((s - f) * (s - f) + (d + r) * (d + r))
        clipped = math.sqrt((c - f) * (c - f) + r * r) + math.sqrt((c - s) * (c - s) + d * d)
        value = offset + g * (clipped if before | beyond else short)
        values[i] = value if served else math.inf


@lean
def _put_bends(paths, w, bends, level, active, m):
    """Set bends[level + 1] of path w, on its edge, for the paths to bends[level]."""
    edges, e, f, r = paths.edges, paths.edge[w], paths.image[w, 0], paths.image[w, 1]
    start, along, length = triple(edges.start, e, 0), triple(edges.along, e, 0), edges.length[e]
    for k in range(m):
        i = active[k]
        p = minus(column(bends[level], i), start)
        s = dot(p, along)
        d = norm(without(p, s, along))
        t = (f * d + s * r) / (d + r) if d + r > 0.0 else s
        t = min(max(t, 0.0), length)
        for axis in range(3):
            bends[level + 1, axis, i] = start[axis] + t * along[axis]


@lean
def _allowed(bases, base, work, g):
    """Return the size that an edge or face allows at work[0], and the weights of the minimum.

    ``work``: float64[4, 3], rows 1 to 3 the vertices.
    """
    axes, x, a = SPACE, np.int64(0), np.int64(1)
    sa, sb, sc = bases.table[base, 9], bases.table[base, 10], bases.table[base, 11]
    if bases.counts[base] == 2:
        value, t = minimum_on_edge(work, axes, x, (a, a + 1), (sa, sb), g)
        return value, t, 0.0
    corners = (a, a + 1, a + 2)
    return minimum_on_triangle(work, axes, x, corners, (sa, sb, sc), g, WITH_BC)


@lean
def _put_base(bases, base, level, m, g, faces, block):
    """Set the points of a base from which bends[level] are reached, and the sizes there.

    Only the points ``active`` are set.
    """
    bends, support, starts, work = block.bends, block.support, block.starts, block.work
    count = bases.counts[base]
    if faces is None or count == 1:
        for k in range(m):
            i = block.active[k]
            for d in range(3):
                bends[level + 1, d, i] = bases.table[base, d]
            starts[i] = bases.table[base, 9]
            for v in range(3):
                support[v, i] = bases.nodes[base, v]
        return
    for v in range(3):
        for d in range(3):
            work[1 + v, d] = bases.table[base, 3 * v + d]
    for k in range(m):
        i = block.active[k]
        for d in range(3):
            work[0, d] = bends[level, d, i]
        value, t, u = _allowed(bases, base, work, g)
        for d in range(3):
            place = work[1, d] + t * (work[2, d] - work[1, d])
            if count == 3:
                place += u * (work[3, d] - work[1, d])
            bends[level + 1, d, i] = place
        starts[i] = value - g * length_between(bends, level, i)
        found = 0
        support[1, i] = support[2, i] = -1
        for v in range(count):
            weight = 1.0 - t - u if v == 0 else (t if v == 1 else u)
            if weight > _AT_VERTEX:
                support[found, i] = bases.nodes[base, v]
                found += 1


@lean
def _lay(paths, w, m, g, faces, stars, block):
    """Construct a path to the points ``active``, and fill ``values`` with the allowed sizes.

    A value is inf if a bend is not inside its edge; the path through the node there is a separate
    path.  Returns the number of edges, and the number of points left, without those that the path
    clearly reaches from outside.
    """
    edges, bends, active = paths.edges, block.bends, block.active
    chain, starts = block.chain, block.starts
    n, last, zero = np.int64(0), w, np.int64(0)
    while paths.edge[last] >= 0:
        _put_bends(paths, last, bends, n, active, m)
        if n == 0 and not paths.skew[w]:
            m = without_leaving(stars, block.nodes, (bends, zero, zero + 1), active, m)
        n += 1
        chain[n] = paths.edge[last]
        last = np.int64(paths.parent[last])
    base = np.int64(paths.base[w])
    # The point of an edge or face where a path starts and the bends are moved in turn.
    times = _TURNS if n > 0 and paths.bases.counts[base] > 1 else 1
    for turn in range(times):
        _put_base(paths.bases, base, n, m, g, faces, block)
        moved = False
        for k in range(m if n > 0 and paths.skew[w] else 0):
            moved |= straighten(edges, chain, bends, n, active[k])
        if turn > 0 and not moved:
            break
    for k in range(m):
        i = active[k]
        block.values[i] = starts[i] + g * length_from(bends, n + 1, i)
    for level in range(1, n + 1):
        e = chain[level]
        for k in range(m):
            i = active[k]
            t = 0.0
            for d in range(3):
                t += (bends[level, d, i] - edges.start[e, d]) * edges.along[e, d]
            if not _END * edges.length[e] < t < (1.0 - _END) * edges.length[e]:
                block.values[i] = math.inf
    return n, m


@lean
def _without_edge_leaving(edges, e, bends, level, other, active, m):
    """Remove points from ``active`` whose piece from bends[level], on edge e, starts outside.

    The piece leads to bends[other].  Returns the number of points left.
    """
    left = 0
    for k in range(m):
        i = active[k]
        first = second = square = 0.0
        for d in range(3):
            step = bends[other, d, i] - bends[level, d, i]
            square += step * step
            first += edges.normals[e, 0, d] * step
            second += edges.normals[e, 1, d] * step
        if min(first, second) <= AHEAD * math.sqrt(square):
            active[left] = i
            left += 1
    return left


@lean
def _without_unseen(paths, w, n, m, sight, block):
    """Remove points from ``active`` if one of the n + 1 pieces of path w is hidden.

    Returns the number of points left.
    """
    bends, active = block.bends, block.active
    # Calls stand in loops, since LLVM copies the callee for each of them.
    nodes, first, last, path = block.support, n + 1, n, w
    # At the base, and at the points, where `_lay` has not done so.
    for _ in range(1 if n > 0 and not paths.skew[w] else 2):
        m = without_leaving(sight.stars, nodes, (bends, first, last), active, m)
        nodes, first, last = block.nodes, np.int64(0), np.int64(1)
    for level in range(1, n + 1):
        for step in range(-1, 2, 2):
            m = _without_edge_leaving(
                paths.edges, paths.edge[path], bends, level, level + step, active, m
            )
        path = np.int64(paths.parent[path])
    for level in range(n + 1):
        m = without_hidden(sight.walls, bends[level], bends[level + 1], m, block)
    return m


@lean
def try_path(paths, w, count, sight, g, faces, block):
    """Lower the points of a block by a path, where all of its pieces are visible."""
    active, sizes, values, x = block.active, block.sizes, block.values, block.bends[0]
    if paths.edge[w] >= 0:
        _estimate(paths, w, x, count, g, sight.walls.slack, values)
    else:
        base = np.int64(paths.base[w])
        fill_values(paths.bases.table, base, SPACE, x, count, g, values, values, None, None)
        if paths.bases.counts[base] > 1:
            for i in range(count):
                values[i] = -math.inf
    m = np.int64(0)
    for i in range(count):
        if PATH_SLACK * values[i] <= sizes[i]:
            active[m] = i
            m += 1
    if m == 0:
        return False
    n, m = _lay(paths, w, m, g, faces, sight.stars, block)
    wanted = np.int64(0)  # so that callees are not compiled for a literal, too
    for k in range(m):
        i = active[k]
        # Of several paths with the same size, the first one counts, in whatever order they come.
        if values[i] < sizes[i] or (values[i] == sizes[i] and w < block.path[i]):
            active[wanted] = i
            wanted += 1
    if wanted == 0:
        return False
    m = _without_unseen(paths, w, n, wanted, sight, block)
    for k in range(m):
        i = active[k]
        sizes[i], block.path[i] = values[i], w
        for d in range(3):
            block.last[d, i] = block.bends[1, d, i]
    return m > 0


@lean
def _first_tries(order, start, count, hints, recent, queue):
    """Fill ``queue`` with the paths to test first, each once: those of the last block, and hints.

    Returns their number; the last one is to be tested first.
    """
    n = np.int64(0)
    for k in range(recent.shape[0] + count):
        w = recent[k] if k < recent.shape[0] else np.int64(hints[order[start + k - BLOCK]])
        again = w < 0
        for before in range(n):
            again = again or queue[before] == w
        if not again:
            queue[n] = w
            n += 1
    return n


@lean_kernel
def lower_by_paths(order, span, paths, choice, hints, sight, g, field, faces, block):
    """Lower the sizes of nodes to the minimum over paths whose pieces are all visible.

    Without hints, the path of each node is the first of those that allow the minimum.

    Parameters
    ----------
    order : int32[k]
        The nodes to process, along a Morton curve.
    span : tuple of int
        First and last index of the part of ``order`` to process.
    paths : Paths
    choice : Choice
        The paths to test; if it is empty, only the hints are tested.
    hints : int32[n]
        A path that is tested first for each node, -1 for none.
    sight : Sight
    g : float64
    field : Field
        In/Out.
    faces : None or bool
        None if all bases are nodes; the code for edges and triangles is then not compiled.
    block : Block
    """
    stack, queue, recent = block.stack[0], block.queue, block.recent
    n_paths, n_leaves = choice.paths.shape[0], choice.boxes.shape[0] // 2
    for start in range(span[0], span[1], BLOCK):
        stop = min(start + BLOCK, span[1])
        count = stop - start
        gather(sight.stars.points, SPACE, order[start:stop], block.bends[0], block.box)
        queued = _first_tries(order, start, count, hints, recent, queue)
        for i in range(count):
            p = order[start + i]
            block.sizes[i], block.path[i], block.nodes[0, i] = field.sizes[p], -1, p
        stack[0], size = 1, 1 if n_paths > 0 else 0
        while queued > 0 or size > 0:
            if queued > 0:
                queued -= 1
                try_path(paths, queue[queued], count, sight, g, faces, block)
                continue
            size -= 1
            b = stack[size]
            if b < n_leaves:
                at_near = 0
                for child in range(2 * b, 2 * b + 2):
                    promise = promise_of(choice.boxes, child, block.bends[0], block.sizes, count, g)
                    if promise == 0:
                        continue
                    stack[size] = child
                    if 0 < promise <= at_near:  # the more promising one goes on top
                        stack[size - 1], stack[size] = child, child - 1
                    at_near = promise
                    size += 1
                continue
            leaf = b - n_leaves
            for k in range(leaf * LEAF, min(n_paths, (leaf + 1) * LEAF)):
                if in_sector(paths, choice.paths[k], block.box, sight.walls.slack):
                    queue[queued] = choice.paths[k]
                    queued += 1
        for i in range(count):
            recent[i] = block.path[i] if n_paths > 0 else -1
            if block.path[i] >= 0:
                p = order[start + i]
                field.sizes[p], field.path[p] = block.sizes[i], block.path[i]
                for d in range(3):
                    field.last[p, d] = block.last[d, i]


@lean
def _least_at(paths, w, i, g, faces, block):
    """Return a lower bound of the size that a path allows at point i of a block.

    It does not depend on whether the path is visible, and changes by at most g times a distance.
    """
    bends, work, e, base = block.bends, block.work, paths.edge[w], np.int64(paths.base[w])
    if e >= 0:
        p = minus(column(bends[0], i), triple(paths.edges.start, e, 0))
        along, f, r = triple(paths.edges.along, e, 0), paths.image[w, 0], paths.image[w, 1]
        s = dot(p, along)
        d = norm(without(p, s, along))
        t = (f * d + s * r) / (d + r) if d + r > 0.0 else s
        t = min(max(t, paths.part[w, 0]), paths.part[w, 1])
        return paths.offset[w] + g * (math.hypot(t - f, r) + math.hypot(t - s, d))
    if faces is not None and paths.bases.counts[base] > 1:
        for d in range(3):
            work[0, d] = bends[0, d, i]
            for v in range(3):
                work[1 + v, d] = paths.bases.table[base, 3 * v + d]
        return _allowed(paths.bases, base, work, g)[0]
    square = 0.0
    for d in range(3):
        square += (bends[0, d, i] - paths.bases.table[base, d]) ** 2
    return paths.bases.table[base, 9] + g * math.sqrt(square)


@lean_kernel
def list_extensions(places, order, ceilings, on_edge, paths, choice, g, faces, block, found):
    """List the paths that may allow less than given sizes at places on reflex edges.

    Parameters
    ----------
    places : float64[s, 3]
    order : int32[s]
        0, 1, ...
    ceilings : float64[s]
    on_edge : int32[s]
        The edge of each place.
    paths : Paths
    choice : Choice
        The paths to test.
    g : float64
    faces : None or bool
        As in `lower_by_paths`.
    block : Block
    found : int32[room, 2]
        Out: paths and places.

    Returns
    -------
    int
        Number of pairs, which may be more than there is room for.
    """
    stack, sizes = block.stack[0], block.sizes
    n_paths, n_leaves, n_found = choice.paths.shape[0], choice.boxes.shape[0] // 2, 0
    for start in range(0, places.shape[0], BLOCK):
        count = min(BLOCK, places.shape[0] - start)
        for i in range(count):
            sizes[i] = ceilings[start + i]
        gather(places, SPACE, order[start : start + count], block.bends[0], block.box)
        stack[0], size = 1, 1 if n_paths > 0 else 0
        while size > 0:
            size -= 1
            b = stack[size]
            if b < n_leaves:
                for child in range(2 * b, 2 * b + 2):
                    if promise_of(choice.boxes, child, block.bends[0], sizes, count, g) > 0:
                        stack[size] = child
                        size += 1
                continue
            leaf = b - n_leaves
            for k in range(leaf * LEAF, min(n_paths, (leaf + 1) * LEAF)):
                w = np.int64(choice.paths[k])
                for i in range(count):
                    if paths.edge[w] == on_edge[start + i]:
                        continue
                    if _least_at(paths, w, i, g, faces, block) < sizes[i]:
                        if n_found < found.shape[0]:
                            found[n_found, 0], found[n_found, 1] = w, start + i
                        n_found += 1
    return n_found


@lean_kernel
def find_starts(bases, which, x, g, block, places, sizes, nodes):
    """Fill the points of edges and faces that allow least at points, and the sizes there.

    Parameters
    ----------
    bases : Bases
    which : int32[k]
        Edges or faces.
    x : float64[k, 3]
    g : float64
    block : Block
    places, sizes : float64[k, 3], float64[k]
        Out.
    nodes : int32[k, 3]
        Out: the nodes around each point, padded with -1.
    """
    work = block.work
    for k in range(which.shape[0]):
        base = np.int64(which[k])
        for d in range(3):
            work[0, d] = x[k, d]
            for v in range(3):
                work[1 + v, d] = bases.table[base, 3 * v + d]
        value, t, u = _allowed(bases, base, work, g)
        square = 0.0
        for d in range(3):
            places[k, d] = work[1, d] + t * (work[2, d] - work[1, d])
            if bases.counts[base] == 3:
                places[k, d] += u * (work[3, d] - work[1, d])
            square += (places[k, d] - x[k, d]) ** 2
        sizes[k] = value - g * math.sqrt(square)
        found = 0
        nodes[k, 1] = nodes[k, 2] = -1
        for v in range(bases.counts[base]):
            weight = 1.0 - t - u if v == 0 else (t if v == 1 else u)
            if weight > _AT_VERTEX:
                nodes[k, found] = bases.nodes[base, v]
                found += 1
