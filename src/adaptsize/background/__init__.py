"""Backgrounds: meshes, grids, octrees and images that carry nodal values."""

from adaptsize.background.grid import CartesianGrid
from adaptsize.background.image import Image
from adaptsize.background.interpolation import AnyBackground, interpolate
from adaptsize.background.octree import Octree
from adaptsize.background.partitioned import AnyMesh, PartitionedMesh
from adaptsize.background.refinement import refine_at_boundary, refine_to_size
from adaptsize.background.simplex import SimplexMesh

__all__ = [
    "AnyBackground",
    "AnyMesh",
    "CartesianGrid",
    "Image",
    "Octree",
    "PartitionedMesh",
    "SimplexMesh",
    "interpolate",
    "refine_at_boundary",
    "refine_to_size",
]
