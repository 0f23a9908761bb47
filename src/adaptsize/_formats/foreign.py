"""Files read by other packages, in the child process of `limited`.

Modules with compiled kernels are not imported here, because that would take a second.
"""

from __future__ import annotations

import io
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats import abaqus, raster, vtk
from adaptsize._formats.blocks import RawMesh, name_of_polygon, sewn
from adaptsize._formats.guards import files_named_in
from adaptsize.errors import MeshFileError

_VERTEX = re.compile(rb"^[ \t]*v[ \t]", re.M)  # of OBJ
_ELEMENT_DATA = re.compile(rb"^\$ElementData\s*?\n.*?^\$EndElementData\s*?\n", re.M | re.S)
#: The names of physical groups.  meshio keeps one per name; a volume and its skin may share one.
_NAMES = re.compile(r"^\$PhysicalNames\s*$(.*?)^\$EndPhysicalNames", re.M | re.S)
_NAME = re.compile(r'^[ \t]*([0-3])\s+(-?\d+)\s+"([^"\n]*)"', re.M)


def refuse_links(path: Path) -> None:
    """Refuse a file of HDF5, or one that names such files, with data that are in other files."""
    import h5py

    for file in filter(h5py.is_hdf5, [path, *files_named_in(path)]):
        with h5py.File(file) as opened:
            groups, known = [opened], set()
            while groups:
                group = groups.pop()
                for name in group:
                    link = group.get(name, getlink=True)
                    if isinstance(link, h5py.SoftLink):
                        continue  # to a place in this file
                    is_outside = isinstance(link, h5py.ExternalLink)
                    item = None if is_outside else group[name]
                    if isinstance(item, h5py.Dataset):
                        is_outside = bool(item.external) or item.is_virtual
                    if is_outside:
                        raise MeshFileError(f"has data {name!r} in another file of HDF5")
                    if isinstance(item, h5py.Group) and item.id not in known:
                        known.add(item.id)
                        groups.append(item)


def read_vtk(path: Path) -> RawMesh:
    """Return the mesh in a file that VTK reads.  Parts of one mesh are joined."""
    suffix = path.suffix.lower()
    if suffix == ".vtkhdf":
        refuse_links(path)
    raw = vtk.raw_of(vtk.read_file(path))
    is_in_parts = suffix in (".pvtu", ".pvtp", ".vtkhdf") and len(raw.points)
    if suffix == ".obj":
        raw = RawMesh(raw.points, raw.blocks)
        # VTK has one node per pair of a vertex and its texture or normal: seams would be cracks.
        is_in_parts = len(raw.points) > len(_VERTEX.findall(path.read_bytes()))
    return sewn(raw) if is_in_parts else raw


def read_pieces(path: Path, rank: int, size: int) -> list[RawMesh]:
    """Return every ``size``-th piece of a mesh from ``rank`` on, those without cells left out."""
    if path.suffix.lower() == ".vtkhdf":
        refuse_links(path)
    return [raw for raw in vtk.pieces_in(path, rank, size) if raw.blocks]


def read_vti(path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Return the grid and the fields in a file of VTK."""
    return vtk.image_of(vtk.read_file(path))


def read_picture(path: Path, name: str | None) -> tuple[raster.Image, list[str]]:
    """Return values, spacing and origin of an image, and notes for a warning."""
    notes: list[str] = []
    return raster.load(path, name, notes), notes


def read_abaqus(path: Path) -> RawMesh:
    """Return the mesh in an input file of Abaqus, of which sets could take long."""
    return abaqus.read(path)


def read_meshio(path: Path) -> RawMesh:
    """Return the mesh in any other file."""
    import meshio

    suffix, notes, names = path.suffix.lower(), list[str](), dict[tuple[int, int], str]()
    if suffix == ".msh":
        from meshio.gmsh.main import read_buffer

        content = path.read_bytes()
        if section := _NAMES.search(content.partition(b"\n$Nodes")[0].decode("utf-8", "replace")):
            found = _NAME.findall(section[1])
            names = {(int(dim), int(tag)): name for dim, tag, name in found if name.strip()}
        # meshio takes version "4" for 4.1, and fails on fields of elements in version 2.
        content = re.sub(rb"\A\$MeshFormat\s+4(?=\s)", b"$MeshFormat\n4.0", content)
        if re.match(rb"\$MeshFormat\s+2", content):
            content, n_left_out = _ELEMENT_DATA.subn(b"", content)
            notes += ["cell fields ($ElementData) left out"] * (n_left_out > 0)
        with tempfile.TemporaryFile() as file:  # NumPy reads only what the system has opened
            file.write(content)
            file.seek(0)
            mesh: Any = read_buffer(file)
    elif suffix in (".bdf", ".nas", ".fem"):
        text = path.read_text(encoding="latin-1")
        if not re.search(r"^BEGIN BULK", text, re.M):  # as Gmsh writes them
            text = f"BEGIN BULK\n{text}"
        mesh = meshio.read(io.StringIO(text), "nastran")
    else:
        if suffix in (".xdmf", ".xmf"):
            refuse_links(path)
        mesh = meshio.read(path)
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    ragged = next((name for name, cells in blocks if cells.dtype == object), None)
    if ragged is not None:
        raise MeshFileError(f"holds cells of type {ragged!r}, which cannot be read")
    points = np.asarray(mesh.points, dtype=np.float64)
    numeric = {name: v for name, v in mesh.point_data.items() if np.asarray(v).dtype != object}
    return RawMesh(points, blocks, numeric, mesh.cell_data, names, notes)


def read_shp(path: Path) -> dict[str, Any]:
    """Return the polygons and lines in a shapefile as an object of GeoJSON."""
    import shapefile

    with shapefile.Reader(str(path), encodingErrors="replace") as reader:
        if reader.dbf is None:
            parts = [{"type": "Feature", "geometry": s.__geo_interface__} for s in reader.shapes()]
        else:
            parts = reader.__geo_interface__["features"]
    return {"type": "FeatureCollection", "features": parts, "crs": "in the .prj"}


def read_trimesh(path: Path) -> RawMesh:
    """Return the triangles of all parts of a scene in its coordinates, or a PLY with its fields."""
    import trimesh

    is_ply = path.suffix.lower() == ".ply"
    options = {"fix_texture": False} if is_ply else {}
    mesh: Any = trimesh.load_mesh(path, process=False, skip_materials=True, **options)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    if is_ply:
        if "_ply_raw" not in mesh.metadata:
            raise MeshFileError("holds no faces")
        return _raw_of_ply(points, mesh.metadata["_ply_raw"])
    return RawMesh(points, [("triangle", np.asarray(mesh.faces, np.int64).reshape(-1, 3))])


def _raw_of_ply(points: npt.NDArray[np.float64], elements: dict[str, Any]) -> RawMesh:
    columns = {}
    for name, element in elements.items():
        data, n = element.get("data", {}), element["length"]
        columns[name] = {key: np.asarray(data[key]) for key in element["properties"]}
        held = min([n, *map(len, columns[name].values())])
        if held < n:
            raise MeshFileError(f"is truncated (promises {n} {name} records, holds {held})")
    fields = {
        name: {
            k: v.reshape(-1) for k, v in held.items() if v.size == len(v) and v.dtype.kind in "iuf"
        }
        for name, held in columns.items()
    }
    faces: dict[str, Any] = columns.get("face", {})
    rows = faces.get("vertex_indices", faces.get("vertex_index", np.empty((0, 3))))
    rows = rows[rows.dtype.names[-1]] if rows.dtype.names else rows  # after the counts
    if rows.ndim == 2:
        of_size = [np.arange(len(rows))]
    else:  # lists of different lengths
        sizes = np.array([len(row) for row in rows])
        of_size = [np.flatnonzero(sizes == n) for n in np.unique(sizes)]
    corners = [np.array([*rows[k]] if rows.ndim == 1 else rows, np.int64) for k in of_size]
    blocks = [(name_of_polygon(cells.shape[1]), cells) for cells in corners]
    at_nodes = {name: v for name, v in fields["vertex"].items() if name not in "xyz"}
    of_cells = {name: [v[k] for k in of_size] for name, v in fields.get("face", {}).items()}
    return RawMesh(points, blocks, at_nodes, of_cells)
