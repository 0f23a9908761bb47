"""The formats of files: suffixes, who reads and writes them, and what they hold.

Formats of a package inside of this one are added from its table ``FORMATS``.  Nothing else knows of
such a package: without it, its formats are unknown.

Formats that the readers of other packages cannot read safely are left out: in some formats nothing
shows that a file ends early.
"""

from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from adaptsize import _formats
from adaptsize._checks import describe, refusal
from adaptsize._formats import completeness as check
from adaptsize._formats import for_solvers as solvers
from adaptsize._formats import nastran, sizes, vtk
from adaptsize._formats import writers as write
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._formats.format import ALL, FORMATS, IN_HDF, LEGACY, QUOTED, WORD, Format
from adaptsize._formats.guards import about_file, check_readable, files_named_in
from adaptsize._formats.limited import read_limited
from adaptsize._formats.raster import is_image_file
from adaptsize._formats.surfaces import read_off, read_stl
from adaptsize.errors import MeshFileError

__all__ = ["FORMATS", "Format", "check_end", "check_named", "format_of", "load"]

_SU2, _VTK, _TRIMESH = (
    partial(read_limited, f"foreign.read_{name}") for name in ("su2", "vtk", "trimesh")
)
_ABAQUS, _GMSH, _MEDIT, _XDMF = (
    partial(read_limited, f"{name}.read") for name in ("abaqus", "gmsh", "medit", "xdmf")
)
_of_vtk = {
    name: partial(write.write_vtk, suffix=f".{name}") for name in ("vtu", "vtp", "vtk", "vtkhdf")
}
_surface = {name: partial(write.write_surface, file_format=name) for name in ("ply", "obj", "off")}
_stl = partial(write.write_surface, file_format="stl", binary=True)
_CELLS, _TRIANGLES = frozenset({"cells", "tags"}), frozenset({"triangles"})
_PLY, _GRIDS = _TRIANGLES | {"fields"}, frozenset({"grids", "fields"})
_SOLVERS, _ALL_2 = _CELLS | {"order 2"}, ALL | {"order 2"}
_NODAL_2 = _ALL_2 - {"cell fields"}
_SIZES, _FULL = frozenset({"sizes", "metrics"}), (2, 3)
#: JIGSAW's longer suffix stands before Gmsh's.
_OWN: dict[str, Format] = {
    "jigsaw": Format((".jig.msh",), sizes.write_jigsaw, holds=_SIZES - {"metrics"}, dims=_FULL),
    "gmsh-view": Format((".pos",), sizes.write_view, holds=_SIZES),
    "medit-sol": Format((".sol",), sizes.write_sol, holds=_SIZES),
    "vti": Format((".vti",), vtk.write_image, None, check.check_vtk_xml, holds=_GRIDS),
    "vtu": Format((".vtu",), _of_vtk["vtu"], _VTK, check.check_vtk_xml, holds=_ALL_2),
    "vtp": Format((".vtp",), _of_vtk["vtp"], _VTK, check.check_vtk_xml, most_dim=2),
    "vtk-xml": Format((".vtr", ".vts", ".vtm", ".pvtu", ".pvtp"), None, _VTK, check.check_vtk_xml),
    "vtk": Format((".vtk",), _of_vtk["vtk"], _VTK, check.check_vtk, None, _ALL_2, names=LEGACY),
    "vtkhdf": Format((".vtkhdf",), _of_vtk["vtkhdf"], _VTK, holds=_ALL_2, names=IN_HDF),
    "xdmf": Format((".xdmf", ".xmf"), write.write_xdmf, _XDMF),
    "gmsh": Format(
        (".msh",), write.write_gmsh, _GMSH, check.check_gmsh, None, _NODAL_2, names=QUOTED
    ),
    "medit": Format((".mesh", ".meshb"), write.write_medit, _MEDIT, holds=_CELLS),
    "stl": Format((".stl",), _stl, read_stl, holds=_TRIANGLES),
    "ply": Format((".ply",), _surface["ply"], _TRIMESH, None, check.check_ply, _PLY, names=WORD),
    "obj": Format((".obj",), _surface["obj"], _VTK, None, check.check_obj, _TRIANGLES),
    "off": Format((".off",), _surface["off"], read_off, holds=_TRIANGLES),
    "gltf": Format((".gltf", ".glb", ".3mf"), None, _TRIMESH),
    "abaqus": Format((".inp",), solvers.write_abaqus, _ABAQUS, None, check.check_abaqus, _SOLVERS),
    "nastran": Format(
        (".bdf", ".nas", ".fem"), solvers.write_nastran, nastran.read, holds=_SOLVERS
    ),
    "su2": Format(
        (".su2",),
        solvers.write_su2,
        _SU2,
        check.check_su2_points,
        check.check_su2,
        _CELLS,
        _FULL,
    ),
}
FORMATS.update(_OWN)
for _room in iter_modules(_formats.__path__):
    if _room.ispkg:
        FORMATS.update(import_module(f"{_formats.__name__}.{_room.name}").FORMATS)
#: What other functions read, or write.
_ELSEWHERE = {
    ".vti": "holds a grid, not a mesh; use read_size",
    **dict.fromkeys((".step", ".stp", ".brep"), "holds a CAD model, not a mesh; use read_cad"),
}
#: What readers of ours raise on damaged files.
_DAMAGE = (ArithmeticError, AttributeError, LookupError, SyntaxError, TypeError)


def load(path: Path) -> RawMesh:
    """Return the checked content of a mesh file.  Failures are MeshFileErrors without the path."""
    check_readable(path)
    suffix = path.suffix.lower()
    if suffix in _ELSEWHERE:
        raise MeshFileError(_ELSEWHERE[suffix])
    if is_image_file(path):
        raise MeshFileError("holds an image, not a mesh; mesh_image or 'adaptsize image' meshes it")
    found = _of_suffix(suffix)
    if found is None or found.read is None:
        known = [s for form in FORMATS.values() if form.read for s in form.suffixes]
        raise MeshFileError(
            f"has a suffix that no reader knows ({suffix or 'none'}); these can be read: "
            f"{', '.join(known)}; 'meshio convert' may make a .vtu file of it"
        )
    content = path.read_bytes()
    check_end(suffix, content)
    check_named(path)
    try:
        raw = found.read(path)
    except MeshFileError:
        raise
    except (*_DAMAGE, ValueError) as error:
        raise MeshFileError(f"cannot be read as a mesh ({error})") from error
    raw.is_surface |= "triangles" in found.holds
    check_raw(raw)
    if found.check_counts is not None:
        found.check_counts(content, raw)
    return raw


def check_end(suffix: str, content: bytes) -> None:
    """Refuse a file that lacks the end mark of its format, before it is read."""
    found = _of_suffix(suffix)
    if found is not None and found.check_end is not None:
        found.check_end(content)


def check_named(path: Path, first: int = 0, step: int = 1) -> None:
    """Refuse a file that names incomplete ones; of these, every ``step``-th is checked."""
    for file in sorted(files_named_in(path))[first::step]:
        try:
            check_end(file.suffix.lower(), file.read_bytes())
        except MeshFileError as error:
            raise about_file(f"names {file.name}", error) from error


def _of_suffix(suffix: str) -> Format | None:
    return next((form for form in FORMATS.values() if suffix in form.suffixes), None)


def format_of(path: Path, file_format: str | None) -> Format:
    """Return the requested format, or the one of the file's suffix, if it can be written."""
    written = {name: form for name, form in FORMATS.items() if form.write is not None}
    listed = ", ".join(f"{name} {'/'.join(form.suffixes)}" for name, form in written.items())
    if file_format is not None:
        if not isinstance(file_format, str) or file_format not in written:
            raise ValueError(f"file_format must be one of {listed}, got {describe(file_format)}")
        return written[file_format]
    name = path.name.lower()
    for candidate in written.values():
        if name.endswith(candidate.suffixes):
            return candidate
    raise refusal(
        "path",
        f"must end in a suffix that can be written ({listed}; 'meshio convert' makes others of a "
        f".msh file), got {path}",
    )
