"""Mesh sizes on meshes that are distributed over many processes."""

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.adaptation import adapt
from adaptsize.distributed.files import read_parts, write_parts
from adaptsize.distributed.from_dolfinx import DolfinxPart, from_dolfinx, to_dolfinx
from adaptsize.distributed.from_petsc import PlexPart, from_dmplex
from adaptsize.distributed.interface_quality import InterfaceQuality
from adaptsize.distributed.remeshing import RemeshedParts, remesh
from adaptsize.distributed.report import AdaptedParts, PartsReport
from adaptsize.limiting.in_parts.info import PartsLimitingInfo, PartsSources
from adaptsize.limiting.in_parts.limit import limit_gradient

__all__ = [
    "AdaptedParts",
    "DolfinxPart",
    "InterfaceQuality",
    "PartitionedMesh",
    "PartsLimitingInfo",
    "PartsReport",
    "PartsSources",
    "PlexPart",
    "RemeshedParts",
    "adapt",
    "from_dmplex",
    "from_dolfinx",
    "limit_gradient",
    "read_parts",
    "remesh",
    "to_dolfinx",
    "write_parts",
]
