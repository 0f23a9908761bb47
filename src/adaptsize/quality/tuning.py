"""What was tuned in the measures of meshes: values, evidence, and what other values do.

The limits of verdicts, which are documented, are at the head of their files, as are tolerances for
rounding and numbers of items in a block.
"""

#: In a cell where the size varies less than by this factor, it is known from that at the corners.
#: Not measured.
ABOUT_THE_SAME = 1.5
#: Steeper sizes on grids are sampled at the nodes.  Not measured.
STEEP_SIZES = 1.0
#: Parts into which cells are divided until a metric hardly varies in them, beside one per cell.
#: Not measured.
MOST_PARTS_OF_CELLS = 100_000
#: Requests for fewer elements are not reported: a few cells more or less decide on them.  Not
#: measured.
FEW_REQUESTED = 30.0
#: Facets of the boundary at which the size along the normal is so much smaller than the others are
#: walls with a boundary layer.  Metrics of second derivatives with moderate aspect ratios, such
#: as 20, ask for no layers there.
THIN_LAYER = 50.0
#: Outward normals at both ends of an edge across a wall have a smaller cosine.  Of the edges of a
#: housing with thin walls, 73.4 to 73.0 % were near their sizes with -.3 to -.9.
OPPOSITE_SIDES = -0.5
