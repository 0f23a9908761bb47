"""What is required of a cavity before a new node replaces it: lengths, facets and lines."""

import math

import numpy as np

from adaptsize._kernels.cavity import with_corner
from adaptsize._kernels.compiling import lean
from adaptsize._kernels.complexes import (
    FACETS,
    LINES,
    NONE,
    first_corner,
    has_node,
    next_corner,
    nodes_of,
    rows_with,
)
from adaptsize._kernels.envelope import INNER, closest_of, distance_of, nearest_in, normal_of
from adaptsize._kernels.local_mesh import (
    N_BEGUN,
    N_CELLS,
    N_FACES,
    N_FACETS,
    N_LINES,
    N_NODES,
    N_RIM,
    limit_of_edge,
    squared_length,
)
from adaptsize._kernels.vectors import dot, norm

#: Least cosine of the angle by which a facet may turn.
_LEAST_COSINE = 0.3


@lean
def _lengths_fit(mesh, cavity, new, shortest):
    """Return whether no edge at the node is too long, or shorter than a share of the size."""
    cx, points = mesh.cx, mesh.points
    longest2, shortest2 = 0.0, math.inf
    for k in range(cavity.counts[N_CELLS]):
        nodes = nodes_of(cx, cavity.cells[k])
        for v in range(4):
            for w in range(v):
                length2 = squared_length(points, nodes[v], nodes[w])
                longest2, shortest2 = max(longest2, length2), min(shortest2, length2)
    for f in range(cavity.counts[N_FACES]):
        nodes = nodes_of(cx, cavity.faces[f, 0])
        for v in range(4):
            if v == cavity.faces[f, 1]:
                continue
            length2, limit2 = (
                squared_length(points, new, nodes[v]),
                limit_of_edge(mesh, new, nodes[v]),
            )
            if length2 > max(limit2, longest2):
                return False
            if length2 < min(0.5 * shortest * shortest * limit2, shortest2):
                return False
    return True


@lean
def _ends_at(cx, cavity, node):
    """Return how many edges of the rim end at a node."""
    ends = 0
    for r in range(cavity.counts[N_RIM]):
        row, v = cavity.rim[r, 0], cavity.rim[r, 1]
        if node in (cx.nodes[row, (v + 1) % 3], cx.nodes[row, (v + 2) % 3]):
            ends += 1
    return ends


@lean
def _is_on_face(cx, cavity, r):
    """Return whether an edge of the rim is on a face of the cavity, so that new cells have it."""
    row, v = cavity.rim[r, 0], cavity.rim[r, 1]
    a, b = np.int64(cx.nodes[row, (v + 1) % 3]), np.int64(cx.nodes[row, (v + 2) % 3])
    for f in range(cavity.counts[N_FACES]):
        cell, w = cavity.faces[f, 0], cavity.faces[f, 1]
        opposite = np.int64(cx.nodes[cell, w])
        if opposite not in (a, b) and has_node(cx, cell, a) and has_node(cx, cell, b):
            return True
    return False


@lean
def _rim_is_simple(cx, cavity, simplex):
    """Return whether the rim passes each of its nodes once, and the ends of a divided edge.

    Each of its edges must be on a face: cells all around the border line of a facet inside of a
    region would leave the new facet there without a cell.
    """
    is_edge = cavity.counts[N_NODES] == 2
    for r in range(cavity.counts[N_RIM]):
        row, v = cavity.rim[r, 0], cavity.rim[r, 1]
        for w in range(3):
            node = np.int64(cx.nodes[row, w])
            if w == v or (is_edge and node in (simplex[0], simplex[1])):
                continue
            if _ends_at(cx, cavity, node) != 2:
                return False
        if not _is_on_face(cx, cavity, r):
            return False
    for k in range(2 if is_edge and cavity.counts[N_BEGUN] > 0 else 0):
        if _ends_at(cx, cavity, simplex[k]) != cavity.counts[N_BEGUN]:
            return False
    return True


@lean
def _is_listed(rows, n, row):
    found = False
    for k in range(n):
        found = found or rows[k] == row
    return found


@lean
def _is_sample_kept(mesh, cavity, s, new):
    """Return whether a sample of a facet of the cavity is near what comes instead."""
    cx, points, samples = mesh.cx, mesh.points, mesh.samples
    x = (samples.at[s, 0], samples.at[s, 1], samples.at[s, 2])
    label, reach2 = int(samples.at[s, 3]), samples.at[s, 4]
    for turn in range(2):
        for r in range(cavity.counts[N_RIM]):
            row, v = cavity.rim[r, 0], cavity.rim[r, 1]
            if turn == 0:
                if label >= 0 and cx.about[row, 0] != label:
                    continue
                a, b, c, _ = with_corner(cx, row, v, new)
                if closest_of(points, (a, b, c), x)[0] <= reach2:
                    return True
                continue
            corner = first_corner(cx, FACETS, np.int64(cx.nodes[row, (v + 1) % 3]))
            while corner >= 0:
                other = corner // 4
                corner = next_corner(cx, corner)
                if (label >= 0 and cx.about[other, 0] != label) or _is_listed(
                    cavity.facets, cavity.counts[N_FACETS], other
                ):
                    continue
                a, b, c, _ = nodes_of(cx, other)
                if closest_of(points, (a, b, c), x)[0] <= reach2:
                    return True
    return False


@lean
def _facets_fit(mesh, cavity, new, work):
    """Return whether the new facets are near the given ones, in both directions, and not turned."""
    cx, points, samples = mesh.cx, mesh.points, mesh.samples
    tolerance2 = samples.tolerance * samples.tolerance
    limit2 = tolerance2
    for k in range(cavity.counts[N_FACETS]):
        limit2 = max(limit2, samples.off2[cavity.facets[k]])
    label = cx.about[cavity.facets[0], 0]
    x = (points[new, 0], points[new, 1], points[new, 2])
    if nearest_in(mesh.surface, label, x, limit2, work.stack)[0] < 0:
        return False
    for r in range(cavity.counts[N_RIM]):
        row, v = cavity.rim[r, 0], cavity.rim[r, 1]
        i, j, k, _ = nodes_of(cx, row)
        a, b, c, _ = with_corner(cx, row, v, new)
        was, now = normal_of(points, i, j, k), normal_of(points, a, b, c)
        longest2 = max(
            squared_length(points, i, j), squared_length(points, j, k), squared_length(points, k, i)
        )
        if dot(was, was) > tolerance2 * longest2 and dot(was, now) < _LEAST_COSINE * norm(
            was
        ) * norm(now):
            return False
        label = cx.about[row, 0]
        if distance_of(mesh.surface, points, (a, b, c), label, INNER, limit2, work.stack) > 1e300:
            return False
    for k in range(cavity.counts[N_FACETS]):
        s = np.int64(samples.chain[cavity.facets[k], 0])
        while s >= 0:
            if not _is_sample_kept(mesh, cavity, s, new):
                return False
            s = np.int64(samples.chain[s, 1])
    return True


@lean
def _line_fits(mesh, simplex, new, work):
    """Return whether a line may be divided by the node."""
    cx, points, samples = mesh.cx, mesh.points, mesh.samples
    a, b, _, _ = simplex
    row = rows_with(cx, LINES, a, b, NONE)[1]
    label = cx.about[row, 0]
    limit2 = max(samples.tolerance * samples.tolerance, samples.off2[row])
    for end in (a, b):
        nodes = (end, new, NONE)
        if distance_of(mesh.curves, points, nodes, label, INNER, limit2, work.stack) > 1e300:
            return False
    s = np.int64(samples.chain[row, 0])
    while s >= 0:
        x = (samples.at[s, 0], samples.at[s, 1], samples.at[s, 2])
        one = closest_of(points, (a, new, NONE), x)[0]
        other = closest_of(points, (new, b, NONE), x)[0]
        if min(one, other) > samples.at[s, 4]:
            return False
        s = np.int64(samples.chain[s, 1])
    return True


@lean
def fits(mesh, simplex, new, shortest, work):
    """Return whether all that is required of the insertion holds for the cavity as it is."""
    cavity, cx = work.cavity, mesh.cx
    count = cavity.counts
    more = count[N_FACES] + count[N_RIM] - count[N_CELLS] - count[N_FACETS] + count[N_LINES]
    if cx.n_free[0] < max(more, 1) or not _lengths_fit(mesh, cavity, new, shortest):
        return False
    if count[N_FACETS] > 0 and not (
        _rim_is_simple(cx, cavity, simplex) and _facets_fit(mesh, cavity, new, work)
    ):
        return False
    return count[N_LINES] == 0 or _line_fits(mesh, simplex, new, work)
