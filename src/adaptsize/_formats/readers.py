"""Reading through meshio and trimesh.  These packages print, warn on consoles and even exit."""

from __future__ import annotations

import binascii
import lzma
import re
import struct
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from adaptsize._formats import gmsh_names, stl, xdmf
from adaptsize._formats.blocks import RawMesh, check_raw, join
from adaptsize._formats.promised import check_faces
from adaptsize._formats.quietness import quiet
from adaptsize.errors import MeshFileError

# Whatever a parser may raise on a file that is not what it expects; not KeyboardInterrupt.
# meshio calls sys.exit, and both packages let errors of numpy, zlib and xml through.
FOREIGN_FAILURES: tuple[type[BaseException], ...] = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    BufferError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    StopIteration,
    SyntaxError,
    SystemExit,
    TypeError,
    ValueError,
    binascii.Error,
    lzma.LZMAError,
    struct.error,
    zlib.error,
)

# meshio knows these too, but reads less of them (polygons, comments, negative indices).
_TRIMESH_SUFFIXES = (".obj", ".off", ".ply")
# Formats whose suffix meshio tries in an order of its own, printing what fails.
_FIRST_FORMAT = {".msh": ("gmsh", "ansys")}


def load(path: Path) -> RawMesh:
    """Return the checked content of a mesh file.  Failures are MeshFileErrors without the path."""
    suffix = path.suffix.lower()
    if suffix == ".vti":
        raise MeshFileError("holds a grid, not a mesh; use read_size")
    loaders: list[Callable[[Path], RawMesh]] = []
    if suffix in (".stl", ".stla", ".stlb"):
        loaders = [_load_stl]
    elif suffix == ".vtu" and _count_pieces(path) > 1:
        loaders = [_load_vtu_pieces]
    elif _meshio_knows(path):
        loaders = [_load_with_meshio]
        loaders += {
            ".vtk": [_load_vtk_of_new_types],
            ".msh": [_load_gmsh_without_cell_fields],
            ".xdmf": [_load_text_xdmf],
            ".xmf": [_load_text_xdmf],
        }.get(suffix, [])
    if not loaders or suffix in _TRIMESH_SUFFIXES:
        loaders.append(_load_with_trimesh)
    first_failure: MeshFileError | None = None
    for loader in loaders:
        try:
            raw = loader(path)
            check_raw(raw)
        except MeshFileError as error:
            first_failure = first_failure or error
        else:
            check_faces(path, raw)
            return raw
    assert first_failure is not None
    raise first_failure


def foreign_failures() -> tuple[type[BaseException], ...]:
    """Return FOREIGN_FAILURES and meshio's own errors, which derive from Exception only."""
    from meshio import ReadError, WriteError
    from meshio._exceptions import CorruptionError

    return (*FOREIGN_FAILURES, ReadError, WriteError, CorruptionError)


def reason(error: BaseException, printed: str = "") -> str:
    """Return one short line with the error of another package."""
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"needs the package {error.name} (pip install {error.name})"
    text = printed if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
    line = " ".join(text.split()) or type(error).__name__
    return line if len(line) <= 160 else line[:157] + "..."


def _load_stl(path: Path) -> RawMesh:
    corners = stl.read_corners(path)
    points, number = stl.merge_equal_points(corners.reshape(-1, 3))
    return RawMesh(points, [("triangle", number.reshape(-1, 3))])


def _meshio_knows(path: Path) -> bool:
    from meshio import extension_to_filetypes

    suffixes = [s.lower() for s in path.suffixes]
    return any("".join(suffixes[-n:]) in extension_to_filetypes for n in (1, 2))


def _load_with_meshio(path: Path) -> RawMesh:
    import meshio

    formats: tuple[str | None, ...] = _FIRST_FORMAT.get(path.suffix.lower(), (None,))
    failure = ""
    for file_format in formats:
        with quiet() as printed:
            try:
                mesh = meshio.read(path, file_format=file_format)
            except foreign_failures() as error:
                failure = failure or reason(error, printed.getvalue())
                continue
        # Otherwise meshio omits such cells and prints a line.
        unknown = re.search(r"cells that meshio cannot handle \(type (\d+)", printed.getvalue())
        if unknown:
            raise MeshFileError(f"holds cells of VTK type {unknown[1]}, which cannot be read")
        points = np.asarray(mesh.points, dtype=np.float64)
        blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
        return RawMesh(points, blocks, mesh.point_data, mesh.cell_data, gmsh_names.read(path))
    raise MeshFileError(f"cannot be read as a mesh ({failure})")


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


def _count_pieces(path: Path) -> int:
    return path.read_bytes().split(b"<AppendedData", 1)[0].count(b"<Piece")


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


def _load_text_xdmf(path: Path) -> RawMesh:
    try:
        return xdmf.read(path)
    except FOREIGN_FAILURES as error:
        raise MeshFileError(f"cannot be read as a mesh ({reason(error)})") from error


def _load_with_trimesh(path: Path) -> RawMesh:
    import trimesh

    known = trimesh.available_formats() - {"zip", "tar.gz", "tar.bz2", "bz2"}
    if path.suffix.lower().lstrip(".") not in known:
        raise MeshFileError(f"has a suffix that no reader knows ({path.suffix or 'none'})")
    with quiet() as printed:
        try:
            mesh: Any = trimesh.load_mesh(path, process=False)
            points = np.asarray(mesh.vertices, dtype=np.float64)
            faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
        except foreign_failures() as error:
            text = reason(error, printed.getvalue())
            raise MeshFileError(f"cannot be read as a mesh ({text})") from error
    if path.suffix.lower() == ".obj" and len(points) and np.isfinite(points).all():
        # One node per pair of position and texture corner: seams would be cracks.
        points, number = stl.merge_equal_points(points)
        faces = number[faces]
    return RawMesh(points, [("triangle", faces)])
