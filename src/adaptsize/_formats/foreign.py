"""Files read by other packages, in the child process of `limited`.

Modules with compiled kernels are not imported here, because that would take a second.
"""

import codecs
import itertools
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats import vtk
from adaptsize._formats.blocks import NODE_NUMBERS, RawMesh, name_of_polygon, sewn
from adaptsize._formats.guards import files_named_in
from adaptsize.errors import MeshFileError

_VERTEX = re.compile(rb"^[ \t]*v[ \t]", re.M)  # of OBJ
_MARKER = re.compile(rb"^([ \t]*MARKER_TAG[ \t]*=[ \t]*)(.*?)[ \t\r]*$", re.M)  # of SU2


def refuse_links(path: Path) -> None:
    """Refuse a file of HDF5, or one that names such files, with data that are in other files."""
    import h5py

    for file in filter(h5py.is_hdf5, [path, *files_named_in(path)]):
        with h5py.File(file) as opened:

            def outside(name: str, link: object, opened: h5py.File = opened) -> str | None:
                item = opened[name] if isinstance(link, h5py.HardLink) else None
                is_outside = isinstance(link, h5py.ExternalLink)
                if isinstance(item, h5py.Dataset):
                    is_outside = bool(item.external) or item.is_virtual
                return name if is_outside else None

            if found := opened.visititems_links(outside):
                raise MeshFileError(f"has data {found!r} in another file of HDF5")


def read_vtk(path: Path) -> RawMesh:
    """Return the mesh in a file that VTK reads.  Parts of one mesh are joined."""
    suffix = path.suffix.lower()
    if suffix == ".vtkhdf":
        refuse_links(path)
    raw = vtk.raw_of(vtk.read_file(path))
    is_in_parts = suffix in (".pvtu", ".pvtp") or (suffix == ".vtkhdf" and _has_parts(path))
    if suffix == ".obj":
        raw = RawMesh(raw.points, raw.blocks)
        # VTK has one node per pair of a vertex and its texture or normal: seams would be cracks.
        is_in_parts = len(raw.points) > len(_VERTEX.findall(path.read_bytes()))
    return sewn(raw) if is_in_parts and len(raw.points) else raw


def _has_parts(path: Path) -> bool:
    """Return whether a file of VTKHDF has parts: nodes at one place of a whole mesh are a slit."""
    import h5py

    with h5py.File(path) as file:
        root = file["VTKHDF"]
        counts, fields = root.get("NumberOfPoints"), root.get("PointData", ())
        return counts is None or len(counts) > 1 or any(name in fields for name in NODE_NUMBERS)


def read_pieces(path: Path, rank: int, size: int) -> list[RawMesh]:
    """Return every ``size``-th piece of a mesh from ``rank`` on, those without cells left out."""
    if path.suffix.lower() == ".vtkhdf":
        refuse_links(path)
    return [raw for raw in vtk.pieces_in(path, rank, size) if raw.blocks]


def raw_of_meshio(mesh: Any) -> RawMesh:
    """Return a mesh of meshio.  Nodal fields of objects are left out."""
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    point_data = {n: v for n, v in mesh.point_data.items() if np.asarray(v).dtype != object}
    return RawMesh(np.asarray(mesh.points, np.float64), blocks, point_data, mesh.cell_data)


def read_su2(path: Path) -> RawMesh:
    """Return the mesh in a file of SU2.  What meshio cannot read in its text is replaced."""
    from meshio import _helpers  # `read` would name the file of the text

    content = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    if zones := re.search(rb"^[ \t]*NZONE[ \t]*=[ \t]*(\d+)", content, re.M):
        raise MeshFileError(f"has {int(zones[1])} zones of SU2 (NZONE); write each to its own file")
    content, names = _text_of_su2(content)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "text.su2")
        file.write_bytes(content)
        mesh = _helpers.reader_map["su2"](str(file))
    return replace(raw_of_meshio(mesh), tag_names=names)


def _text_of_su2(content: bytes) -> tuple[bytes, dict[tuple[int, int], str]]:
    """Return a file of SU2 with numbers for the names of markers, and their names.

    meshio counts on from the last number, which may be that of another marker.
    """
    names = dict.fromkeys(name for _, name in _MARKER.findall(content))
    free = (b"%d" % k for k in itertools.count(1) if b"%d" % k not in names)
    number = {name: name if name.isdigit() else next(free) for name in names}
    dim = re.search(rb"^[ \t]*NDIME[ \t]*=[ \t]*(\d)", content, re.M)
    tag_names = {
        (int(dim[1]) - 1, int(tag)): name.decode("utf-8", "replace")
        for name, tag in number.items() if dim and name != tag
    }  # fmt: skip
    return _MARKER.sub(lambda found: found[1] + number[found[2]], content), tag_names


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

    if path.suffix.lower() != ".ply":
        return raw_of_trimesh(trimesh.load_scene(path, process=False, skip_materials=True))
    mesh = trimesh.load_mesh(path, process=False, skip_materials=True, fix_texture=False)
    if "_ply_raw" not in mesh.metadata:
        raise MeshFileError("holds no faces")
    return _raw_of_ply(np.asarray(mesh.vertices, dtype=np.float64), mesh.metadata["_ply_raw"])


def raw_of_trimesh(mesh: Any) -> RawMesh:
    """Return the triangles of a mesh, or of a scene, with the names of its parts as tags."""
    held = mesh.dump() if hasattr(mesh, "graph") else [mesh]
    parts = [part for part in held if hasattr(part, "faces")]
    if not parts:
        raise MeshFileError("holds no triangles")
    start = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [np.asarray(part.faces, np.int64).reshape(-1, 3) for part in parts]
    cells = np.concatenate([own + n for own, n in zip(faces, start[:-1], strict=True)])
    points = np.concatenate([np.asarray(part.vertices, np.float64) for part in parts])
    if len(parts) == 1:
        return RawMesh(points, [("triangle", cells)], is_surface=True)
    tags = np.repeat(np.arange(1, len(parts) + 1, dtype=np.int32), [len(own) for own in faces])
    names = {(2, k): str(part.metadata.get("node", k)) for k, part in enumerate(parts, start=1)}
    tagged = {"cell_tags": [tags]}
    return RawMesh(points, [("triangle", cells)], {}, tagged, names, is_surface=True)


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
