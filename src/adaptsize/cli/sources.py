"""Sources on the command line, such as ``ball:0,0,0,2=0.1``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from adaptsize.typing import FloatArray

#: Suffixes of texts with one point per line.
_TEXTS = (".txt", ".csv", ".dat", ".xy", ".xyz")

FORMS = (
    "point:x,y,z=h, curve:x0,y0,z0:x1,y1,z1:...=h, curve:FILE=h, ball:x,y,z,r=h, "
    "box:x0,y0,z0,x1,y1,z1=h, boundary[:tag]=h, region:tag=h"
)


def parse_source(text: str) -> Any:
    """Return the source that ``text`` describes.

    The file of a curve is a mesh of segments, or a text with one point per line, joined in this
    order.

    Raises
    ------
    ValueError
        If the text has none of the known forms, or the file of a curve cannot be read.

    Examples
    --------
    >>> parse_source("ball:0,0,0,2=0.1").radius
    2.0
    >>> parse_source("boundary:3=0.5").tags
    3
    >>> parse_source("curve:0,0:1,0:1,1=0.1").curve.tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    from adaptsize import sizes

    what, equals, size_text = text.rpartition("=")
    kind, _, where = what.partition(":")
    if kind == "curve" and where:
        return _curve_source(where, size_text, text)
    try:
        size = float(size_text)
        numbers = [float(word) for word in where.split(",")] if where else []
    except ValueError:
        equals = ""
        numbers, size = [], 0.0
    n = len(numbers)
    if equals and kind == "point" and n in (2, 3):
        return sizes.PointSource(numbers, size)
    if equals and kind == "ball" and n in (3, 4):
        return sizes.BallSource(numbers[:-1], numbers[-1], size)
    if equals and kind == "box" and n in (4, 6):
        return sizes.BoxSource(numbers[: n // 2], numbers[n // 2 :], size)
    if equals and kind == "boundary" and n in (0, 1):
        return sizes.BoundarySource(size, tags=int(numbers[0]) if n else None)
    if equals and kind == "region" and n == 1:
        return sizes.RegionSource(int(numbers[0]), size)
    raise ValueError(f"--source must be one of {FORMS}; got {text!r}")


def _curve_source(where: str, size_text: str, text: str) -> Any:
    """Return the source along a curve, given by its points or by a file."""
    from adaptsize import sizes

    try:
        size = float(size_text)
    except ValueError as error:
        raise ValueError(f"--source must be one of {FORMS}; got {text!r}") from error
    try:
        rows = [[float(word) for word in point.split(",")] for point in where.split(":")]
    except ValueError:
        return sizes.CurveSource(_read_curve(Path(where)), size)
    return sizes.CurveSource(_joined(rows, f"--source {text}"), size)


def _read_curve(path: Path) -> Any:
    """Return the segments in a mesh file, or the points in a text."""
    from adaptsize._checks import describe
    from adaptsize.errors import MeshFileError
    from adaptsize.io import read

    if path.suffix.lower() not in _TEXTS:
        return read(path, kind="segments")
    rows = []
    try:
        lines = path.read_text().splitlines()
        for line in lines:
            words = line.partition("#")[0].replace(",", " ").split()
            if words:
                rows.append([float(word) for word in words])
    except UnicodeDecodeError as error:
        raise MeshFileError(f"{path}: is not a text") from error
    except OSError as error:
        raise MeshFileError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        given = describe(line)
        raise MeshFileError(f"{path}: line {given} must have 2 or 3 coordinates") from error
    return _joined(rows, str(path))


def _joined(rows: list[list[float]], name: str) -> FloatArray:
    """Return the points of a polyline."""
    dims = {len(row) for row in rows}
    if len(rows) < 2 or dims not in ({2}, {3}):
        got = f"{len(rows)} points"
        got += f" of {' or '.join(map(str, sorted(dims)))} coordinates" if rows else ""
        raise ValueError(
            f"{name}: a curve must have at least 2 points of 2 or 3 coordinates, got {got}"
        )
    return np.array(rows)
