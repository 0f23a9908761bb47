"""Mesh sizes on meshes that are distributed over many processes."""

from adaptsize.adaptation.in_parts import AdaptedParts, PartsReport
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.files import read_parts, write_parts
from adaptsize.distributed.from_dolfinx import DolfinxPart, from_dolfinx, to_dolfinx
from adaptsize.distributed.from_petsc import PlexPart, from_dmplex
from adaptsize.limiting.in_parts.info import PartsLimitingInfo, PartsSources
from adaptsize.remeshing.in_parts import InterfaceQuality, interface_quality

__all__ = [
    "AdaptedParts",
    "DolfinxPart",
    "InterfaceQuality",
    "PartitionedMesh",
    "PartsLimitingInfo",
    "PartsReport",
    "PartsSources",
    "PlexPart",
    "from_dmplex",
    "from_dolfinx",
    "interface_quality",
    "read_parts",
    "to_dolfinx",
    "write_parts",
]
