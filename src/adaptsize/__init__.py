"""Mesh size functions: how large the elements of a mesh should be at every point.

Mesh size functions with gradient limiting, after P.-O. Persson, "Mesh size
functions for implicit geometries and PDE-based gradient limiting".
"""

from adaptsize._lazy import lazily

__version__ = "0.2.0"

_HOMES = {
    "SimplexMesh": "background",
    "CartesianGrid": "background",
    "Octree": "background",
    "refine_at_boundary": "background",
    "refine_to_size": "background",
    "interpolate": "background",
    "SizeFunction": "_size_function",
    "signed_distance": "geometry",
    "SignedDistance": "geometry",
    "medial_axis": "geometry",
    "feature_size": "geometry",
    "size_from_curvature": "sizes",
    "size_from_feature": "sizes",
    "size_from_separation": "sizes",
    "size_from_error": "sizes",
    "size_from_hessian": "sizes",
    "zz_indicator": "sizes",
    "size_from_sources": "sizes",
    "PointSource": "sizes",
    "CurveSource": "sizes",
    "BoundarySource": "sizes",
    "RegionSource": "sizes",
    "BoxSource": "sizes",
    "BallSource": "sizes",
    "limit_gradient": "limiting",
    "limit_on_sphere": "limiting",
    "Metric": "metrics",
    "MetricFunction": "metrics",
    "metric_from_curvature": "metrics",
    "metric_from_hessian": "metrics",
    "metric_from_layers": "metrics",
    "limit_metric": "metrics",
    "size_function": "domain_size",
    "mesh_family": "domain_size",
    "mesh_image": "domain_size",
    "remesh_to_elements": "domain_size",
    "remesh": "remeshing",
    "mesh_from_distance": "remeshing",
    "size_conformity": "quality",
    "check_mesh": "quality",
    "adapt": "adaptation",
    "needs_remeshing": "adaptation",
    "transfer_fields": "adaptation",
    "FieldTransfer": "adaptation",
    "ElementField": "adaptation",
    "report": "reporting",
    "polygons": "io",
    "read": "io",
    "read_cad": "remeshing",
    "read_image": "io",
    "read_metric": "io",
    "read_size": "io",
    "write": "io",
}

_SUBMODULES = (
    "adaptation",
    "background",
    "bridges",
    "distributed",
    "domain_size",
    "errors",
    "geometry",
    "io",
    "limiting",
    "metrics",
    "plot",
    "quality",
    "remeshing",
    "reporting",
    "sizes",
    "typing",
)

__all__ = ["__version__", *_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES, _SUBMODULES)
