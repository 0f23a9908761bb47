"""Which reader reads which mesh file.

meshio and trimesh print, warn on consoles and even exit.  Formats that their readers cannot read
safely are left out: some readers run forever on a damaged file, and in some formats nothing
shows that a file ends early.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from adaptsize._formats import fort14
from adaptsize._formats.blocks import RawMesh, check_raw, join
from adaptsize._formats.completeness import check_counts, check_end
from adaptsize._formats.gmsh import is_partitioned, read_blocks, read_names, read_view
from adaptsize._formats.guards import FOREIGN_FAILURES, quiet, reason
from adaptsize._formats.surfaces import read_corners, read_off, read_ply
from adaptsize._formats.vtk_xml import read_xdmf
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import MeshFileError


def load(path: Path) -> RawMesh:
    """Return the checked content of a mesh file.  Failures are MeshFileErrors without the path."""
    suffix = path.suffix.lower()
    if suffix == ".vti":
        raise MeshFileError("holds a grid, not a mesh; use read_size")
    if suffix in (".step", ".stp", ".brep"):
        raise MeshFileError("holds a CAD model, not a mesh; use read_cad")
    if suffix not in _LOADERS:
        raise MeshFileError(
            f"has a suffix that no reader knows ({suffix or 'none'}); these can be read: "
            f"{', '.join(_LOADERS)}; meshio may read it: "
            "SimplexMesh.from_meshio(meshio.read(path))"
        )
    content = path.read_bytes()
    check_end(suffix, content)
    first_failure: MeshFileError | None = None
    for loader in _LOADERS[suffix]:
        try:
            raw = _loaded(loader, path)
        except MeshFileError as error:
            first_failure = first_failure or error
        else:
            check_counts(suffix, content, raw)
            return raw
    assert first_failure is not None
    raise first_failure


def _loaded(loader: Callable[[Path], RawMesh], path: Path) -> RawMesh:
    try:
        raw = loader(path)
    except MeshFileError:
        raise
    except FOREIGN_FAILURES as error:
        raise MeshFileError(f"cannot be read as a mesh ({reason(error)})") from error
    check_raw(raw)
    return raw


def _load_stl(path: Path) -> RawMesh:
    corners = read_corners(path)
    points, number = merge_equal_points(corners.reshape(-1, 3))
    return RawMesh(points, [("triangle", number.reshape(-1, 3))])


def _load_with_meshio(path: Path) -> RawMesh:
    import meshio

    file_format = "gmsh" if path.suffix.lower() == ".msh" else None
    with quiet() as printed:
        try:
            mesh = meshio.read(path, file_format=file_format)
        except FOREIGN_FAILURES as error:
            text = reason(error, printed.getvalue())
            raise MeshFileError(f"cannot be read as a mesh ({text})") from error
    # Otherwise meshio omits such cells and prints a line.
    unknown = re.search(r"cells that meshio cannot handle \(type (\d+)", printed.getvalue())
    if unknown:
        raise MeshFileError(f"holds cells of VTK type {unknown[1]}, which cannot be read")
    points = np.asarray(mesh.points, dtype=np.float64)
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    return RawMesh(points, blocks, mesh.point_data, mesh.cell_data, read_names(path))


def _load_gmsh(path: Path) -> RawMesh:
    """Read a file of Gmsh; meshio does not know the sections of partitioned ones."""
    if is_partitioned(path):
        return read_blocks(path)
    return _load_with_meshio(path)


def _load_vtk_of_new_types(path: Path) -> RawMesh:
    """Read a legacy VTK file whose integer arrays have the type names of VTK 9.

    meshio accepts these names only in files of version 5.1, but VTK writes them in older versions.
    """
    return _load_edited(path, rb"(?m)\bvtktypeint64(\s*)$", rb"long\1")


def _load_gmsh_without_cell_fields(path: Path) -> RawMesh:
    """Read a Gmsh file of version 2 with element fields, which meshio does not support."""
    raw = _load_edited(path, rb"(?ms)^\$ElementData\r?\n.*?^\$EndElementData\r?\n", b"")
    raw.notes.append("cell fields ($ElementData) left out")
    return raw


def _load_edited(path: Path, pattern: bytes, replacement: bytes) -> RawMesh:
    """Read an edited copy with meshio, whose readers need a file."""
    content, count = re.subn(pattern, replacement, path.read_bytes())
    if not count:
        raise MeshFileError("cannot be read as a mesh")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        copy.write_bytes(content)
        return _load_with_meshio(copy)


def _load_vtu(path: Path) -> RawMesh:
    n_pieces = path.read_bytes().split(b"<AppendedData", 1)[0].count(b"<Piece")
    return _load_vtu_pieces(path) if n_pieces > 1 else _load_with_meshio(path)


def _load_vtu_pieces(path: Path) -> RawMesh:
    """Read each piece of a VTU file separately.  meshio keeps only the cells of the last piece."""
    try:
        tree = ElementTree.parse(path)
    except (ElementTree.ParseError, ValueError) as error:
        raise MeshFileError(f"has several pieces and is not plain XML ({error})") from error
    grid = tree.getroot().find("UnstructuredGrid")
    if grid is None:
        raise MeshFileError("cannot be read as a mesh (no UnstructuredGrid)")
    pieces = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        for piece in grid.findall("Piece"):
            if int(piece.get("NumberOfCells", "1")) == 0:
                continue
            grid[:] = [piece]
            tree.write(copy)
            pieces.append(_load_with_meshio(copy))
    if not pieces:
        raise MeshFileError("holds no cells")
    return join(pieces)


def _load_with_trimesh(path: Path) -> RawMesh:
    import trimesh

    with quiet():
        mesh: Any = trimesh.load_mesh(path, process=False)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    if path.suffix.lower() == ".obj" and len(points) and np.isfinite(points).all():
        # One node per pair of position and texture corner: seams would be cracks.
        points, number = merge_equal_points(points)
        faces = number[faces]
    return RawMesh(points, [("triangle", faces)])


#: Each suffix that can be read, with the readers in the order in which they are tried.
_LOADERS: dict[str, tuple[Callable[[Path], RawMesh], ...]] = {
    **dict.fromkeys((".stl", ".stla", ".stlb"), (_load_stl,)),
    ".obj": (_load_with_meshio, _load_with_trimesh),  # meshio does not know all spellings
    ".off": (read_off,),
    ".ply": (read_ply,),
    **dict.fromkeys((".gltf", ".glb"), (_load_with_trimesh,)),
    ".vtk": (_load_with_meshio, _load_vtk_of_new_types),
    ".vtu": (_load_vtu,),
    **dict.fromkeys((".xdmf", ".xmf"), (_load_with_meshio, read_xdmf)),  # meshio needs h5py
    ".msh": (_load_gmsh, _load_gmsh_without_cell_fields),
    **dict.fromkeys(
        (".mesh", ".meshb", ".inp", ".bdf", ".nas", ".fem", ".su2"), (_load_with_meshio,)
    ),
    **dict.fromkeys((".14", ".grd", ".gr3"), (fort14.read,)),
    ".pos": (read_view,),
}
