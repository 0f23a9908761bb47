"""The formats of files: suffixes, who reads and writes them, and what they hold.

Formats that the readers of other packages cannot read safely are left out: in some formats nothing
shows that a file ends early.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize._formats import completeness as check
from adaptsize._formats import fort14, polygon_files
from adaptsize._formats import writers as write
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._formats.guards import about_file, check_readable, files_named_in
from adaptsize._formats.limited import read_limited
from adaptsize._formats.solvers import write_abaqus, write_nastran, write_su2
from adaptsize._formats.surfaces import read_off, read_stl
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.errors import MeshFileError

#: What names of fields must match: texts that XML can hold, at most 100 characters.
_IN_XML = re.compile(r"[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]{1,100}")
#: HDF5 takes slashes for groups, and VTK replaces dots.
_IN_HDF = re.compile(r"[^\x00/.\ud800-\udfff]{1,100}")
#: VTK takes braces in names for formats and aborts, and reads 255 bytes, encoded as in addresses.
_LEGACY = re.compile(
    r"[^{}\x00-\x1f\x7f-\uffff\U00010000-\U0010ffff]{1,80}|[^{}\x00-\x1f\x7f-\x9f\ud800-\udfff]{1,20}"
)
#: Texts in quotation marks on one line, and words.
_QUOTED = re.compile(r"[^\x00-\x1f\x7f-\xa0\"\\\u2028\u2029\ud800-\udfff]{1,100}")
_WORD = re.compile(r"(?![xyz]$)[!-~]{1,100}")


@dataclass(frozen=True)
class Format:
    """A format that can be read, written, or both."""

    suffixes: tuple[str, ...]
    write: Callable[..., None] | None
    """Takes the path and ``mesh``, a SimplexMesh."""
    read: Callable[[Path], RawMesh] | None = None
    check_end: Callable[[bytes], None] | None = None
    """Refuses a file without its end mark, before it is read."""
    check_counts: Callable[[bytes, RawMesh], None] | None = None
    """Refuses a mesh with less than its file promises."""
    holds_fields: bool = True
    """Whether the file can hold nodal fields."""
    holds_grids: bool = False
    """Whether the file holds Cartesian grids instead of meshes."""
    only_sizes: bool = False
    """Whether the file holds only nodal sizes for a mesh generator."""
    holds_metrics: bool = True
    """Whether the file can hold a metric."""
    only_triangles: bool = False
    """Whether the file holds only triangles: of tetrahedra, those of the boundary."""
    only_full: bool = False
    """Whether the cells must be triangles in the plane or tetrahedra."""
    names: re.Pattern[str] = _IN_XML
    """What the names of fields must match."""

    def check_names(self, path: Path, fields: Iterable[str], tags: Iterable[str]) -> None:
        """Refuse names that could not be read back."""
        fields = fields if self.holds_fields and not self.only_sizes else ()
        tags = () if self.only_sizes or self.only_triangles else tags
        bad = [name for name in fields if not self.names.fullmatch(name)]
        bad += [name for name in tags if not _QUOTED.fullmatch(name)]
        if bad:
            raise ValueError(f"{path.name} cannot hold the name {describe(bad[0])}; rename it")

    def writing(
        self, background: SimplexMesh | CartesianGrid, nodal: Mapping[str, npt.ArrayLike]
    ) -> Callable[[Path], None]:
        """Return the function that writes a mesh or grid with fields to a path."""
        assert self.write is not None
        if isinstance(background, SimplexMesh):
            return partial(self.write, mesh=background.with_data(point_data=nodal))
        arrays = {name: np.asarray(values) for name, values in nodal.items()}
        for name, values in arrays.items():
            if values.shape != background.shape:
                raise ValueError(
                    f"fields[{name!r}] must have shape {background.shape}, got {values.shape}"
                )
        if self.holds_grids:
            return partial(write.write_vti, grid=background, fields=arrays)
        at_nodes = {name: values.reshape(-1) for name, values in arrays.items()}
        return partial(self.write, mesh=background.mesh.with_data(point_data=at_nodes))


_MESHIO, _VTK, _TRIMESH = (
    partial(read_limited, f"read_{name}") for name in ("meshio", "vtk", "trimesh")
)
_cells = partial(Format, holds_fields=False)
_triangles = partial(Format, only_triangles=True, holds_metrics=False, names=_WORD)
_OF_VTK = ("vtu", "vtp", "vtk", "vtkhdf")
_by_vtk = {name: partial(write.write_vtk, suffix=f".{name}") for name in _OF_VTK}
_surface = {name: partial(write.write_surface, file_format=name) for name in ("ply", "obj", "off")}
_stl = partial(write.write_surface, file_format="stl", binary=True)
#: In the order in which suffixes are tried: JIGSAW's longer suffix before Gmsh's.
FORMATS: dict[str, Format] = {
    "jigsaw": Format(
        (".jig.msh",), write.write_jigsaw, only_sizes=True, only_full=True, holds_metrics=False
    ),
    "gmsh-view": Format((".pos",), write.write_view, only_sizes=True),
    "medit-sol": Format((".sol",), write.write_sol, only_sizes=True),
    "vti": Format((".vti",), write.refuse_mesh, None, check.check_vtk_xml, holds_grids=True),
    "vtu": Format((".vtu",), _by_vtk["vtu"], _VTK, check.check_vtk_xml),
    "vtp": Format((".vtp",), _by_vtk["vtp"], _VTK, check.check_vtk_xml),
    "vtk-xml": Format((".vtr", ".vts", ".vtm", ".pvtu", ".pvtp"), None, _VTK, check.check_vtk_xml),
    "vtk": Format((".vtk",), _by_vtk["vtk"], _VTK, check.check_vtk, names=_LEGACY),
    "vtkhdf": Format((".vtkhdf",), _by_vtk["vtkhdf"], _VTK, names=_IN_HDF),
    "xdmf": Format((".xdmf", ".xmf"), write.write_xdmf, _MESHIO),
    "gmsh": Format((".msh",), write.write_gmsh, _MESHIO, check.check_gmsh, names=_QUOTED),
    "medit": _cells((".mesh", ".meshb"), write.write_medit, _MESHIO, check.check_medit_end),
    "stl": _triangles((".stl",), _stl, read_stl, holds_fields=False),
    "ply": _triangles((".ply",), _surface["ply"], _TRIMESH, check_counts=check.check_ply),
    "obj": _triangles(
        (".obj",), _surface["obj"], _VTK, None, check.check_obj, holds_fields=False
    ),
    "off": _triangles((".off",), _surface["off"], read_off, holds_fields=False),
    "gltf": Format((".gltf", ".glb", ".3mf"), None, _TRIMESH),
    "fort.14": _cells((".14", ".grd", ".gr3"), fort14.write, fort14.read, only_full=True),
    "abaqus": _cells((".inp",), write_abaqus, _MESHIO, None, check.check_abaqus),
    "nastran": _cells((".bdf", ".nas", ".fem"), write_nastran, _MESHIO, check.check_nastran_end),
    "su2": _cells(
        (".su2",), write_su2, _MESHIO, check.check_su2_points, check.check_su2, only_full=True
    ),
    "polygons": Format(tuple(polygon_files.READERS), None, polygon_files.load),
}
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
    found = _of_suffix(suffix)
    if found is None or found.read is None:
        known = [s for form in FORMATS.values() if form.read for s in form.suffixes]
        raise MeshFileError(
            f"has a suffix that no reader knows ({suffix or 'none'}); these can be read: "
            f"{', '.join(known)}; meshio may read it: "
            "SimplexMesh.from_meshio(meshio.read(path))"
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
    raise ValueError(
        f"path must end in a suffix that can be written ({listed}; "
        f"'meshio convert' makes others of a .vtu file), got {path}"
    )
