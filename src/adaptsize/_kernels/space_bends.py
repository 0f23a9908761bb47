"""Shortest paths over a chain of straight edges in space, by Newton's method."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean

#: Largest number of edges of a path.
LONGEST = 12


# Largest number of steps of Newton's method.
_STEPS = 8

# Lengths above the longest useful one by this factor are so despite rounding.
_ABOVE = 1.0 + 1e-12


class Edges(NamedTuple):
    """Straight reflex edges."""

    start: np.ndarray
    """float64[e, 3]"""
    along: np.ndarray
    """float64[e, 3]: unit vectors."""
    length: np.ndarray
    """float64[e]"""
    normals: np.ndarray
    """float64[e, 2, 3]: outward normals of the two faces."""


@lean
def _put_on_edge(edges, e, t, feet, level, i):
    for d in range(3):
        feet[level, d, i] = edges.start[e, d] + t * edges.along[e, d]


@lean
def length_between(feet, level, i):
    """Return the distance from feet[level] to feet[level + 1] of the path to point i."""
    square = 0.0
    for d in range(3):
        square += (feet[level, d, i] - feet[level + 1, d, i]) ** 2
    return math.sqrt(square)


@lean
def length_from(feet, last, i):
    """Return the length of the path from feet[last] to feet[0]."""
    total = 0.0
    for level in range(last):
        total += length_between(feet, level, i)
    return total


@lean
def _newton_step(edges, chain, feet, work, n, i, longest):
    """Put a step of Newton's method for the n bends of the path to point i into work[0].

    The Hessian of the length is tridiagonal.  work[1] and work[2] are its diagonal and
    off-diagonal; work[3] are the coordinates of the bends along their edges.

    Returns the length; inf if there is no step, or if the path, whose length is convex, remains
    longer than ``longest`` wherever it bends.
    """
    for level in range(1, n + 1):
        e = chain[level]
        work[0, level] = work[1, level] = work[3, level] = 0.0
        for d in range(3):
            work[3, level] += (feet[level, d, i] - edges.start[e, d]) * edges.along[e, d]
    total = 0.0
    for level in range(n + 1):  # the pieces from feet[level] to feet[level + 1]
        length = length_between(feet, level, i)
        if length == 0.0:
            return math.inf
        total += length
        near = far = cross = 0.0
        for d in range(3):
            unit = (feet[level + 1, d, i] - feet[level, d, i]) / length
            if level > 0:
                near += unit * edges.along[chain[level], d]
            if level < n:
                far += unit * edges.along[chain[level + 1], d]
            if 0 < level < n:
                cross += edges.along[chain[level], d] * edges.along[chain[level + 1], d]
        if level > 0:
            work[0, level] += near
            work[1, level] += (1.0 - near * near) / length
        if level < n:
            work[0, level + 1] -= far
            work[1, level + 1] += (1.0 - far * far) / length
            work[2, level + 1] = (near * far - cross) / length if level > 0 else 0.0
    least = total
    for level in range(1, n + 1):
        fall, t = work[0, level], work[3, level]
        least -= max(fall * (edges.length[chain[level]] - t), -fall * t)
    if least > longest * _ABOVE:
        return math.inf
    for level in range(1, n + 1):
        if level > 1:
            share = work[2, level] / work[1, level - 1]
            work[1, level] -= share * work[2, level]
            work[0, level] -= share * work[0, level - 1]
        if not work[1, level] > 0.0:
            return math.inf
    for level in range(n, 0, -1):
        if level < n:
            work[0, level] -= work[2, level + 1] * work[0, level + 1]
        work[0, level] /= work[1, level]
    return total


@lean
def straighten(edges, chain, feet, work, n, i, longest):
    """Move the n bends of the path to point i to where it is shortest.

    Stops early if the path cannot become shorter than ``longest``.
    """
    for _ in range(_STEPS):
        length = _newton_step(edges, chain, feet, work, n, i, longest)
        if length == math.inf:
            return
        share, new = 1.0, math.inf
        for _ in range(4):
            for level in range(1, n + 1):
                e = chain[level]
                t = min(max(work[3, level] + share * work[0, level], 0.0), edges.length[e])
                _put_on_edge(edges, e, t, feet, level, i)
            new = length_from(feet, n + 1, i)
            if new <= length:
                break
            share *= 0.25
        if new > length:
            for level in range(1, n + 1):
                _put_on_edge(edges, chain[level], work[3, level], feet, level, i)
        if new >= length * (1.0 - 1e-15):
            return
