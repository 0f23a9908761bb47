"""What a file format is, and the table of all that are known."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize._formats import sizes
from adaptsize._formats import writers as write
from adaptsize._formats.blocks import RawMesh
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.errors import OptionError
from adaptsize.metrics import MetricFunction

#: What names of fields must match: texts that XML can hold, at most 100 characters.
IN_XML = re.compile(r"[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]{1,100}")
#: HDF5 takes slashes for groups, and VTK replaces dots.
IN_HDF = re.compile(r"[^\x00/.\ud800-\udfff]{1,100}")
#: VTK takes braces in names for formats and aborts, and reads 255 bytes, encoded as in addresses.
LEGACY = re.compile(
    r"[^{}\x00-\x1f\x7f-\uffff\U00010000-\U0010ffff]{1,80}|[^{}\x00-\x1f\x7f-\x9f\ud800-\udfff]{1,20}"
)
#: Texts in quotation marks on one line, and words.
QUOTED = re.compile(r"[^\x00-\x1f\x7f-\xa0\"\\\u2028\u2029\ud800-\udfff]{1,100}")
WORD = re.compile(r"(?![xyz]$)[!-~]{1,100}")

ALL = frozenset({"cells", "tags", "fields", "cell fields", "metrics"})


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
    holds: frozenset[str] = ALL
    """Of these words (``fields`` are those of nodes) and ``sizes`` (without cells), ``grids``,
    ``order 2`` (cells with nodes in the middles of edges), and ``triangles``: no other cells, so
    of tetrahedra those of the boundary."""
    dims: tuple[int, ...] = ()
    """Dimensions of meshes, if their cells must have the dimension of the space."""
    most_dim: int = 3
    """Largest dimension of cells."""
    names: re.Pattern[str] = IN_XML
    """What the names of fields must match."""

    def check_names(self, path: Path, fields: Iterable[str], tags: Iterable[str]) -> None:
        """Refuse names that could not be read back."""
        bad = [name for name in fields if "fields" in self.holds and not self.names.fullmatch(name)]
        bad += [name for name in tags if "tags" in self.holds and not QUOTED.fullmatch(name)]
        if bad:
            raise ValueError(f"{path.name} cannot hold the name {describe(bad[0])}; rename it")

    def check_cells(self, path: Path, mesh: SimplexMesh) -> None:
        """Refuse cells that the format cannot hold."""
        if "triangles" in self.holds and mesh.cell_dim == 1:
            raise ValueError(f"{path.name} cannot hold segments; write .vtu")
        if mesh.cell_dim > self.most_dim:
            raise OptionError(
                f"{path.name} holds no tetrahedra, got {mesh!r}; write .vtu", ["path"]
            )
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
        if self.write is None:
            raise ValueError(f"{path.name} has a format that is only read; write .vtu")
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


#: By name, in the order in which suffixes are tried.
FORMATS: dict[str, Format] = {}
