"""The names of `adaptsize.remeshing` for type checkers; tests/test_types.py writes this file."""

from adaptsize.remeshing.cad import read_cad as read_cad
from adaptsize.remeshing.details import remove_details as remove_details
from adaptsize.remeshing.distmesh.from_distance import mesh_from_distance as mesh_from_distance
from adaptsize.remeshing.driver import remesh as remesh
from adaptsize.remeshing.protocol import Backend as Backend
from adaptsize.remeshing.registry import available_backends as available_backends
from adaptsize.remeshing.registry import register_backend as register_backend

__all__ = [
    "Backend",
    "available_backends",
    "mesh_from_distance",
    "read_cad",
    "register_backend",
    "remesh",
    "remove_details",
]
