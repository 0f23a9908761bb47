"""Where nodal values live."""

from adaptsize.background.grid import CartesianGrid
from adaptsize.background.simplex import Boundary, SimplexMesh

__all__ = ["Boundary", "CartesianGrid", "SimplexMesh"]
