"""Walls that hold a ball in a corner: cells that meet the tangent plane at a probe in an edge.

One such wall does not stop a ball, since it would roll along the corner.  Walls on all sides do.
Walls are kept by their direction around the normal at the probe, the nearest of each direction, as
rows of an array float64[k, 6]: radius at which the ball meets the wall, inf if there is none;
direction of the wall, 0 to 2 pi; point where the ball meets it; cotangent of half the angle in
the corner.  Rows are sorted by direction.
"""

import math

from adaptsize._kernels.compiling import inner

# Number of directions around a probe.
N_DIRECTIONS = 12
# A radius counts as smaller below this share of another one.  Cells that the ball touches at a
# common node have the same radius but for rounding; the first one counts.
SMALLER = 1.0 - 1e-9


@inner
def radius_between(held, last, widest):
    """Return the radius of the ball on the tangent plane that fits between two walls.

    A ball at p meets a wall at a distance s = r cot(a / 2) of p from a corner of angle a.  One
    that rolls away from p meets two opposite walls where r is the mean of both radii, weighted by
    the cotangents.

    Parameters
    ----------
    held : float64[k, 6]
    last : int
        What that returned; the other wall is the nearer one most opposite to it.
    widest : float64
        Less than 2 pi - ``widest`` apart are no opposite walls.

    Returns
    -------
    float64
        The radius of the last wall if none is opposite.
    """
    best = 2.0 * math.pi - widest - 1e-5
    radius = held[last, 0]
    for k in range(held.shape[0]):
        if SMALLER * held[k, 0] <= held[last, 0]:
            apart = abs(held[k, 1] - held[last, 1])
            apart = min(apart, 2.0 * math.pi - apart)
            if apart > best:
                best = apart
                total = held[k, 5] + held[last, 5]
                radius = (held[k, 5] * held[k, 0] + held[last, 5] * held[last, 0]) / total
    return radius


@inner
def holding_wall(held, widest):
    """Return the last of the walls that leave no gap between them that is too wide.

    Parameters
    ----------
    held : float64[k, 6]
    widest : float64
        Gap between the directions of neighbouring walls that is not too wide.

    Returns
    -------
    int
        That with the largest radius of the nearest walls that do; -1: there are none.
    """
    best = math.inf
    last = -1
    for i in range(held.shape[0]):
        if held[i, 0] >= SMALLER * best:
            continue
        # All walls up to this radius, from the last one around to the first.
        before = math.inf
        largest = 0.0
        for k in range(2 * held.shape[0]):
            j = k % held.shape[0]
            if SMALLER * held[j, 0] <= held[i, 0]:
                direction = held[j, 1] + (2.0 * math.pi if k >= held.shape[0] else 0.0)
                if not math.isinf(before):
                    largest = max(largest, direction - before)
                before = direction
        if largest <= widest:
            best = held[i, 0]
            last = i
    return last


@inner
def tangents(n):
    """Return two unit vectors that are perpendicular to a unit vector and to each other."""
    if abs(n[2]) < 0.9:  # in the plane, n[2] = 0, the second one is the normal of the plane
        length = math.hypot(n[0], n[1])
        a = (-n[1] / length, n[0] / length, 0.0)
    else:
        length = math.hypot(n[1], n[2])
        a = (0.0, -n[2] / length, n[1] / length)
    b = (
        n[1] * a[2] - n[2] * a[1],
        n[2] * a[0] - n[0] * a[2],
        n[0] * a[1] - n[1] * a[0],
    )
    return a, b


@inner
def add_wall(held, direction, radius, x, y, z, cotangent):
    """Add a wall unless there is a nearer one of its direction; return whether it was added."""
    k = min(int(direction * N_DIRECTIONS / (2.0 * math.pi)), N_DIRECTIONS - 1)
    if radius >= SMALLER * held[k, 0]:
        return False
    held[k, 0], held[k, 1] = radius, direction
    held[k, 2], held[k, 3], held[k, 4] = x, y, z
    held[k, 5] = cotangent
    return True
