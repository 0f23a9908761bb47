"""The names of `adaptsize` for type checkers; tests/test_types.py writes this file."""

from adaptsize import adaptation as adaptation
from adaptsize import background as background
from adaptsize import bridges as bridges
from adaptsize import distributed as distributed
from adaptsize import domain_size as domain_size
from adaptsize import errors as errors
from adaptsize import geometry as geometry
from adaptsize import io as io
from adaptsize import limiting as limiting
from adaptsize import metrics as metrics
from adaptsize import plot as plot
from adaptsize import quality as quality
from adaptsize import remeshing as remeshing
from adaptsize import reporting as reporting
from adaptsize import sizes as sizes
from adaptsize import typing as typing
from adaptsize._size_function import SizeFunction as SizeFunction
from adaptsize.adaptation import ElementField as ElementField
from adaptsize.adaptation import FieldTransfer as FieldTransfer
from adaptsize.adaptation import adapt as adapt
from adaptsize.adaptation import needs_remeshing as needs_remeshing
from adaptsize.adaptation import transfer_fields as transfer_fields
from adaptsize.background import CartesianGrid as CartesianGrid
from adaptsize.background import Octree as Octree
from adaptsize.background import SimplexMesh as SimplexMesh
from adaptsize.background import interpolate as interpolate
from adaptsize.background import refine_at_boundary as refine_at_boundary
from adaptsize.background import refine_to_size as refine_to_size
from adaptsize.domain_size import mesh_family as mesh_family
from adaptsize.domain_size import mesh_image as mesh_image
from adaptsize.domain_size import remesh_to_elements as remesh_to_elements
from adaptsize.domain_size import size_function as size_function
from adaptsize.geometry import SignedDistance as SignedDistance
from adaptsize.geometry import feature_size as feature_size
from adaptsize.geometry import medial_axis as medial_axis
from adaptsize.geometry import signed_distance as signed_distance
from adaptsize.io import polygons as polygons
from adaptsize.io import read as read
from adaptsize.io import read_image as read_image
from adaptsize.io import read_metric as read_metric
from adaptsize.io import read_size as read_size
from adaptsize.io import write as write
from adaptsize.limiting import limit_gradient as limit_gradient
from adaptsize.limiting import limit_on_sphere as limit_on_sphere
from adaptsize.metrics import Metric as Metric
from adaptsize.metrics import MetricFunction as MetricFunction
from adaptsize.metrics import limit_metric as limit_metric
from adaptsize.metrics import metric_from_curvature as metric_from_curvature
from adaptsize.metrics import metric_from_hessian as metric_from_hessian
from adaptsize.metrics import metric_from_layers as metric_from_layers
from adaptsize.quality import check_mesh as check_mesh
from adaptsize.quality import size_conformity as size_conformity
from adaptsize.remeshing import mesh_from_distance as mesh_from_distance
from adaptsize.remeshing import read_cad as read_cad
from adaptsize.remeshing import remesh as remesh
from adaptsize.reporting import report as report
from adaptsize.sizes import BallSource as BallSource
from adaptsize.sizes import BoundarySource as BoundarySource
from adaptsize.sizes import BoxSource as BoxSource
from adaptsize.sizes import CurveSource as CurveSource
from adaptsize.sizes import PointSource as PointSource
from adaptsize.sizes import RegionSource as RegionSource
from adaptsize.sizes import size_from_curvature as size_from_curvature
from adaptsize.sizes import size_from_error as size_from_error
from adaptsize.sizes import size_from_feature as size_from_feature
from adaptsize.sizes import size_from_hessian as size_from_hessian
from adaptsize.sizes import size_from_separation as size_from_separation
from adaptsize.sizes import size_from_sources as size_from_sources
from adaptsize.sizes import zz_indicator as zz_indicator

__version__: str

__all__ = [
    "BallSource",
    "BoundarySource",
    "BoxSource",
    "CartesianGrid",
    "CurveSource",
    "ElementField",
    "FieldTransfer",
    "Metric",
    "MetricFunction",
    "Octree",
    "PointSource",
    "RegionSource",
    "SignedDistance",
    "SimplexMesh",
    "SizeFunction",
    "__version__",
    "adapt",
    "check_mesh",
    "feature_size",
    "interpolate",
    "limit_gradient",
    "limit_metric",
    "limit_on_sphere",
    "medial_axis",
    "mesh_family",
    "mesh_from_distance",
    "mesh_image",
    "metric_from_curvature",
    "metric_from_hessian",
    "metric_from_layers",
    "needs_remeshing",
    "polygons",
    "read",
    "read_cad",
    "read_image",
    "read_metric",
    "read_size",
    "refine_at_boundary",
    "refine_to_size",
    "remesh",
    "remesh_to_elements",
    "report",
    "signed_distance",
    "size_conformity",
    "size_from_curvature",
    "size_from_error",
    "size_from_feature",
    "size_from_hessian",
    "size_from_separation",
    "size_from_sources",
    "size_function",
    "transfer_fields",
    "write",
    "zz_indicator",
]
