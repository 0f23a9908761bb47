"""Mesh sizes on meshes that are distributed over many processes."""

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.adaptation import adapt
from adaptsize.distributed.boundary_sizes import size_from_curvature, size_from_feature
from adaptsize.distributed.files import read_parts, write_parts
from adaptsize.distributed.from_dolfinx import DolfinxPart, from_dolfinx, to_dolfinx
from adaptsize.distributed.from_petsc import PlexPart, from_dmplex
from adaptsize.distributed.interface_quality import InterfaceQuality
from adaptsize.distributed.remeshing import RemeshedParts, remesh
from adaptsize.distributed.report import AdaptedParts, PartsReport
from adaptsize.distributed.sizes import predicted_elements, size_from_error, size_from_hessian
from adaptsize.distributed.source_sizes import size_from_sources
from adaptsize.distributed.transfer import interpolate, transfer_fields
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
    "interpolate",
    "limit_gradient",
    "predicted_elements",
    "read_parts",
    "remesh",
    "size_from_curvature",
    "size_from_error",
    "size_from_feature",
    "size_from_hessian",
    "size_from_sources",
    "to_dolfinx",
    "transfer_fields",
    "write_parts",
]
