"""Damaged files of every format that adaptsize reads.

A file may be read, or refused with one clear message.
"""

import io
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from meshes import random_cube, random_square

import adaptsize as ads

from .calls import check_error
from .cases import Failure, told_with

_NUMBERS = (b"-1", b"0", b"1", b"3", b"99999999999", b"2147483648", b"nan", b"inf", b"1e999",
            b"abc", b"1.5", b"", b"1e-400", b"-0", b"0x10", b"18446744073709551616")  # fmt: skip


def run(rng: np.random.Generator, folder: Path) -> str:
    """Damage a file at random and read it."""
    names = sorted(originals())
    name = names[int(rng.integers(0, len(names)))]
    data = originals()[name]
    change = str(rng.choice(list(_CHANGES)))
    damaged = _CHANGES[change](data, rng)
    path = folder / f"file{name[name.index('.') :]}"
    path.write_bytes(damaged)
    what = f"{name}, {change}, {len(data)} bytes before and {len(damaged)} after"
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            found = _reader(name)(path)
        except Exception as error:
            with told_with(what):
                check_error(error)
            return f"{type(error).__name__}: {what}"
    if isinstance(found, ads.SimplexMesh) and not np.isfinite(found.points).all():
        raise Failure(f"coordinates that are not finite: {what}")
    return f"read: {what}"


def _reader(name: str) -> Callable[[Path], Any]:
    if name.startswith("image"):
        return ads.read_image
    return ads.read_size if name.startswith("size") else ads.read


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    changed = np.frombuffer(data, np.uint8).copy()
    count = int(rng.choice([1, 3, 10]))
    changed[rng.integers(0, len(data), count)] = rng.integers(0, 256, count)
    return changed.tobytes()


def _other_number(data: bytes, rng: np.random.Generator) -> bytes:
    """Replace one number of a text, more often one near the beginning."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", data))
    if not found:
        return _flipped(data, rng)
    place = found[int(len(found) * rng.random() ** 2)]
    number = _NUMBERS[int(rng.integers(0, len(_NUMBERS)))]
    return data[: place.start()] + number + data[place.end() :]


def _overwritten(data: bytes, rng: np.random.Generator, new: bytes) -> bytes:
    first = int(rng.integers(0, len(data)))
    return data[:first] + new[: len(data) - first] + data[first + len(new) :]


_CHANGES: dict[str, Callable[[bytes, np.random.Generator], bytes]] = {
    "cut": lambda data, rng: data[: int(rng.integers(0, max(len(data.rstrip()) - 1, 1)))],
    "bytes flipped": _flipped,
    "header flipped": lambda data, rng: _flipped(data[:200], rng) + data[200:],
    "another number": _other_number,
    "zeros": lambda data, rng: _overwritten(data, rng, bytes(int(rng.choice([4, 8, 100])))),
    "noise": lambda data, rng: _overwritten(data, rng, rng.bytes(50)),
    "as it is": lambda data, rng: data,
}


@cache
def originals() -> dict[str, bytes]:
    """Return small files of all formats that can be made here, by a name with the suffix."""
    found: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for make in (_ours, _by_meshio, _images):
            try:
                for name, data in make(Path(folder)):
                    if data:
                        found.setdefault(name, data)
            except ImportError:  # of an optional package
                continue
    return found


def _meshes() -> dict[str, ads.SimplexMesh]:
    volume = random_cube(10, 9)
    return {"flat": random_square(12, 9), "volume": volume, "surface": volume.boundary().mesh}


def _ours(folder: Path) -> Iterator[tuple[str, bytes]]:
    from adaptsize._formats.formats import FORMATS

    for kind, mesh in _meshes().items():
        size = ads.SizeFunction(mesh, np.full(mesh.n_points, 0.1))
        for suffix in (suffix for form in FORMATS.values() for suffix in form.suffixes):
            path = folder / f"ours{suffix}"
            try:
                for name, thing in ((kind, mesh), (f"size {kind}", size)):
                    ads.write(path, thing)
                    yield f"{name}{suffix}", path.read_bytes()
            except ValueError:  # cannot hold such a mesh or fields
                continue
    grid = ads.CartesianGrid([0.0, 0.0], 0.5, (4, 3))
    ads.write(folder / "grid.vti", ads.SizeFunction(grid, np.full(grid.shape, 0.1)))
    yield "size grid.vti", (folder / "grid.vti").read_bytes()


def _by_meshio(folder: Path) -> Iterator[tuple[str, bytes]]:
    import meshio

    for kind, mesh in _meshes().items():
        points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
        cells = [("tetra" if mesh.cell_dim == 3 else "triangle", mesh.cells)]
        for suffix in sorted(meshio.extension_to_filetypes):
            path = folder / f"meshio{suffix}"
            try:
                meshio.Mesh(points, cells).write(path)
                yield f"meshio {kind}{suffix}", path.read_bytes()
            except (Exception, SystemExit):  # cannot be written, or not of such cells
                continue


_BALL = np.pad(np.ones((2, 2, 2), np.uint8), 2)


def _images(folder: Path) -> Iterator[tuple[str, bytes]]:
    for name, save in (("image.npy", np.save), ("image.npz", np.savez_compressed)):
        stored = io.BytesIO()
        save(stored, _BALL)
        yield name, stored.getvalue()
    from PIL import Image

    disc = np.pad(np.full((5, 5), 255, np.uint8), 3)
    for suffix, file_format in {"png": "PNG", "tif": "TIFF", "bmp": "BMP"}.items():
        stored = io.BytesIO()
        Image.fromarray(disc).save(stored, format=file_format)
        yield f"image.{suffix}", stored.getvalue()
