"""Sizes as a few points, each with a size that grows from it: `SparseSize`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_float_array,
    as_number,
    as_points,
    as_sizes,
    as_slope,
    check_type,
)
from adaptsize._formats.guards import about_file, write_whole
from adaptsize._size_function import SizeFunction
from adaptsize._workers import Workers
from adaptsize.background.interpolation import nodes_in_domain
from adaptsize.errors import MeshFileError
from adaptsize.limiting.exact import limit_points
from adaptsize.limiting.exact.field import ExactField, node_entries
from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class SparseSize:
    r"""A size function given by points: :math:`\min(h_\text{max}, \min_i h_i + g |x - x_i|)`.

    `SizeFunction.sparse` computes it.  Called with points of shape (n, dim), it returns n sizes,
    as a `SizeFunction` does.
    """

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]: sizes at the points, the smallest first."""
    g: float
    """Gradient limit."""
    hmax: float
    """Largest size."""

    def __call__(self, points: npt.ArrayLike) -> FloatArray:
        """Return the size at each of some points, shape (n, dim)."""
        where = as_points("points", points, self.points.shape[1])
        field = ExactField(self.g, None, False)
        if len(self.sizes):
            numbers = np.arange(len(self.sizes), dtype=np.int32)
            field.groups.append(node_entries(self.points, self.sizes, numbers))
        return field.evaluate(where, np.full(len(where), self.hmax))

    def __repr__(self) -> str:
        """Return the number of points and the parameters."""
        return f"SparseSize({len(self.sizes)} points, g = {self.g:g}, hmax = {self.hmax:g})"

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a table, completely or not at all.

        Parameters
        ----------
        path : str or path
            ``.csv``: after the lines ``# g = ...``, ``# hmax = ...`` and a line of names, one row
            x, y, z, h per point (no z in the plane).  ``.npz``: the arrays of the same names as the
            attributes.  Numbers are stored without loss.
        """
        target = _checked(path)
        try:
            write_whole(target, self._write_to)
        except OSError as error:
            raise about_file(target, error) from error

    def _write_to(self, path: Path) -> None:
        if path.suffix == ".npz":
            np.savez(path, points=self.points, sizes=self.sizes, g=self.g, hmax=self.hmax)
            return
        names = ",".join([*"xyz"[: self.points.shape[1]], "h"])
        head = f"# g = {self.g!r}\n# hmax = {self.hmax!r}\n{names}\n"
        rows = np.column_stack([self.points, self.sizes]).tolist()
        lines = (",".join(map(repr, row)) + "\n" for row in rows)
        path.write_text(head + "".join(lines), encoding="ascii")

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> SparseSize:
        """Return the sizes in a file that `write` has written."""
        source = _checked(path)
        try:
            if source.suffix == ".npz":
                with np.load(source) as file:
                    points, sizes, g, hmax = (file[n] for n in ("points", "sizes", "g", "hmax"))
            else:
                lines = source.read_text(encoding="ascii").splitlines()
                g, hmax = (float(lines[k].partition("=")[2]) for k in (0, 1))
                table = np.array([[float(word) for word in line.split(",")] for line in lines[3:]])
                dim = lines[2].count(",")
                points, sizes = np.split(table.reshape(-1, dim + 1), [dim], axis=1)
                sizes = sizes[:, 0]
        except OSError as error:
            raise about_file(source, error) from error
        except (ValueError, KeyError, IndexError, BadZipFile, EOFError) as error:
            raise MeshFileError(f"{source}: is not a table of SparseSize.write: {error}") from error
        places = as_points("points", as_float_array("points", points))
        largest = as_number("hmax", hmax, lower=0.0, strict=True, allow_inf=True)
        sizes = as_sizes("sizes", sizes, places.shape[:1])
        return cls(places, sizes, as_slope("g", g), largest)


def sparse_size(size: SizeFunction, g: float | None = None) -> SparseSize:
    """Return the same sizes as a few points from which they grow.

    See `SizeFunction.sparse`.
    """
    check_type("size", size, SizeFunction)
    if g is None:
        g = size.report.g if size.report is not None else size.g
    if g is None:
        raise ValueError("g must be given for a size function that is not from size_function")
    limit = as_slope("g", g)
    counts = nodes_in_domain(size.background)
    values = np.asarray(size.values).ravel()[counts]
    hmax = float(size.hmax) if size.g is not None else float(values.max())
    places, sizes = extra_points(size)
    nodes = np.asarray(size.background.points).reshape(-1, size.background.dim)[counts]
    places = np.concatenate([nodes, places])
    sizes = np.concatenate([values, sizes])
    used = np.flatnonzero(sizes < hmax)
    places, sizes = np.ascontiguousarray(places[used]), sizes[used]
    if len(sizes):
        # Raised by more than rounding, to see which of them others allow.
        lifted = sizes * (1.0 + 1e-12)
        roots = limit_points(places, lifted, len(sizes), limit, Workers.of(None)).named()[:, 0]
        kept = np.unique(roots)
        kept = kept[np.argsort(sizes[kept], kind="stable")]
        places, sizes = places[kept], sizes[kept]
    return SparseSize(places, sizes, limit, hmax)


def extra_points(size: SizeFunction) -> tuple[FloatArray, FloatArray]:
    """Return the places and sizes of the sources between the nodes."""
    dim = size.background.dim
    places, sizes = [np.empty((0, dim))], [np.empty(0)]
    if size.sources is not None and size.sources.transform is None:
        for part in size.sources.parts:
            n = len(part.found.h)
            for entries in part.found.field.groups:
                between = entries.nodes[:, 0] >= n
                places.append(entries.places[between, 0])
                sizes.append(entries.sizes[between, 0])
    return np.concatenate(places), np.concatenate(sizes)


def _checked(path: str | os.PathLike[str]) -> Path:
    """Return a path whose suffix is that of a table."""
    checked = Path(path)
    if checked.suffix not in (".csv", ".npz"):
        raise ValueError(f"path must end in .csv or .npz, got {str(path)!r}")
    return checked
