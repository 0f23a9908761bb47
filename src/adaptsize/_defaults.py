"""Default values that functions and commands share; quick to import."""

#: Gradient limit g of sizes.
GRADIENT_LIMIT = 0.25
#: Gradient limit g of metrics, where it is optional.  It is larger than that of sizes, because it
#: limits the sizes along a layer by those across the layer nearby.
METRIC_GRADIENT_LIMIT = 1.0
#: Angle in degrees above which an edge is a feature edge, not curvature.
CREASE_ANGLE = 40.0
#: Smallest angle in degrees between two faces that form a corner; below, they are narrow.
CORNER_ANGLE = 30.0
#: Share of the diagonal by which the boundary of a new mesh may deviate.
TOLERANCE = 1e-3
#: Without ``max_elements``: to so many elements are parameters relaxed that are not given.
RELAXED_TO = 300_000.0
#: Without ``max_elements``: more elements are refused, whatever requires them.
REFUSED_ABOVE = 5e6


def refused_above(max_elements: float | None) -> float:
    """Return the number of elements above which no mesh is made."""
    return REFUSED_ABOVE if max_elements is None else max_elements


#: Fields with sizes of a mesh and bounds on them, and what belongs to them after a dot: not for the
#: next mesh.
FIELDS_OF_SIZES = ("h", "h0", "metric")


def is_of_sizes(name: str) -> bool:
    """Return whether a field holds the sizes for which a mesh was made, or is to be made.

    Examples
    --------
    >>> is_of_sizes("h.hmax"), is_of_sizes("heat")
    (True, False)
    """
    return name.partition(".")[0] in FIELDS_OF_SIZES
