"""Mesh sizes on meshes that are distributed over many processes."""

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.files import read_parts, write_parts
from adaptsize.distributed.solvers import DolfinxMesh, from_dmplex, from_dolfinx, to_dolfinx

__all__ = [
    "DolfinxMesh",
    "PartitionedMesh",
    "from_dmplex",
    "from_dolfinx",
    "read_parts",
    "to_dolfinx",
    "write_parts",
]
