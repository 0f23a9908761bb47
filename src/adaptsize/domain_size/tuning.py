"""What was tuned in size functions of domains: values, evidence, and what other values do.

The effect of half and double the value is that on the predicted elements of a ball, a ring (torus)
and a plate of 10 x 8 x 0.5: by default 41 000, 24 000 and 26 000, and 7 400, 14 000 and 110 fully
relaxed.  Where an effect is stated, those that are not named change by at most 3 %.
``benchmarks/tuning.py`` measures it.  Values without a stated effect were not varied.
"""

#: Elements per radian of curved boundaries, by default: 25 edges around a circle.  Half: none, as
#: chords within the default tolerance need smaller sizes.  Double: 3.2 times as many elements in
#: the ring.
PER_RADIAN = 4.0
#: The least, relaxed, where no tolerance keeps the shape.
LEAST_PER_RADIAN = 1.0
#: Elements across narrow regions, by default: with 2 of them, no edge connects both sides.
#: Half: 0.12 times as many in the plate.  Double: 8.4 times, and 4.2 times if it is relaxed.
ACROSS = 2.0
#: The least, relaxed, also between features: cells four times as long as a plate is thick have
#: angles of about 15 degrees.  Half: none.  Double: 4.2 times as many in the relaxed plate.
LEAST_ACROSS = 0.25
#: Elements between features, by default: 1 resolves the gap between them, and no more.
BETWEEN = 1.0
#: Default hmax over the diameter.  Half: 8.0 and 3.5 times as many in ball and ring.  Double: 0.3
#: times in the ball.
HMAX_SHARE = 1.0 / 20.0
#: Default hmin over the diameter.  Half and double: none, as no size here is that small.
HMIN_SHARE = 1.0 / 1000.0
#: Largest gradient limit over the default, relaxed; decision 39 compares 1 and 2.  Half: 1.6 and
#: 1.7 times as many in the relaxed ball and ring.  Double: none, as FULLY allows no more.
GRADIENT_OVER_DEFAULT = 2.0
#: Relaxation at which the sizes at boundaries are those of chords within the tolerance, or a
#: quarter of an element across, and hmax is nearly the diameter.  Half: 1.3, 1.3 and 4.1 times as
#: many in the relaxed domains.  Double: none.
FULLY = 16.0
#: The largest relaxation: beyond `FULLY`, only features are allowed to be closer than the size, by
#: up to 16 times.
FARTHEST = 64.0

#: A predicted number this close to the requested one is accepted, a share.
CLOSE = 0.02
#: One that is off by less than this share is not what was requested, but no reason to refuse or to
#: warn.
NEAR = 0.1
#: Share of an allowed number that sizes need not use.
UNUSED = 0.05
#: Largest details that are offered to be left out, over the diameter: larger ones are no details.
LARGEST_DETAIL = 0.1
#: Elements of a mesh over the largest number allowed, up to which it is accepted (decision 39).
OVER_CAP = 1.1
#: Meshes that are made for fewer elements after one that exceeds a cap.
MESHES_FOR_FEWER = 2
#: The next one is predicted for what was made over what was predicted to this power: the number of
#: facets, and of cells beside thin walls, falls as that of cells to the power of 2/3.  By fTetWild
#: on two rough surfaces, the number fell as the predicted one to the power of .62 and .65; with 1,
#: these needed three meshes, and five of 24 generated parts exceeded a cap again by 12 to 21 %.
FALL = 1.5
#: The search for its sizes begins with the relaxation of the last ones times the excess to this
#: power.  A number fell as about the square of the relaxation, and as its cube near the most.
FURTHER = 0.75
#: Elements of a mesh over the predicted number, below which a second one is made for a cap.
UNDER_CAP = 0.85
#: Elapsed seconds of generators above which a mesh is not made again for more elements.  fTetWild
#: takes 10 to 40 s for 40 000, and 90 to 150 s inside the surface of a thread.
LONG = 60.0
#: Nodes that sources may add to a mesh, and their share of the elements allowed.  Before a mesh
#: generator adapts it, a resolved mesh has a quarter to an eighth of the nodes of the new one.
MOST_NODES_OF_SOURCES, SHARE_OF_NODES = 400_000, 0.25
#: The same of a surface, and how many it may have whatever is allowed: in a second at most.  With a
#: tenth of 10 000 elements, predicted numbers of parts with rims and text were 20 % too small.
SHARE_ON_SURFACE, FEW_NODES = 0.1, 20_000
#: Points of a surface at which the cells of thin walls are counted.
POINTS_ON_WALLS = 2000
#: Cells of a wall of the width W for each side, area and size h: W / h, and their number.  Square
#: sheets with a side of 17 h, of different triangles on both sides, were made.  With W / h of .17,
#: .25, .33, .42, .5, .6, .8, 1, 1.33 and 2, they have 2 082, 2 170, 2 927, 3 731, 3 870, 3 887,
#: 3 995, 4 078, 4 581 and 5 814 cells: nodes between the sides begin at .25.
IN_WALLS = ((0.2, 3.5), (0.25, 3.7), (0.3, 4.2), (0.42, 6.3), (0.6, 6.8), (1.0, 7.3), (2.0, 10.1))
#: Squared edge over the radius and the tolerance, beyond which facets on curved boundaries become
#: smaller.  With sizes of `LONGEST_CHORDS`, facets of the fewest elements were 1.08 times as many
#: as predicted on a ring, 1.23 on a sphere, 1.37 on a cylinder, 1.19 and 1.22 on two wavy bodies.
MADE_CHORDS = 6.4
#: Cells for each size along a side of a narrow face that there are less around its feature edge,
#: and the largest width of these faces over the size.  Bars of 1/4, 1/2 and 1 h, 75 h long: 542,
#: 793 and 1 244 cells.
LESS_AT_EDGE, NARROW_FACE = 0.5, 2.0
#: Cosine of the largest angle at a corner of a face, of 135 degrees.
BLUNTEST_CORNER = -0.7
#: Halving edges of a surface ends after more than so many passes that lower the largest ratio of
#: an edge to its size by less than the second number, if fewer edges than the third share are too
#: long.  On a public part, edges of slivers were halved in turn without an end.
PASSES_IN_VAIN, LESS, FEW_LONG = 4, 0.05, 0.01

# Periodic domains ---------------------------------------------------------------------------------

#: Distance over the diagonal within which an image is on the boundary: as nodes coincide.
ON_SIDE = 1e-7
#: Sizes on a side that are smaller by less than this share are left to the generator.  Sizes that
#: are linear between the nodes of two sides differ by as much where these do not match.
SAME_ACROSS = 0.02
#: Points at most at which sizes are compared with those at their images.
MOST_PLACES_ON_SIDES = 100_000
#: Sizes are computed at most so many times more.  One is enough if a detail is near to one side,
#: two across a corner.
MOST_TIMES_ACROSS = 3
