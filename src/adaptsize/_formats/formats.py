"""The formats of files: suffixes, who reads and writes them, and what they hold.

Formats that the readers of other packages cannot read safely are left out: in some formats nothing
shows that a file ends early.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe, refusal
from adaptsize._formats import completeness as check
from adaptsize._formats import for_solvers as solvers
from adaptsize._formats import fort14, nastran, polygon_files, sizes, vtk
from adaptsize._formats import writers as write
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._formats.guards import about_file, check_readable, files_named_in
from adaptsize._formats.limited import read_limited
from adaptsize._formats.raster import is_image_file
from adaptsize._formats.surfaces import read_off, read_stl
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.errors import MeshFileError, OptionError
from adaptsize.metrics import MetricFunction

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

_ALL = frozenset({"cells", "tags", "fields", "cell fields", "metrics"})


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
    holds: frozenset[str] = _ALL
    """Of these words (``fields`` are those of nodes) and ``sizes`` (without cells), ``grids``,
    ``order 2`` (cells with nodes in the middles of edges), and ``triangles``: no other cells, so
    of tetrahedra those of the boundary."""
    dims: tuple[int, ...] = ()
    """Dimensions of meshes, if their cells must have the dimension of the space."""
    names: re.Pattern[str] = _IN_XML
    """What the names of fields must match."""

    def check_names(self, path: Path, fields: Iterable[str], tags: Iterable[str]) -> None:
        """Refuse names that could not be read back."""
        bad = [name for name in fields if "fields" in self.holds and not self.names.fullmatch(name)]
        bad += [name for name in tags if "tags" in self.holds and not _QUOTED.fullmatch(name)]
        if bad:
            raise ValueError(f"{path.name} cannot hold the name {describe(bad[0])}; rename it")

    def check_cells(self, path: Path, mesh: SimplexMesh) -> None:
        """Refuse cells that the format cannot hold."""
        if "triangles" in self.holds and mesh.cell_dim == 1:
            raise ValueError(f"{path.name} cannot hold segments; write .vtu")
        if self.dims and (mesh.cell_dim < mesh.dim or mesh.dim not in self.dims):
            of_dim = {2: "triangles in the plane", 3: "tetrahedra"}
            cells = " or ".join(map(of_dim.__getitem__, self.dims))
            raise OptionError(f"{path.name} holds {cells}, got {mesh!r}; write .vtu", ["path"])

    def _check_fields(self, path: Path, obj: object, names: Iterable[str]) -> None:
        if isinstance(obj, MetricFunction) and "metrics" not in self.holds:
            raise ValueError(f"{path.name} cannot hold a metric; write .vtu, .sol or .pos")
        others = [name for name in names if name not in ("h", sizes.METRIC, sizes.LENGTHS)]
        if others and "sizes" in self.holds:
            listed = ", ".join(others)
            raise ValueError(f"{path.name} holds sizes only, as the field 'h', got {listed}")
        if names and not self.holds & {"fields", "sizes"}:
            raise ValueError(
                f"{path.name} cannot hold nodal fields, got {', '.join(names)}; "
                "write .vtu, or a .sol with the sizes for a .mesh"
            )

    def check_order(self, path: Path, order: int) -> None:
        """Refuse cells of an order that the format does not have."""
        if order == 2 and "order 2" not in self.holds:
            listed = [
                s for form in FORMATS.values() if "order 2" in form.holds for s in form.suffixes
            ]
            text = f"{path.name} holds no cells of order 2; write {', '.join(listed)}, or order 1"
            raise OptionError(text, ["order"])

    def writer_of(
        self, path: Path, obj: object, fields: Mapping[str, npt.ArrayLike] | None, order: int
    ) -> Callable[[Path], None]:
        """Return the function that writes an object with fields; refuse what cannot be held."""
        assert self.write is not None
        self.check_order(path, order)
        background, nodal = write.parts_of(obj, fields)
        self._check_fields(path, obj, nodal)
        nodal = write.growth_of(obj, background.n_points) | nodal
        if isinstance(background, CartesianGrid):
            arrays = {name: np.asarray(values) for name, values in nodal.items()}
            for name, values in arrays.items():
                if values.shape != background.shape:
                    raise ValueError(
                        f"fields[{name!r}] must have shape {background.shape}, got {values.shape}"
                    )
            if "grids" in self.holds:
                self.check_names(path, arrays, ())
                return partial(self.write, grid=background, fields=arrays)
            background = background.mesh
            nodal = {name: values.reshape(-1) for name, values in arrays.items()}
        if "grids" in self.holds:
            raise ValueError(
                f"obj must be a CartesianGrid for {path.suffix}, got {background!r}; write .vtu"
            )
        mesh = background.with_data(point_data=nodal)
        self.check_cells(path, mesh)
        self.check_names(path, [*mesh.point_data, *mesh.cell_data], mesh.tag_names.values())
        return partial(self.write, mesh=mesh, **({} if order == 1 else {"order": order}))


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
_SOLVERS, _ALL_2 = _CELLS | {"order 2"}, _ALL | {"order 2"}
_NODAL_2 = _ALL_2 - {"cell fields"}
_SIZES, _FULL = frozenset({"sizes", "metrics"}), (2, 3)
#: In the order in which suffixes are tried: JIGSAW's longer suffix before Gmsh's.
FORMATS: dict[str, Format] = {
    "jigsaw": Format((".jig.msh",), sizes.write_jigsaw, holds=_SIZES - {"metrics"}, dims=_FULL),
    "gmsh-view": Format((".pos",), sizes.write_view, holds=_SIZES),
    "medit-sol": Format((".sol",), sizes.write_sol, holds=_SIZES),
    "vti": Format((".vti",), vtk.write_image, None, check.check_vtk_xml, holds=_GRIDS),
    "vtu": Format((".vtu",), _of_vtk["vtu"], _VTK, check.check_vtk_xml, holds=_ALL_2),
    "vtp": Format((".vtp",), _of_vtk["vtp"], _VTK, check.check_vtk_xml),
    "vtk-xml": Format((".vtr", ".vts", ".vtm", ".pvtu", ".pvtp"), None, _VTK, check.check_vtk_xml),
    "vtk": Format((".vtk",), _of_vtk["vtk"], _VTK, check.check_vtk, None, _ALL_2, names=_LEGACY),
    "vtkhdf": Format((".vtkhdf",), _of_vtk["vtkhdf"], _VTK, holds=_ALL_2, names=_IN_HDF),
    "xdmf": Format((".xdmf", ".xmf"), write.write_xdmf, _XDMF),
    "gmsh": Format(
        (".msh",), write.write_gmsh, _GMSH, check.check_gmsh, None, _NODAL_2, names=_QUOTED
    ),
    "medit": Format((".mesh", ".meshb"), write.write_medit, _MEDIT, holds=_CELLS),
    "stl": Format((".stl",), _stl, read_stl, holds=_TRIANGLES),
    "ply": Format((".ply",), _surface["ply"], _TRIMESH, None, check.check_ply, _PLY, names=_WORD),
    "obj": Format((".obj",), _surface["obj"], _VTK, None, check.check_obj, _TRIANGLES),
    "off": Format((".off",), _surface["off"], read_off, holds=_TRIANGLES),
    "gltf": Format((".gltf", ".glb", ".3mf"), None, _TRIMESH),
    "fort.14": Format((".14", ".grd", ".gr3"), fort14.write, fort14.read, holds=_CELLS, dims=(2,)),
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
