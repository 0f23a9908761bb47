"""Which reader reads which mesh file.

Formats that the readers of other packages cannot read safely are left out: in some formats nothing
shows that a file ends early.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from adaptsize._formats import fort14, polygon_files
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._formats.completeness import STL, check_counts, check_end, check_named
from adaptsize._formats.guards import check_readable
from adaptsize._formats.limited import read_limited
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import MeshFileError

_NO_MESHES = {
    ".vti": "holds a grid, not a mesh; use read_size",
    **dict.fromkeys((".step", ".stp", ".brep"), "holds a CAD model, not a mesh; use read_cad"),
}
#: What readers of ours raise on damaged files.
_DAMAGE = (ArithmeticError, AttributeError, LookupError, SyntaxError, TypeError)


def load(path: Path) -> RawMesh:
    """Return the checked content of a mesh file.  Failures are MeshFileErrors without the path."""
    check_readable(path)
    suffix = path.suffix.lower()
    if suffix in _NO_MESHES:
        raise MeshFileError(_NO_MESHES[suffix])
    if suffix not in _LOADERS:
        raise MeshFileError(
            f"has a suffix that no reader knows ({suffix or 'none'}); these can be read: "
            f"{', '.join(_LOADERS)}; meshio may read it: "
            "SimplexMesh.from_meshio(meshio.read(path))"
        )
    content = path.read_bytes()
    check_end(suffix, content)
    check_named(path)
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
    except (*_DAMAGE, ValueError) as error:
        raise MeshFileError(f"cannot be read as a mesh ({error})") from error
    check_raw(raw)
    return raw


def _load_stl(path: Path) -> RawMesh:
    found = _by_trimesh(path)
    with np.errstate(invalid="ignore"):  # numbers that are not finite are refused later
        points, number = merge_equal_points(found.points)
    return RawMesh(points, [("triangle", number[cells]) for _, cells in found.blocks])


_by_meshio, _by_vtk, _by_trimesh = (
    partial(read_limited, f"read_{name}") for name in ("meshio", "vtk", "trimesh")
)
#: Each suffix that can be read, with the readers in the order in which they are tried.
_LOADERS: dict[str, tuple[Callable[[Path], RawMesh], ...]] = {
    **dict.fromkeys(STL, (_load_stl,)),
    ".obj": (_by_meshio, _by_trimesh),  # meshio does not know all spellings
    **dict.fromkeys((".ply", ".off", ".gltf", ".glb", ".3mf"), (_by_trimesh,)),
    **dict.fromkeys((".vtk", ".vtu", ".vtp", ".vtr", ".vts", ".vtm", ".vtkhdf"), (_by_vtk,)),
    **dict.fromkeys((".pvtu", ".pvtp"), (_by_vtk,)),
    **dict.fromkeys((".msh", ".mesh", ".meshb", ".inp", ".su2", ".xdmf", ".xmf"), (_by_meshio,)),
    **dict.fromkeys((".bdf", ".nas", ".fem"), (_by_meshio,)),
    **dict.fromkeys((".14", ".grd", ".gr3"), (fort14.read,)),
    **dict.fromkeys(polygon_files.READERS, (polygon_files.load,)),
}
