"""What was tuned in the generator of implicit domains: values and evidence.

Half and double a value were not measured.  Lengths are in sizes, unless something else is stated.
"""

from collections.abc import Mapping

# Samples of the domain ----------------------------------------------------------------------------

#: Samples along the longest side of the box.  Narrower parts are found by the slope of phi.
FIRST: Mapping[int, int] = {2: 48, 3: 20}
#: Factor on the steepest slope between the samples: between them it may be steeper.
STEEPER = 1.1
#: Gradients shorter than this times the steepest slope are not used to locate the boundary.
FLAT_GRADIENT = 1e-3
#: Backward differences are tried where forward ones are shorter than this times the steepest slope:
#: a gradient that is too short by this factor would overshoot by 10 steps of the differences.
SHALLOW = 0.1
#: Sub-samples of a box at the boundary along each axis.
SUBSAMPLES: Mapping[int, int] = {2: 5, 3: 4}
#: Elements per node, and nodes at most over those of the elements allowed.
ELEMENTS_PER_NODE: Mapping[int, float] = {2: 2.0, 3: 5.5}
NODES_OVER_ALLOWED = 1.5
#: Intervals along the longest side of the box where its faces are sampled, and the allowed depth of
#: the domain there.
SAMPLES_OF_BOX, DEPTH_AT_BOX = 40, 0.5
#: Allowed distance of a fixed point from the domain.
FIXED_OUTSIDE = 0.01

# Relaxation ---------------------------------------------------------------------------------------

#: Target lengths are scaled up by this factor.  The pressure drives nodes to the boundary.
PRESSURE: Mapping[int, float] = {2: 1.15, 3: 1.1}
#: Range of the factor by which target lengths follow the median edge: the number of nodes
#: determines it.
SCALES = (0.9, 1.15)
#: Length of a step, in forces over the number of neighbours: below 2, neighbours that are pushed
#: against each other along one edge do not pass the place where the force ends.
STEP_PER_FORCE = 1.5
#: No node moves further in one step.
LONGEST_STEP = 0.25
#: Nodes are added and removed in every tenth of the first steps.
ADAPT_EVERY, ADAPT_UNTIL = 10, 60
#: Later steps are each shortened by this factor: where several triangulations are as good, nodes
#: would swing between them for ever.
SHORTENING = 0.985
#: Nodes are triangulated anew if this share of them has moved so far.
MOVED_SHARE, MOVED = 0.01, 0.1
#: Mean displacement per step at which the nodes have converged, and the first step at which this is
#: tested.
CONVERGED, FEWEST_STEPS = 2.5e-3, 36
#: Cells this deep in the domain at least are part of it.
INSIDE = 0.05
#: Nodes of the boundary closer to it than this are projected onto it, in so many Newton steps.
REACH_OF_BOUNDARY, STEPS_BACK = 0.5, 2

# New and removed nodes ----------------------------------------------------------------------------

#: Edges shorter or longer than this lose a node or get one at their midpoint.
TOO_SHORT, TOO_LONG = 0.6, 1.55
#: The same while nodes are missing, or there are too many.
SHORT_AND_LONG = (0.85, 1.15)
#: A point of the domain this far from all nodes gets a node.  In the ideal lattices no point is
#: further away than 0.61.
FAR_FROM_NODES = 0.85
#: Edges between boundary nodes run along the boundary if their middle is this near, in lengths.
ALONG = 0.2
#: A node this near to a corner is moved there; a node still nearer counts as there.
BRING_TO_CORNER, AT_CORNER = 0.5, 1e-4
#: Tangents are recomputed at this share of the distance from the corner, in so many rounds, at
#: points that are projected in so many Newton steps.
NEARER_CORNER, ROUNDS_OF_TANGENTS, STEPS_BESIDE_CORNER = 0.2, 3, 5
#: Tangents that meet this near to the boundary meet at a corner.
CORNER_OFF_BOUNDARY = 0.02
#: Cosine of the least angle between the normals beside a corner (40 degrees).
CORNER_COSINE = 0.77

# The mesh of the nodes ----------------------------------------------------------------------------

#: Rounds of triangulation and projection, of two usually needed; Newton steps of a projection.
ROUNDS_OF_FITTING, STEPS_OF_PROJECTION = 8, 20
#: Cells of lower quality are improved with their neighbours.
FLAT_CELL = 0.25
#: Cells of lower quality are improved.
BAD: Mapping[int, float] = {2: 0.6, 3: 0.45}
#: Passes of improvement, and rounds of swaps in each.
PASSES_OF_IMPROVEMENT, ROUNDS_OF_SWAPPING = 12, 10
#: Layers of neighbours that are moved, too, if nothing else helps; the first step of a move.
MOST_LAYERS, FIRST_STEP = 3, 0.2
#: Cosine of the angle between a facet and the boundary above which a node is at no edge or corner.
SMOOTH_COSINE = 0.8

# Interfaces between regions -----------------------------------------------------------------------

#: A node this far from its interfaces is not moved onto all of them.
REACH_OF_INTERFACES = 0.5
#: Interfaces whose normals are closer than this are treated as one, in singular values.
PARALLEL = 0.2
#: No label is shifted by more than this in one step, and in all, in pixels.
LABEL_STEP, MOST_LABEL_SHIFT = 1.0, 4.0
#: Measures are adjusted until they are this close, relative.
CLOSE_MEASURE = 2e-3
#: Differences of fields with less slope than this per pixel give no direction; for the shift of an
#: interface, the slope is at least the second.
SAFE_SLOPE, LEAST_SLOPE = 0.05, 0.5

# The report ---------------------------------------------------------------------------------------

#: Cells with a smaller angle (dihedral angle) are slivers, degrees.
SLIVER_ANGLE = 10.0
#: A sample point without a node within this distance is not covered.
UNCOVERED = 1.1
#: Nodes of different components this near are checked for a connection.
NEAR_COMPONENTS = 1.6
#: Mean displacement per step that is warned of.
STILL_MOVING = 0.03
#: Share of the measure of the domain that the mesh may miss or have in excess.  Tetrahedra with
#: edges of 0.6 radii miss 6 % of a ball.
MEASURE_OFF = 0.1
#: Distance of boundary nodes from the boundary that is warned of.
RESIDUAL = 0.05
