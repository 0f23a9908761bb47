"""The causes of sizes: a table, one row per kind of bound.

A bound that is not here cannot be reported.  To add one, add a row, and measure it where it can be:
on surfaces (`domain_size.surface_bounds`), on meshes, grids and octrees.
"""

from typing import NamedTuple


class Cause(NamedTuple):
    """A kind of bound on the size."""

    name: str
    """In reports."""
    code: int
    """In files: those of a file do not depend on the causes that it has."""
    is_of_shape: bool = False
    """Whether it follows from the shape: then own sizes of named parts replace it there."""

    def __str__(self) -> str:
        return self.name


CURVATURE = Cause("curvature", 0, is_of_shape=True)
WIDTH = Cause("width", 1, is_of_shape=True)
SEPARATION = Cause("separation", 2, is_of_shape=True)
SOURCES = Cause("sources", 3)
H0 = Cause("h0", 4)
SIZE_OF = Cause("size_of", 5)
#: Where a bound is smaller than that.
HMIN = Cause("hmin", 6)
#: Where there is no other bound.
HMAX = Cause("hmax", 7)
CAUSES = (CURVATURE, WIDTH, SEPARATION, SOURCES, H0, SIZE_OF, HMIN, HMAX)
