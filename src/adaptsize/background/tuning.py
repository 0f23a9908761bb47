"""What was tuned in backgrounds: values, evidence, and what other values do.

Half and double a value were not measured, unless something is stated.  Tolerances for rounding and
numbers of items between two progress reports are not tuned; they are at the head of their files.
"""

# Bisection until sizes are known (`bisection.py`).

#: Longest edge of a resolved cell over the smallest size in it.
EDGE_OVER_SIZE = 2.0
#: Deviation of sizes from linear ones, over the size, up to which cells may be larger, ...
NEARLY_LINEAR = 0.05
#: ... if no size in them can be smaller than this share of those at their corners.
HIDDEN = 0.5
#: Rounds of division; each at least halves the longest edges every three rounds.
MOST_ROUNDS = 400

# Joining the corners of triangles that nearly meet (`merging.py`).

#: Corners are joined if they are closer than this times the shortest edge of their triangles.
SHARE_OF_EDGE = 0.1
#: And, where most edges meet exactly, than this times the diagonal: a gap may be meant.
SEAM = 1e-6
#: If most edges are open, this share of them must become joined, else the triangles are apart.
LEAST_JOINED = 0.25
