"""What was tuned in the measures of geometry: values, evidence, and what other values do.

``benchmarks/tuning.py`` measures the effect of half and double a value.  Errors are those of the
signed distance of an ellipse and an ellipsoid with axes of 2 and 1 on grids of 60 and 16 nodes per
axis, 8e-5 and 1e-3 spacings, and of the curvature of their zero levels, shares of 7e-5 and 2e-5.
"None" means that they are the same to two digits: these shapes have no kinks.  For rays, it means
that the numbers of elements in ``adaptsize/domain_size/tuning.py`` are.  Tolerances for rounding
and numbers of items between two progress reports are not tuned; they are at the head of their
files.
"""

import math

# Rays for the width.

#: Rays start on the edge between two facets beside it, in each of them, at this share of the height
#: of the triangle.  Half and double: none.
BESIDE_EDGE = 1.0 / 24.0
#: Facets that are longer than this share of their width have rays near their corners, too.
#: Half and double: none.
LONG_FACET = 0.27
#: Walls do not count if they are steeper to the ray than this, radians.  Not measured.
STEEPEST_WALL = math.radians(75.0)

# The zero level of a function.

#: Steps of differences, in spacings: of first derivatives, ...  Half and double: none.
STEP_OF_GRADIENT = 1e-3
#: ... and of second derivatives.  Half and double: none.
STEP_OF_CURVATURE = 3e-2
#: Steps of first derivatives over those of second ones, for curvatures.  Half and double: 2 %
#: more and 3 % less of the error of the curvature in the plane.
SHARE_OF_STEP = 1.0 / 30.0
#: Steps are adapted until the normal turns by about this angle on each of them, in radians, ...
#: Half: a quarter of the errors of the curvature.  Double: 1.6 and 3.9 times.
TURN = 0.1
#: ... to at least this share of the step at a time, ...  Half and double: none.
STEP_CHANGE = 1.0 / 8.0
#: ... at most so often, ...  Half and double: none.
MOST_CHANGES = 8
#: ... where it turns by more than so many such angles.  Not measured.
TOO_FAR = 1.5
#: The curvature is evaluated again with these shares of the step.  At a kink it grows, by more than
#: the factor below.  Beside a kink it falls.  Not measured.
SHARES_OF_STEP_AT_KINK = (0.25, 0.0625)
GROWTH_AT_KINK = 2.0
#: Iterates farther from the zero level, in spacings and in steps along it, first return to it.
#: Half and double: none.
OFF_LEVEL = 0.05
#: Penalty on the distance of an iterate from the zero level, so that iterates on it are preferred.
#: Not measured.
PENALTY = 2.0
#: Iterations for a closest point: smooth functions need 3 to 5, and at kinks there is no
#: convergence.  Not measured.
MOST_ITERATIONS = 15
#: Next to centres of curvature, steps along the zero level are enlarged at most by the reciprocal.
#: Not measured.
LEAST_CURVATURE_FACTOR = 0.25
#: A closest point is at a kink if derivatives jump by this share of the gradient.  Not measured.
JUMP_AT_KINK = 0.05
#: Distances from a kink, in spacings, at which the smooth pieces on its sides are searched for.
#: Not measured.
BESIDE_KINK = (0.1, 0.01, 1e-3, 1e-4)
#: Sine of the smallest angle between such pieces.  Not measured.
LEAST_ANGLE = 0.05
#: Distances from tangent parabolas count up to this distance from where these touch, in spacings.
#: Half and double: none.
REACH_OF_PARABOLA = 1.5

# Functions that may be signed distances.  None of these was measured.

#: Gradients whose length differs from 1 by more are not those of a distance to one place.
NOT_UNIT = 1e-3
#: Share of the points at which a signed distance has such a gradient: not at the medial axis.
SMOOTH = 0.9
#: A step along the gradient ends at the zero level up to this share of the step, ...
MISS = 1e-3
#: ... from this share of the points.
ARRIVING = 0.998

# Winding numbers, sheets and images.  None of these was measured.

#: Parts of a surface are expanded as a whole beyond this number of their radii.
FAR_IN_RADII = 1.5
#: Winding numbers are as exact as this: next to an open sheet they are close to a half.  Of a
#: surface with holes, numbers above a half and this are inside.
WINDING_ERROR = 0.05
#: A piece is a sheet, not a closed surface with holes, if the norm of the sum of its normals times
#: areas is above this share of its area.
SHEET = 0.1
#: Standard deviation of the low-pass filter for boolean images, in pixels.
LOW_PASS = 1.5

# The medial axis on grids.  None of these was measured.

#: Shortest gradient half way to the boundary, if there is no kink.
UNMIXED = 0.9
#: How far the point where a front comes from may be from the boundary, in spacings and as a share
#: of the path: farther if the gradient mixes several fronts.
FOOT_SPACINGS, FOOT_SHARE = 0.5, 0.05
#: Smallest turn of the boundary, in degrees, at a corner that is reported; at larger distances or
#: smaller turns, a smooth boundary looks like a corner.
LEAST_TURN = 20.0
#: Crossings up to this distance from the boundary, in spacings, are used to locate corners.
NEAR_CORNER = 12.0
#: A path along nodes is longer than a straight edge by up to 8 per cent, plus its ends.
DETOUR = 1.15

# The solid that a surface encloses.  Half and double were not measured.

#: Winding numbers are found at this distance from a facet, in the slack of contacts.
BESIDE_FACET = 2.0
#: Gaps narrower than this share of the diagonal are cracks between bodies that touch, where their
#: union could not be made.  Six digits of coordinates leave such gaps.
CRACK = 1e-5
#: A share of the area of the facets below which what is found on them does not count.  In a public
#: part, slivers that are folded by rounding have 4e-8; the tips of antlers that cross have 2e-6.
NEGLIGIBLE_AREA = 1e-6
#: Connected facets that meet no others have the same winding numbers, unless the share of the area
#: with other ones is larger than this.
MINORITY = 1e-3
#: The parts of a union leave gaps if the sum of their normals times areas is larger than this times
#: their area.  Parts that are lost by rounding give up to 1e-5.
GAP = 1e-4
#: In the opening of a surface, the absolute winding number is between these.
OPENING = (0.25, 0.75)
