"""Ways into other packages: an accessor for PyVista, and a size callback for Gmsh."""

from adaptsize.bridges.gmsh import gmsh_callback

__all__ = ["gmsh_callback"]
