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
from adaptsize._formats import completeness, fort14, polygon_files, writers
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._formats.guards import about_file, check_readable, files_named_in
from adaptsize._formats.limited import read_limited
from adaptsize._formats.solvers import write_abaqus, write_nastran, write_su2
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.merging import merge_equal_points
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
    readers: tuple[Callable[[Path], RawMesh], ...] = ()
    """In the order in which they are tried."""
    check_end: Callable[[bytes], None] = lambda _: None
    """Refuses a file without its end mark, before it is read."""
    check_counts: Callable[[bytes, RawMesh], None] = lambda *_: None
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
            return partial(writers.write_vti, grid=background, fields=arrays)
        at_nodes = {name: values.reshape(-1) for name, values in arrays.items()}
        return partial(self.write, mesh=background.mesh.with_data(point_data=at_nodes))


def _load_stl(path: Path) -> RawMesh:
    found = _by_trimesh(path)
    with np.errstate(invalid="ignore"):  # numbers that are not finite are refused later
        points, number = merge_equal_points(found.points)
    return RawMesh(points, [("triangle", number[cells]) for _, cells in found.blocks])


_by_meshio, _by_vtk, _by_trimesh = (
    partial(read_limited, f"read_{name}") for name in ("meshio", "vtk", "trimesh")
)
#: In the order in which suffixes are tried: JIGSAW's longer suffix before Gmsh's.
FORMATS: dict[str, Format] = {
    "jigsaw": Format(
        (".jig.msh",), writers.write_jigsaw, only_sizes=True, only_full=True, holds_metrics=False
    ),
    "gmsh-view": Format((".pos",), writers.write_view, only_sizes=True),
    "medit-sol": Format((".sol",), writers.write_sol, only_sizes=True),
    "vti": Format(
        (".vti",), writers.refuse_mesh, check_end=completeness.check_vtk_xml, holds_grids=True
    ),
    **{
        name: Format(
            (f".{name}",),
            partial(writers.write_vtk, suffix=f".{name}"),
            (_by_vtk,),
            completeness.check_vtk_xml,
        )
        for name in ("vtu", "vtp")
    },
    "vtk-xml": Format(
        (".vtr", ".vts", ".vtm", ".pvtu", ".pvtp"), None, (_by_vtk,), completeness.check_vtk_xml
    ),
    "vtk": Format(
        (".vtk",),
        partial(writers.write_vtk, suffix=".vtk"),
        (_by_vtk,),
        completeness.check_vtk,
        names=_LEGACY,
    ),
    "vtkhdf": Format(
        (".vtkhdf",), partial(writers.write_vtk, suffix=".vtkhdf"), (_by_vtk,), names=_IN_HDF
    ),
    "xdmf": Format((".xdmf", ".xmf"), writers.write_xdmf, (_by_meshio,)),
    "gmsh": Format(
        (".msh",), writers.write_gmsh, (_by_meshio,), completeness.check_gmsh, names=_QUOTED
    ),
    "medit": Format(
        (".mesh", ".meshb"),
        writers.write_medit,
        (_by_meshio,),
        completeness.check_medit_end,
        holds_fields=False,
    ),
    "stl": Format(
        (".stl",),
        partial(writers.write_surface, file_format="stl", binary=True),
        (_load_stl,),
        completeness.check_stl_end,
        completeness.check_stl,
        holds_fields=False,
        only_triangles=True,
    ),
    **{
        name: Format(
            (f".{name}",),
            partial(writers.write_surface, file_format=name),
            readers,
            check_counts=check_counts,
            holds_fields=name == "ply",
            holds_metrics=False,
            only_triangles=True,
            names=_WORD,
        )
        for name, readers, check_counts in (
            ("ply", (_by_trimesh,), completeness.check_ply),
            # meshio does not know all spellings
            ("obj", (_by_meshio, _by_trimesh), completeness.check_obj),
            ("off", (_by_trimesh,), completeness.check_off),
        )
    },
    "gltf": Format((".gltf", ".glb", ".3mf"), None, (_by_trimesh,)),
    "fort.14": Format(
        (".14", ".grd", ".gr3"), fort14.write, (fort14.read,), holds_fields=False, only_full=True
    ),
    "abaqus": Format(
        (".inp",),
        write_abaqus,
        (_by_meshio,),
        check_counts=completeness.check_abaqus,
        holds_fields=False,
    ),
    "nastran": Format(
        (".bdf", ".nas", ".fem"),
        write_nastran,
        (_by_meshio,),
        completeness.check_nastran_end,
        holds_fields=False,
    ),
    "su2": Format(
        (".su2",),
        write_su2,
        (_by_meshio,),
        completeness.check_su2_points,
        completeness.check_su2,
        holds_fields=False,
        only_full=True,
    ),
    "polygons": Format(tuple(polygon_files.READERS), None, (polygon_files.load,)),
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
    if found is None or not found.readers:
        known = [s for form in FORMATS.values() if form.readers for s in form.suffixes]
        raise MeshFileError(
            f"has a suffix that no reader knows ({suffix or 'none'}); these can be read: "
            f"{', '.join(known)}; meshio may read it: "
            "SimplexMesh.from_meshio(meshio.read(path))"
        )
    content = path.read_bytes()
    found.check_end(content)
    check_named(path)
    first_failure: MeshFileError | None = None
    for reader in found.readers:
        try:
            raw = _loaded(reader, path)
        except MeshFileError as error:
            first_failure = first_failure or error
        else:
            found.check_counts(content, raw)
            return raw
    assert first_failure is not None
    raise first_failure


def check_named(path: Path, first: int = 0, step: int = 1) -> None:
    """Refuse a file that names incomplete ones; of these, every ``step``-th is checked."""
    for file in sorted(files_named_in(path))[first::step]:
        found = _of_suffix(file.suffix.lower())
        try:
            if found is not None:
                found.check_end(file.read_bytes())
        except MeshFileError as error:
            raise about_file(f"names {file.name}", error) from error


def _of_suffix(suffix: str) -> Format | None:
    return next((form for form in FORMATS.values() if suffix in form.suffixes), None)


def _loaded(reader: Callable[[Path], RawMesh], path: Path) -> RawMesh:
    try:
        raw = reader(path)
    except MeshFileError:
        raise
    except (*_DAMAGE, ValueError) as error:
        raise MeshFileError(f"cannot be read as a mesh ({error})") from error
    check_raw(raw)
    return raw


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
