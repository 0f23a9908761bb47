"""The width of the domain of a function, by rays that advance by the distance at a time."""

import math

import numpy as np

from adaptsize._defaults import CORNER_ANGLE
from adaptsize.geometry import tuning
from adaptsize.geometry.distance.closest_points import Boundary, Depths
from adaptsize.geometry.medial.fronts import Fronts, meet_at_corner
from adaptsize.typing import FloatArray, ProgressCallback


def width_within(
    boundary: Boundary, points: FloatArray, seen: Depths, extent: float, report: ProgressCallback
) -> FloatArray:
    """Return the width of the domain of a function at the closest points of its boundary.

    Rays run inwards along the normals there, each by the distance from the boundary at a time.
    Walls count as for `boundary_width`; they meet if the boundary follows their tangents to where
    these meet.

    Parameters
    ----------
    boundary : Boundary
    points : float64[n, dim]
        Around which the balls up to the closest points have no boundary inside.
    seen : Depths
        Of the points.
    extent : float
        Longer rays have the width inf.
    report : callable
    """
    starts, directions = seen.closest_points(points), -seen.outward
    along = np.maximum(seen.depth, 1e-6 * extent)
    hit = np.zeros(len(starts), np.bool_)
    # At equal distance from two parts of the boundary, the direction may be that to neither.
    going = np.flatnonzero(boundary.distance(starts) <= 1e-3 * along)
    # Rays that are still on their way then touch a wall without crossing it.
    for step in range(64):
        depth = boundary.seen_from(starts[going] + along[going, None] * directions[going]).depth
        hit[going] = (depth <= 1e-3 * along[going]) & (step > 0)
        along[going] += np.maximum(depth, 0.0)
        # A ray that begins outside, at the tip of a corner, has no width.
        going = going[~hit[going] & (along[going] < extent) & (depth > 0.0)]
        report("width", step / 64)
        if len(going) == 0:
            break
    at = np.flatnonzero(hit)
    starts, directions, reach = starts[at], directions[at], along[at]
    normals = boundary.seen_from(starts + (0.999 * reach)[:, None] * directions).outward
    facing = (directions * normals).sum(axis=1)
    radii = reach * facing / (1.0 + facing)
    middles, both = starts + radii[:, None] * directions, np.stack([-directions, normals], axis=1)
    fronts = Fronts(middles, radii, both, np.empty((len(at), 2), np.int64))
    counts = facing >= math.cos(tuning.STEEPEST_WALL)
    fronts, at, reach = fronts.taken(counts), at[counts], reach[counts]
    # Closest points are known to this distance, also at corners.
    corner = meet_at_corner(boundary.distance, 1e-5 * extent, fronts, CORNER_ANGLE)[0]
    widths = np.full(len(points), np.inf)
    widths[at[~corner]] = reach[~corner]
    return widths
