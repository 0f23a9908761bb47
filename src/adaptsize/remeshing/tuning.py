"""What was tuned in the remeshing of meshes: values, evidence, and what other values do.

The effect of half and double the value is that on three meshes with a tolerance of 1e-3: a disc
whose sizes grow off a point, 757 cells, 97 % of the edges in the band, 1.95 tolerances off the
boundary; a ring filled with tetrahedra, 10 018 cells, 94 %; the tetrahedra of a ball whose sizes
grow along it, 4 081 cells, 72 %, .69 tolerances (``benchmarks/tuning_of_remeshing.py``).  Where an
effect is stated, the meshes that are not named stay the same.  Values without a stated effect were
not varied.  Those of `distmesh` are in a file of its own.  Tolerances for rounding stand at the
head of the files that need them.
"""

from collections.abc import Mapping

# Mmg ----------------------------------------------------------------------------------------------

#: Ridge angle in degrees, by task.  20 keeps the area of plane domains.  30 detects the shallow
#: feature edges of parts, which Mmg's default of 45 rounds off, and not the facets of coarse
#: surfaces.  Half: .97 times as many cells in the ball, .84 tolerances off.  Double: none, as
#: these meshes have no feature edges.
RIDGE_ANGLE: Mapping[str, float] = {
    "tetrahedra": 30.0,
    "plane triangles": 20.0,
    "surface": 30.0,
}
#: Mmg's ``hausd`` over the tolerance, by task.  In space, Mmg divides edges whose middle is farther
#: than that from the tangent planes at their ends, which is twice the distance from an arc.  With
#: 1.6, sizes for the tolerance are followed, and larger ones reduced.  On closed parts the measured
#: distance was .9 to 1 tolerances; with 1, there were up to 1.5 times as many elements.  In the
#: plane, with sizes too large for the tolerance, it was up to 1.5 times ``hausd`` on circles.  With
#: a factor of 1.6 it was up to 7 times, and with .7 a notch of coarse arcs was rounded farther.
#: Half: the disc .94 tolerances off with .96 times as many cells, the ball 1.21 times as many with
#: 58 % in the band.  Double: the disc 2.4 tolerances off, the ball .81 times as many with 84 %.
HAUSD: Mapping[str, float] = {"tetrahedra": 1.6, "plane triangles": 1.3, "surface": 1.6}
#: The same for a volume whose surface has the requested sizes already.  Half and double: none.
HAUSD_OF_ADAPTED = 1.6
#: The same in the two runs on a surface.  With twice the tolerance, Mmg divides the edges that
#: leave more than the tolerance.  With 1.2 in the second run and in the volume, the sizes of
#: `size_function` were not the only ones that counted, and the measured distance was .7 to .9
#: tolerances instead of .85 to .95.  Half and double: none, as the ring has few facets, which are
#: kept.
HAUSD_ON_SURFACE = (2.0, 1.6)
#: Factor of the sizes in the first run on a volume whose surface has the requested sizes: edges
#: come out shorter by this.  Half: 1.18 times as many cells in the ring, 92 % in the band.  Double:
#: .91 times as many.
FACTOR_OF_ADAPTED = 1.06
#: Runs of Mmg at most.  It reads sizes at the nodes of its input: if that is coarse, they are read
#: again on the new mesh.  Half and double: none.
TURNS = 3
#: The same with a metric: cells of the input are farther from the requested ones.
TURNS_WITH_METRIC = 6
#: Beside facets that must stay, another run follows only if this one has brought so many more edges
#: into the band.  Not measured.
GAINED_BESIDE_REQUIRED = 0.02
#: Limit of Mmg's memory for tetrahedra, in megabytes, and how much more each of the present and
#: requested cells adds.  Mmg sets up arrays that fill what it may use: a run on 384 cells takes
#: 0.11 instead of 0.51 s.  A cell needs about 0.001 at most.  Half and double: the same meshes.
MEGABYTES, MEGABYTES_PER_CELL = 150.0, 0.005
#: From so many cells on, the default is left.  Not measured.
CELLS_WITH_LIMITED_MEMORY = 200_000.0
#: Share of edges in the band, and of requested elements, with which no other run follows.  Half:
#: none.  Double, which is never reached: 98 % in the band of the disc.
GOOD_SHARE = 0.9
#: Largest factor by which the sizes of the next run are corrected.  Mmg does not change edges
#: within sqrt 2 of the requested length, which may shift their median.  Half and double: none.
CORRECTION = 1.1
#: The same between the two runs on a surface: the first, on triangles of all shapes, makes too
#: many, and the more the smaller its ``hausd``.  Half and double: none.
CORRECTION_ON_SURFACE = 1.25
#: Gradation of Mmg's own sizes at curved boundaries, as abs(grad h): the steepest of the requested
#: sizes, at least the first and at most the second.  Half of the first: 1.07 times as many cells in
#: the ball, 66 % in the band; the disc 2.1 tolerances off.  Double: .84 times as many, 82 %, .75
#: tolerances off.  A larger one than the second has no effect.
LEAST_GRADIENT, LARGEST_GRADIENT = 0.25, 3.0
#: Nodes of two edges are corners where a smooth curve would bulge by more than this share of the
#: tolerance.  Half and double: none.
BULGE = 0.2
#: Edges, or cells, after which a sample of them is enough: shares are then known within .005.
SAMPLE = 20_000

# Metrics in steps ---------------------------------------------------------------------------------

#: Share of the elements of a metric that may be missing because cells are too large.
MISSING = 0.2
#: Factor between the least sizes of two steps, at most.  With it, all of 12 layers in the plane
#: that begin with 1e-3 to 1e-5 of the domain were made.
FACTOR_OF_STEP = 10.0
#: Runs of one step, the second only if the first does not serve it.  Steps end if it is no better,
#: and more than this share is missing: the next ones find nothing to build on.
TURNS_OF_STEP, LOST = 2, 0.5
#: Edges of tetrahedra over the least size beyond which steps come first.
EDGE_OVER_LEAST_SIZE = 1000.0
#: Least sizes over the extent of the domain that steps reach.  In the plane, Mmg removes cells that
#: are thinner again, whatever their length.  In space and on surfaces no such limit has been met:
#: least sizes of 1e-4 were reached, and the number only ends the steps.
FINEST: Mapping[str, float] = {"plane triangles": 1e-5, "tetrahedra": 1e-7, "surface": 1e-7}

# Meshes that carry the sizes ----------------------------------------------------------------------

#: Nodes up to which a mesh is divided for a generator.  It then has about a quarter of the nodes of
#: the new mesh in the plane and an eighth in space, so that this is enough for millions.
MOST_NODES_FOR_GENERATORS = 500_000
#: Longest edge of cells over the size where this is not linear, as at a source.  Of 16 points and
#: curves in the plane and in space, 2 served 73 % of the requested elements, 1 served 92 %.  Half:
#: none.
EDGE_OVER_SIZE_FOR_GENERATORS = 1.0
#: Nodes of a first volume, above which it is not divided further.
MOST_NODES_OF_VOLUME = 1_000_000
#: Sizes may rise along an edge by g times its length and this share.
STEEP = 1e-3

# fTetWild -----------------------------------------------------------------------------------------

#: Spacing of the background of fTetWild over the diagonal, its nodes at most, and its margin
#: around the part over the diagonal.
SPACING, MOST_SAMPLES, MARGIN = 1.0 / 15.0, 150_000, 0.05
#: Edge length over the diagonal if no size is given: fTetWild's default.
EDGE_LENGTH = 0.05
#: fTetWild starts with edges up to about this over the diagonal, and makes longer ones only if
#: coarsening is enabled.  Coarsening may leave the envelope: one part deviated by 4.5e-3 of the
#: diagonal instead of 6e-4.  Therefore it is enabled only where it is needed.
COARSENED = 1.0 / 12.0
#: Tolerances within which the centroid of a cell may be on the wrong side of a surface whose facets
#: cross: that of the faces of cells, and as much again.
BESIDE_ENVELOPE = 2.0

#: Energy of the worst cell at which fTetWild ends: its default, and on a surface that was rough.
#: Beside sharp edges that are closer than the sizes, the worst cell of a thread stayed above 50 for
#: 13 passes, while fTetWild refined there: to 890 000 cells after 28 passes, which took 518 s of
#: processor time instead of 52.  Small angles are repaired afterwards.  With 30 for other surfaces,
#: 66 to 81 % instead of 83 to 84 % of the edges were in the band on three of four parts, as
#: fTetWild ended before the cells had the sizes.
STOP_ENERGY, STOP_ENERGY_OF_ROUGH = 10.0, 30.0

# Netgen and Gmsh ----------------------------------------------------------------------------------

#: Seconds of processor time of Netgen for a surface, and for each of its triangles.  Most closed
#: parts needed less than .3 ms per triangle.
SECONDS, SECONDS_PER_TRIANGLE = 5.0, 1e-3
#: Cells that a first volume requires over those that were predicted, above which this is reported.
MANY_MORE = 1.5
#: Facets that Mmg makes of a surface over those that were predicted, above which another generator
#: is tried, if so many of the facets are beside sharp edges.  On closed parts the first were .8 to
#: 1, on coarse ones 1.7, and on threads, whose sharp edges are closer than the sizes, 1.8 to 4.9.
MANY_MORE_FACETS, MANY_RIDGES = 2.0, 0.25
#: Sizes of triangles of CAD models over the diagonal: the least, since at the tip of a cone the
#: radius is 0 and Gmsh would not end, and the largest by default.
LEAST_OF_CAD, LARGEST_OF_CAD = 1e-4, 0.1

# Parts on several processes -----------------------------------------------------------------------

#: Parts are divided anew in the end if one has more cells than the mean times this.
IMBALANCE = 1.2
#: Layers of cells by which interfaces move between two rounds: cells as far as 2 to 3 layers from
#: an interface suffer from its frozen facets.
LAYERS = 5

# Warnings -----------------------------------------------------------------------------------------

#: Share of a wall on which the first layer must have the requested height.
SHARE_OF_WALL = 0.9
#: Warnings of one mesh about requests that are not served.
MOST_WARNINGS = 5
#: Edges of the boundary shorter than this times the size are details of it, if there are that many.
DETAIL, FEW_DETAILS = 0.125, 5

# Surfaces that cross themselves -------------------------------------------------------------------

#: Where facets cross, nodes are moved onto the given surface where no triangle gets a smaller
#: quality than the last number.  While facets still cross, edges up to these shares of the
#: tolerance are collapsed in so many rings around.  On four public parts of thin walls, 6, 14, 3
#: and 17 facets crossed: the moves were enough for three, the last share for the other, as without
#: rings.  With each share in turn on all that crossed at first, that one lost 64 facets instead of
#: 28, and details a tenth larger than the tolerance.  With a quality of .2, moves were not enough
#: for two of the three.
COLLAPSED_AT_CROSSINGS, RINGS_AT_CROSSINGS, QUALITY_AT_CROSSINGS = (0.25, 0.5, 1.0), 2, 0.01
#: Where facets of an adapted surface still cross, it is made again with this share of the sizes
#: there, which grow by so much per length, up to so many times.  A public part of thin walls needed
#: five more surfaces and 7 % more facets; with shares of .3 and .1 two, and 38 %.
SIZE_AT_CROSSINGS, GROWTH_OFF_CROSSINGS, MORE_SURFACES = 0.5, 0.25, 6
#: Depth of a crossing over the diagonal, up to which it is rounding of what was computed.  Netgen
#: fails where facets cross by 5e-7.
SLACK_OF_ADAPTED = 1e-10
#: Facets that cross others up to which this is tried.  The shaft began with 662.
MOST_CROSSINGS = 1000

# Details of surfaces ------------------------------------------------------------------------------

#: Shares of the length: how far a loop may be from a plane; how far points may be from it to be in
#: the plane; spacing of points on loops, and of those that are tried as centres of balls.
FLAT, IN_PLANE, SPACING_ON_LOOP, SPACING_IN_GRID = 0.25, 1e-3, 1.0 / 8.0, 1.0 / 6.0
#: Largest numbers of such points.
MOST_ON_LOOP, MOST_IN_GRID = 20_000, 200_000
#: Share of the cube of the length below which a detail has no volume.
NO_DETAIL = 1e-6

# Bodies and holes of surfaces ---------------------------------------------------------------------

#: Pairs of bodies that are examined for overlaps in common planes, and for small distances; points
#: of a body that are examined for being inside another one; pairs that are named.
MOST_PAIRS, MOST_POINTS_OF_BODY, MOST_NAMED = 200, 2000, 3
#: Surfaces with more bodies than this are not examined for bodies that nearly touch.
MOST_BODIES = 2000
#: Loops of more edges are divided; the triangulation costs the cube of their number.
MOST_EDGES_AT_ONCE = 96
#: Weight of the squared perimeter beside the area: of equal areas, compact triangles.
WEIGHT_OF_PERIMETER = 1e-6
#: Sharp edges lower than the tolerance, over the facets, from which on a rough surface is made
#: smooth, and the shares of the tolerance for that; the second if facets cross with the first.  Of
#: 37 public parts, the roughest has .08; of 100 generated ones, those with a screw of twisted
#: facets have .2 to 1.  Within .3, .5 and .8 tolerances, one of these kept 1 582, 838 and 946 of
#: 7 141 sharp edges.
LOW_EDGES, SMOOTHED_WITHIN = 0.1, (0.5, 0.3)
#: Longest edges of a surface that is made smooth, over its diagonal.
LONGEST_OF_SMOOTHED = 0.07
#: Caps of holes over the area of a surface at most: with more, as at a box without its lid, a user
#: decides whether it is closed.  Not varied.
MOST_OF_CAPS = 0.1
#: A body whose volume is less than this times its area and its diagonal encloses nothing.
NO_VOLUME = 1e-6

# Straight edges -----------------------------------------------------------------------------------

#: Nodes are on a line if they are closer to it than this times the diagonal.
ON_LINE = 1e-9
#: Least quality of a cell around a node that is moved, or new, unless it was lower before.
LEAST_QUALITY = 0.2
#: Rounds in which single moves are taken back, before all are.
ROUNDS_OF_TAKING_BACK = 8
#: Triangles in space that are moved, or that keep their height beside one that is removed, may turn
#: by no more than the angle of this cosine.
LEAST_COSINE = 0.5

# Surfaces for generators --------------------------------------------------------------------------

#: Triangles of less height than these shares of the tolerance are removed, in two attempts; with
#: less height than the third share of the smallest size, where that is lower.
THINNEST, SLIVER_OVER_SIZE = (0.2, 0.02), 0.1
#: Edges are ridges where a smooth surface would bulge by more than this share of the tolerance;
#: than the second, if more than half of the bent edges would then be ridges.
BULGE_AT_RIDGE, BULGE_IF_MOST_ARE_RIDGES = 0.5, 0.25
#: Edges of a surface over the size, and of facets beside ridges, up to which they are not divided.
EDGE_OVER_SIZE_ON_SURFACE, EDGE_OVER_SIZE_AT_RIDGE = 4.0, 2.0
#: Triangles of a surface at most, by division.
MOST_TRIANGLES = 400_000
#: Ridges closer than this share of the size are too close for good cells between them.
BETWEEN_RIDGES = 0.3

# Nodes and edges that left the boundary -----------------------------------------------------------

#: What is farther away than this share of the tolerance is brought nearer, and the repair that
#: follows keeps to it.  The rest is for the places between those that the repair looks at.
AIM = 0.9
#: Steps before a repair at most, and how many of them in a row may bring nothing nearer.  Without
#: any, a scan, a union of bodies and a CAD part stayed 1.18, 1.25 and 1.76 tolerances away.
STEPS_BEFORE_REPAIR, STEPS_IN_VAIN = 10, 2
#: Nodes farther from the old surface than this share of the tolerance are projected, unless a cell
#: becomes worse than the least quality.
OFF_BOUNDARY = 0.5
#: With a larger share of the nodes beyond the tolerance, the generator has made another surface.
MOST_NODES_BEYOND = 0.2
#: The least quality in later rounds, after which the worst cells are repaired again: the next one
#: once a round brings nothing nearer.  On a scan and on a CAD part, single edges stayed 1.7 and 1.9
#: tolerances away with `LEAST_QUALITY` only.
LATER_QUALITIES = (0.05, 0.01, 0.002)
#: Angle in degrees of cells of the quality 1 in these rounds, where nodes are inserted in facets.
#: Half and double: not measured.
ANGLE_OF_QUALITY = 200.0
#: First rounds at most, each without the places around facets that cross after the ones before.  On
#: a public part, the second was enough.
FIRST_ROUNDS = 3
#: Later rounds at most.
MOST_LATER_ROUNDS = 12
#: A round that leaves more than this share of what is beyond the tolerance is the last one with its
#: quality: on a sheet, five of ten rounds had brought less than 2 % nearer each.
LITTLE_NEARER = 0.9
#: If another mesh may follow, rounds end where the first one has brought a place farther away than
#: these tolerances no nearer.  On a sheet, by Mmg, such a place stayed 4.9 tolerances away;
#: of six meshes that came within the tolerance, all places were within 3.0 before.
HOPELESS = 3.0
#: If none may follow, they end there for such a place beyond these: nothing makes that mesh meet
#: the tolerance.  On a public part such a place stayed 43 tolerances away, and rounds took 80 s;
#: with 10, a wedge that fTetWild had cut by 10.5 stayed so.
LOST_FOR_GOOD = 20.0
#: A round is not kept if the smallest angle is below the first number, in degrees, and below the
#: second times the one before.  With 1 as the second, a loss of less than .01 degrees undid the
#: round that brought a wedge from 1.6 to .9 tolerances.
FLAT_ANGLE, LITTLE_FLATTER = 10.0, 0.95
#: Facets are not divided if more than this share of them is beyond the tolerance.
MOST_FACETS_BEYOND = 0.3
#: A target with more than this weight at a corner of a facet moves that, and one with less than
#: this weight opposite to an edge divides that; others divide the longest edge.  Each is served in
#: that way that brings most nearer.
WEIGHTS_OF_CORNERS = ((0.85, 0.15), (0.6, 0.15))
#: Nothing is changed again in this many lengths of a cell around one that has become flat.
AROUND_FLAT = 1.5

# Repair of the worst cells ------------------------------------------------------------------------

#: Angles in degrees below which cells are improved, by the kind of the mesh: the dihedral angles of
#: tetrahedra and the angles of triangles.
GOAL: Mapping[str, float] = {"tetrahedra": 20.0, "surface": 25.0, "plane triangles": 25.0}
#: Angles below which sharp edges may be cut off.  With 10 for tetrahedra, a CAD part kept 25 cells
#: below 15 degrees and a scan 3; with 15.5, none, as on 17 meshes of 11 parts.  With larger
#: ones, edges of boxes lost what a later loop then missed, for cells that were no worse than usual.
LAST_GOAL: Mapping[str, float] = {"tetrahedra": 15.5, "surface": 10.0}
#: Rings of cells around the bad ones in which a repair knows sizes and the given boundary.  The
#: repair of a cell goes about three edges far: a thread and a public part of 41 000 cells are
#: repaired as with a hundred rings.  With one to three rings, the part still is; with none, not.
RINGS_OF_REPAIR = 5
#: Angle in degrees by which a feature edge turns at a corner.
TURN_AT_CORNER = 40.0
#: Cells that are examined at most, over the number of bad ones.
CELLS_PER_BAD_CELL = 40
#: Angle in degrees below which nodes are inserted in tetrahedra that nothing else improves; and
#: the share of the nodes, and number, that may be added at most.  With nodes, a CAD part of 41 000
#: cells has 25 cells below 15 degrees instead of 59 before sharp edges may be cut off, a scan 3
#: instead of 4.  Up to 20: 20 and 3, with .5 % more cells.  Half and double of the room: none.
INSERTED_BELOW, ADDED_NODES = 16.0, (0.02, 64)
#: Room for cells and facets per node that may be added: 6.6 to 7.2 are needed where all are used.
ROWS_OF_NODE = 8
#: Edges of the given surface are halved for samples while they are longer than this times the
#: shortest edge of the new simplex nearest to their middle, or the tolerance, and so many times at
#: most.  On a thread with a wedge by fTetWild, 1, 1/2 and 1/4 of the longest edge left 1.36, 1.02
#: and 1.03 tolerances; on a sheet with one of 10 degrees, 1/2 of the longest 1.15.
SPACING_ON_EDGE, MOST_HALVINGS = 0.5, 12
#: Given facets have the direction of new ones if this share agrees, of those whose normals are
#: parallel up to the angle of this cosine.
AGREEING, CLEAR_COSINE = 0.95, 0.5

# Acceptance ---------------------------------------------------------------------------------------

#: Cells with a smaller dihedral angle, in degrees, are flat.
LEAST_DIHEDRAL = 2.0
#: Distances of a boundary over the tolerance that are warned of.  Mmg on a first volume by fTetWild
#: reaches 4 times the tolerance, everything else less.
FARTHEST_BOUNDARY = 4.0
#: Share of the facets up to which facets beyond the tolerance are a fault of the generator, and not
#: of sizes that are too coarse.  On a CAD part and a lattice by Mmg, 11 and 6 of 18 000 were.
FEW_FACETS_OFF = 0.01
#: A boundary farther away than this share of the diagonal and than so many tolerances is another
#: one.  Coarse sizes and cut corners give less.
OTHER_BOUNDARY, MOST_TOLERANCES = 0.05, 10.0
#: A domain whose area or volume differs by more than this share is another one, unless a boundary
#: moved by the tolerance changes it by more.
OTHER_MEASURE = 0.25

# Attempts and their limits ------------------------------------------------------------------------

#: Elapsed time of a generator over its processor time at most, times the processes that compete for
#: each core.  The latter limits generators where the system can do that, so that a busy machine
#: makes the same mesh: with 13 processes on two cores, a sheet and a lattice had lost theirs.
ELAPSED_OVER_PROCESSOR = 3.0
#: Share of the time left that an attempt gets while others may follow.
SHARE_OF_TIME = 2.0 / 3.0
#: Processor seconds of a generator by itself: to start with, for each requested cell, and for each
#: given one.
SECONDS_ALONE = (60.0, 2e-3, 2e-3)
#: The same of a first volume that is adapted: to start with, and for each cell, requested or given,
#: whichever are more.  On closed parts, that needed a fifth.
SECONDS_IN_SURFACE = (10.0, 1e-3)
#: The same of a first volume by fTetWild, and of fTetWild alone.  On pairs of bodies with 15 000
#: cells, the latter needed a sixth of that; a thread with 59 000, of which 40 000 were predicted,
#: needed 92 to 190, and was once stopped at 140.
SECONDS_IN_TETWILD, SECONDS_OF_TETWILD = (40.0, 1e-3, 1e-3), (50.0, 3.5e-3, 1e-3)
#: Tolerances that are passed to a generator if a mesh must meet all requirements, over the
#: allowed one.
#: Generators keep a smaller tolerance than the one they are given, at most 2.2 times.
SMALLER_TOLERANCE, SMALLEST_TOLERANCE = 0.4, 0.15
#: If fTetWild fails, it is run again with this times the tolerance.  On two cubes that overlap it
#: crashed in each run at .02 of the diagonal, and not at .005.  A larger tolerance than the second,
#: over the diagonal, is the likely cause of a failure, and so is a quarter of it.
TOLERANCE_AFTER_FAILURE, ABSURD_TOLERANCE = 0.25, 0.1

# --- Periodic meshes -------------------------------------------------------------------------
#: Ways to join the cells at most.  The turns end before if nothing is left to do, or if a turn
#: leaves as much as the one before.  The number only limits the time, as what is left is refused.
MOST_PERIODIC_TURNS = 4
#: Tetrahedra are divided to have three between opposite sides while there are at most so many.
#: Not measured: it limits the time and the memory for a wide layer that is one cell thick.
MOST_PERIODIC_CELLS = 2_000_000
#: Distance of the second place around which cells are joined from the first one, over the motions.
#: The cuts of the first are then inside.  Any value between 0 and 1/2 serves, as what stays cut in
#: both is joined by later turns.
PERIODIC_SHIFT = 0.25
#: An edge on a side that is longer than so many times its size is an error.  Mmg divides edges that
#: are longer than 1.4 times their size.  Of the units in the tests, the gyroid has 2.02, the others
#: at most 1.46.
LONGEST_ON_SIDES = 2.5
