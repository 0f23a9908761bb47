"""Where nodal values live."""

from adaptsize.background.simplex import Boundary, SimplexMesh

__all__ = ["Boundary", "SimplexMesh"]
