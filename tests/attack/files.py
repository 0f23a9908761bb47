"""Damaged files of every format that adaptsize reads.

A file may be read, or refused with one clear message.  A file that ends early must not be read as
a smaller mesh without a warning.
"""

import gzip
import io
import re
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import Delaunay

import adaptsize as ads

from .calls import check_error
from .cases import Failure

#: Formats without a count of cells or a mark of the end.
_ENDLESS = (".inp", ".obj")

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
    reader = _reader(name)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)
        try:
            found = reader(path)
        except Exception as error:
            try:
                check_error(error)
            except Failure as failure:
                raise Failure(f"{failure}: {what}") from error
            return f"{type(error).__name__}: {what}"
    has_end = path.suffix not in _ENDLESS
    if change == "cut" and has_end and not warned and _size(found) < _size_of_original(name):
        raise Failure(f"a file that ends early was read as {found!r}: {what}")
    if isinstance(found, ads.SimplexMesh) and not np.isfinite(found.points).all():
        raise Failure(f"coordinates that are not finite: {what}")
    return f"read: {what}"


def _reader(name: str) -> Callable[[Path], Any]:
    if name.startswith("image"):
        return ads.read_image
    return ads.read_size if name.startswith("size") else ads.read


@cache
def _size_of_original(name: str) -> int:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder, f"file{name[name.index('.') :]}")
        path.write_bytes(originals()[name])
        try:
            return _size(_reader(name)(path))
        except ValueError:  # one of several files
            return 0


def _size(found: Any) -> int:
    """Return the number of cells, nodes or pixels that were read."""
    if isinstance(found, ads.SimplexMesh):
        return found.n_cells
    return int(found.values.size)


# --- damage ---------------------------------------------------------------------------------------


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    end = len(data.rstrip()) - 1
    return data[: int(rng.integers(0, max(end, 1)))]


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.choice([1, 3, 10]))):
        changed[int(rng.integers(0, len(changed)))] = int(rng.integers(0, 256))
    return bytes(changed)


def _flipped_in_header(data: bytes, rng: np.random.Generator) -> bytes:
    head = min(len(data), 200)
    return _flipped(data[:head], rng) + data[head:]


def _other_number(data: bytes, rng: np.random.Generator) -> bytes:
    """Replace one number of a text, more often one near the beginning."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", data))
    if not found:
        return _flipped(data, rng)
    place = found[int(len(found) * rng.random() ** 2)]
    return (
        data[: place.start()] + _NUMBERS[int(rng.integers(0, len(_NUMBERS)))] + data[place.end() :]
    )


def _without_part(data: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted(map(int, rng.integers(0, len(data), 2)))
    return data[:first] + data[min(last, first + 100) :]


def _twice(data: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted(map(int, rng.integers(0, len(data), 2)))
    return data[:last] + data[first:]


def _zeros(data: bytes, rng: np.random.Generator) -> bytes:
    first = int(rng.integers(0, len(data)))
    count = int(rng.choice([4, 8, 100]))
    return data[:first] + bytes(min(count, len(data) - first)) + data[first + count :]


def _noise(data: bytes, rng: np.random.Generator) -> bytes:
    first = int(rng.integers(0, len(data)))
    return data[:first] + rng.bytes(50) + data[first + 50 :]


def _lines_exchanged(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.integers(0, len(lines), 2)
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _as_is(data: bytes, rng: np.random.Generator) -> bytes:
    return data


_CHANGES: dict[str, Callable[[bytes, np.random.Generator], bytes]] = {
    "cut": _cut,
    "bytes flipped": _flipped,
    "header flipped": _flipped_in_header,
    "another number": _other_number,
    "a part left out": _without_part,
    "a part twice": _twice,
    "zeros": _zeros,
    "noise": _noise,
    "lines exchanged": _lines_exchanged,
    "as it is": _as_is,
}


# --- originals ------------------------------------------------------------------------------------


@cache
def originals() -> dict[str, bytes]:
    """Return small files of all formats that can be made here, by a name with the suffix."""
    found: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for make in (_ours, _by_meshio, _by_trimesh, _images):
            for name, data in make(Path(folder)):
                if data:
                    found.setdefault(name, data)
    return found


def _meshes() -> dict[str, ads.SimplexMesh]:
    rng = np.random.default_rng(9)
    plane, solid = rng.random((12, 2)), rng.random((10, 3))
    flat = ads.SimplexMesh(plane, Delaunay(plane).simplices)
    volume = ads.SimplexMesh(solid, Delaunay(solid).simplices)
    return {"flat": flat, "volume": volume, "surface": volume.boundary().mesh}


def _ours(folder: Path) -> Any:
    from adaptsize._formats.writers import FORMATS

    for kind, mesh in _meshes().items():
        for form in FORMATS.values():
            for suffix in form.suffixes:
                path = folder / f"ours{suffix}"
                try:
                    size = ads.SizeFunction(mesh, np.full(mesh.n_points, 0.1))
                    ads.write(path, mesh)
                    yield f"{kind}{suffix}", path.read_bytes()
                    ads.write(path, size)
                    yield f"size {kind}{suffix}", path.read_bytes()
                except ValueError:  # cannot hold such a mesh or fields
                    continue
    grid = ads.CartesianGrid([0.0, 0.0], 0.5, (4, 3))
    ads.write(folder / "grid.vti", ads.SizeFunction(grid, np.full(grid.shape, 0.1)))
    yield "size grid.vti", (folder / "grid.vti").read_bytes()


def _by_meshio(folder: Path) -> Any:
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


def _by_trimesh(folder: Path) -> Any:
    import trimesh

    surface = _meshes()["surface"]
    mesh = trimesh.Trimesh(surface.points, surface.cells, process=False)
    for suffix in ("stl", "stl_ascii", "ply", "off", "obj", "glb", "dae", "3mf", "gltf"):
        try:
            data = mesh.export(file_type=suffix)
        except Exception:  # of a package that is not installed
            continue
        if isinstance(data, str):
            data = data.encode()
        if isinstance(data, bytes):
            yield f"trimesh {suffix}.{suffix.split('_')[0]}", data


def _images(folder: Path) -> Any:
    disc = np.zeros((12, 10), np.uint8)
    disc[3:8, 3:8] = 255
    ball = np.zeros((6, 6, 6), np.uint8)
    ball[2:4, 2:4, 2:4] = 1
    stored = io.BytesIO()
    np.save(stored, ball)
    yield "image.npy", stored.getvalue()
    stored = io.BytesIO()
    np.savez_compressed(stored, ball)
    yield "image.npz", stored.getvalue()
    try:
        from PIL import Image

        for suffix in ("png", "tif", "bmp"):
            stored = io.BytesIO()
            Image.fromarray(disc).save(stored, format={"tif": "TIFF"}.get(suffix, suffix.upper()))
            yield f"image.{suffix}", stored.getvalue()
    except ImportError:
        pass
    yield from _volumes(folder, ball)


def _volumes(folder: Path, ball: np.ndarray) -> Any:
    try:
        import nibabel

        nibabel.save(nibabel.Nifti1Image(ball, np.eye(4)), folder / "ball.nii")
        data = (folder / "ball.nii").read_bytes()
        yield "image.nii", data
        yield "image.nii.gz", gzip.compress(data, mtime=0)
    except ImportError:
        pass
    try:
        import nrrd

        nrrd.write(str(folder / "ball.nrrd"), ball)
        yield "image.nrrd", (folder / "ball.nrrd").read_bytes()
    except ImportError:
        pass
