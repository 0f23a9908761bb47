"""Which reader reads which mesh file.

Formats that the readers of other packages cannot read safely are left out: in some formats nothing
shows that a file ends early.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adaptsize._formats import fort14, polygon_files
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._formats.completeness import check_counts, check_end
from adaptsize._formats.gmsh import is_partitioned, read_blocks, read_names, read_view
from adaptsize._formats.limited import read_limited
from adaptsize._formats.surfaces import read_corners, read_off, read_ply
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
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        SyntaxError,
        TypeError,
        ValueError,
    ) as error:
        raise MeshFileError(f"cannot be read as a mesh ({error})") from error
    check_raw(raw)
    return raw


def _limited(function: str, *arguments: object) -> Callable[[Path], RawMesh]:
    """Return a reader by another package."""
    return lambda path: RawMesh.unpacked(read_limited(function, path, *arguments))


def _load_stl(path: Path) -> RawMesh:
    corners = read_corners(path)
    with np.errstate(invalid="ignore"):  # numbers that are not finite are refused later
        points, number = merge_equal_points(corners.reshape(-1, 3))
    return RawMesh(points, [("triangle", number.reshape(-1, 3))])


def _load_pieces(path: Path) -> RawMesh:
    """Read a file in pieces, and merge the points at which they meet."""
    raw = _limited("read_vtk")(path)
    check_raw(raw)
    points, number = merge_equal_points(raw.points)
    first = np.full(len(points), len(number))
    np.minimum.at(first, number, np.arange(len(number)))
    raw.point_data = {name: values[first] for name, values in raw.point_data.items()}
    raw.points, raw.blocks = points, [(name, number[cells]) for name, cells in raw.blocks]
    return raw


def _load_edited(path: Path, pattern: str, new: str) -> RawMesh:
    """Read a copy of a file, in which a pattern is replaced, by meshio."""
    with tempfile.TemporaryDirectory() as folder:
        copy = str(Path(folder, path.name))
        return _limited("read_meshio_edited", pattern, new, copy)(path)


def _load_gmsh(path: Path) -> RawMesh:
    """Read a file of Gmsh; meshio does not know the sections of partitioned ones."""
    if is_partitioned(path):
        return read_blocks(path)
    with path.open("rb") as file:
        is_4_0 = re.match(rb"\$MeshFormat\s+4\s", file.read(100))
    if is_4_0:  # meshio takes this for version 4.1
        raw = _load_edited(path, r"\A\$MeshFormat\s+4(?=\s)", "$MeshFormat\n4.0")
    else:
        raw = _limited("read_meshio")(path)
    raw.tag_names = read_names(path)
    return raw


def _load_gmsh_without_cell_fields(path: Path) -> RawMesh:
    """Read a Gmsh file of version 2 with element fields, which meshio does not support."""
    raw = _load_edited(path, r"(?ms)^\$ElementData\r?\n.*?^\$EndElementData\r?\n", "")
    raw.tag_names = read_names(path)
    raw.notes.append("cell fields ($ElementData) left out")
    return raw


def _load_bulk(path: Path) -> RawMesh:
    """Read a Nastran file that consists of bulk data only, as Gmsh writes them."""
    return _load_edited(path, r"(?m)\A(?![\s\S]*^BEGIN BULK)", "BEGIN BULK\n")


def _load_scene(path: Path) -> RawMesh:
    raw = _limited("read_trimesh")(path)
    if path.suffix.lower() == ".obj" and len(raw.points) and np.isfinite(raw.points).all():
        # One node per pair of position and texture corner: seams would be cracks.
        raw.points, number = merge_equal_points(raw.points)
        raw.blocks = [(name, number[cells]) for name, cells in raw.blocks]
    return raw


_load_with_meshio, _load_with_vtk = _limited("read_meshio"), _limited("read_vtk")
#: Each suffix that can be read, with the readers in the order in which they are tried.
_LOADERS: dict[str, tuple[Callable[[Path], RawMesh], ...]] = {
    **dict.fromkeys((".stl", ".stla", ".stlb"), (_load_stl,)),
    ".obj": (_load_with_meshio, _load_scene),  # meshio does not know all spellings
    ".off": (read_off,),
    ".ply": (read_ply,),
    **dict.fromkeys((".gltf", ".glb", ".3mf"), (_load_scene,)),
    **dict.fromkeys((".vtk", ".vtu", ".vtp", ".vtr", ".vts", ".vtm", ".vtkhdf"), (_load_with_vtk,)),
    **dict.fromkeys((".pvtu", ".pvtp"), (_load_pieces,)),
    ".msh": (_load_gmsh, _load_gmsh_without_cell_fields),
    **dict.fromkeys((".mesh", ".meshb", ".inp", ".su2", ".xdmf", ".xmf"), (_load_with_meshio,)),
    **dict.fromkeys((".bdf", ".nas", ".fem"), (_load_with_meshio, _load_bulk)),
    **dict.fromkeys((".14", ".grd", ".gr3"), (fort14.read,)),
    ".pos": (read_view,),
    **dict.fromkeys(polygon_files.READERS, (polygon_files.load,)),
}
