"""Files read and written by other packages, in the child process of `limited`.

Each function takes and returns what `limited` can pass: lists, dictionaries, texts and arrays.
Modules with compiled kernels are not imported here, because that would take a second.
"""

from __future__ import annotations

import re
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from adaptsize._formats import raster, vtk
from adaptsize._formats.blocks import RawMesh
from adaptsize.errors import MeshFileError


def read_vtk(path: Path) -> dict[str, Any]:
    """Return the mesh in a file of VTK."""
    return vtk.raw_of(vtk.read_file(path)).packed()


def read_vti(path: Path) -> dict[str, Any]:
    """Return the grid and the fields in a file of VTK."""
    return vtk.image_of(vtk.read_file(path))


def read_picture(path: Path, name: str | None) -> list[Any]:
    """Return values, spacing and origin of an image, and notes for a warning."""
    notes: list[str] = []
    return [list(raster.load(path, name, notes)), notes]


def read_meshio(path: Path) -> dict[str, Any]:
    """Return the mesh in any other file."""
    meshio = _meshio()
    mesh = meshio.read(path, file_format="gmsh" if path.suffix.lower() == ".msh" else None)
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    ragged = next((name for name, cells in blocks if cells.dtype == object), None)
    if ragged is not None:
        raise MeshFileError(f"holds cells of type {ragged!r}, which cannot be read")
    points = np.asarray(mesh.points, dtype=np.float64)
    numeric = {name: v for name, v in mesh.point_data.items() if np.asarray(v).dtype != object}
    return RawMesh(points, blocks, numeric, mesh.cell_data).packed()


def read_meshio_edited(path: Path, pattern: str, new: str, copy: str) -> dict[str, Any]:
    """Return the mesh in a file in which a pattern is replaced; ``copy`` is a path for it."""
    content, count = re.subn(pattern.encode(), new.encode(), path.read_bytes())
    if not count:
        raise MeshFileError("cannot be read as a mesh")
    Path(copy).write_bytes(content)
    return read_meshio(Path(copy))


def read_shp(path: Path) -> list[Any]:
    """Return the polygons and lines in a shapefile, and the number of other shapes.

    Each has the fields of its record, whether it is a polygon, its points, and where its parts
    begin.
    """
    import shapefile

    found: list[Any] = []
    with shapefile.Reader(str(path), encodingErrors="replace") as reader:
        shapes = reader.shapes()
        records = reader.records() if reader.dbf is not None else [None] * len(shapes)
    for shape, record in zip(shapes, records, strict=True):
        if shape.shapeType % 10 in (3, 5) and shape.points:
            fields = {} if record is None else record.as_dict()
            texts = {name: text for name, text in fields.items() if isinstance(text, str)}
            points = np.array([point[:2] for point in shape.points], dtype=np.float64)
            found.append([texts, shape.shapeType % 10 == 5, points, [int(k) for k in shape.parts]])
    return [found, len(shapes) - len(found)]


def _meshio() -> Any:
    """Return the package, which imports h5py for XDMF even where all numbers are text."""
    import meshio

    if "h5py" not in sys.modules and find_spec("h5py") is None:
        sys.modules["h5py"] = _NoHdf5("h5py")
    return meshio


class _NoHdf5(ModuleType):
    def __getattr__(self, name: str) -> Any:
        raise MeshFileError("holds numbers in a file of HDF5, which needs the package h5py")


def read_trimesh(path: Path) -> dict[str, Any]:
    """Return the triangles of all parts of a scene, in its coordinates."""
    import trimesh

    mesh: Any = trimesh.load_mesh(path, process=False, skip_materials=True)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    return RawMesh(points, [("triangle", faces)]).packed()


def write_meshio(
    path: Path, packed: dict[str, Any], file_format: str, options: dict[str, Any]
) -> None:
    """Write a mesh by meshio."""
    meshio = _meshio()
    raw = RawMesh.unpacked(packed)
    mesh = meshio.Mesh(raw.points, raw.blocks, raw.point_data, raw.cell_data)
    meshio.write(path, mesh, file_format=file_format, **options)
