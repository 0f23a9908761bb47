"""What was tuned in gradient limiting: values, evidence, and what other values do.

None of these changes a result by more than rounding or than the tolerance of its scheme, except for
windows on surfaces.  Unless something is stated, half and double a value were not measured.
Tolerances for rounding and numbers of items between two progress reports are not tuned; they are at
the head of their files.
"""

# Fast marching (`fast_marching.py`).

#: Before policy iteration, marching continues until no size decreases by more than this share.
#: Policy iteration then needs half as many steps.
KEEP_ROUGHLY = 1.0 - 1e-3
#: Acceptances per node after which dependencies between nodes count as cyclic.  Meshes of mesh
#: generators need 1.0 to 1.2; obtuse slivers cause cycles.
ACCEPTANCES_PER_NODE = 8
#: Most steps of policy iteration.
POLICY_STEPS = 200
#: Width of a window of meshes in parts, in edges: nodes accepted too early are accepted again, and
#: narrow windows mean many rounds.  Measured on 40 000 nodes and 4 to 16 parts: 3 to 37 per cent
#: more work.
WINDOW = 8.0

# Iterative schemes (`hamilton_jacobi.py`, `barth_sethian.py`).

#: Steps by default: so many times those in which information crosses the diagonal of the grid, and
#: so many more.
CROSSINGS, MORE_STEPS = 10, 200
#: Steps by default for the smallest altitude of a mesh: so many times its number in the diagonal,
#: and at most the latter.
PASSES, MOST_STEPS = 20.0, 20_000

# Limits that depend on the size (`gradient_limit.py`).

#: Intervals of the table of Phi per factor e of h: linear interpolation then errs by
#: 1 / (8 * 8192^2) = 2e-9 relative where g(h) changes by a factor e as fast as h does.  Half: four
#: times that error.  Double: a quarter of it.
INTERVALS = 8192

# Lines of sight in the plane (`exact/obstacles_in_plane.py`).

#: Fewer corners than this are always seen by lines of sight.  These take up to 70 ns times the
#: square of the number of corners, and triangular expansion 450 to 1400 ns per node.
FEW_CORNERS = 64
#: Squares of the number of corners per node from which on lines of sight take many times as long
#: as fast marching.
MANY_CORNERS = 40

# Meshes in parts (`exact/in_parts.py`).

#: From so many nodes per bound and rank on, in a convex domain, all ranks get all bounds, and each
#: computes its sizes once.  Work with it on 2 and 4 ranks, cube of 125 000 nodes with bounds at
#: random nodes, as a share of that without: .97 and .94 with 4 nodes per bound and rank, .94 and
#: .91 with 16, .98 and .77 with 64, .89 and .83 with 256.
FEW_BOUNDS = 16

# Windows on surfaces (`exact/on_surface.py`).

#: Windows per node after which narrow ones are dropped (decision 38), and at least so many in all.
#: The page of measurements on exact limiting shows the errors after 24 windows per node.
WINDOWS_PER_NODE, LEAST_WINDOWS = 45, 60_000
#: Windows per node after which their number is forecast.  Narrow ones are dropped at once if it is
#: above the limit: that costs as much as 12 windows per node.  24 parts with one and five sources
#: need up to 32; spheres of 8 000 and 32 000 nodes 136 and 281.
FORECASTS = (8, 28)
#: They are not dropped if fewer windows per node than this are left: forecasts may be a fifth too
#: high.  With 0, spot (2 930 nodes) from one source is exact at two thirds of its nodes, and takes
#: 28 times as long as fast marching; with 20 at all of them, and 23 times.
DROPPING = 20
#: Windows that are narrower than this share of their edge are narrow.  Half and double it: the
#: same page.
NARROW = 0.4

# Sizes inside the solid that a surface encloses (`inside.py`).

#: A source between the nodes acts on so many of the nearest nodes that do not see what they should.
NEAREST_NODES = 3
#: So many lines to hidden sources are traced in the search for the best one seen from a point: the
#: least and the largest number, and that for all points together, a few seconds.  Sources behind a
#: wall that has hidden another one need none: on the surface of a thread a point needs 6.
MOST_HIDDEN = (200, 5000, 4_000_000)
