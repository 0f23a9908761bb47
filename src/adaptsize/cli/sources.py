"""Sources as they are typed: ``--source "ball:0,0,0,2=0.1"``."""

from pathlib import Path
from typing import Any

import numpy as np

from adaptsize._checks import refusal

#: Suffixes of texts with one point per line.
_TEXTS = (".txt", ".csv", ".dat", ".xy", ".xyz")
FORMS = (
    "point:x,y,z=h, curve:x0,y0,z0:x1,y1,z1:...=h, curve:FILE=h, ball:x,y,z,r=h, "
    "box:x0,y0,z0,x1,y1,z1=h, boundary[:name]=h, region:name=h"
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
    >>> parse_source("region:inlet pipe=0.5").tags
    'inlet pipe'
    >>> parse_source("curve:0,0:1,0:1,1=0.1").curve.tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    from adaptsize import sizes

    what, _, size_text = text.rpartition("=")
    kind, _, where = what.partition(":")
    unknown = refusal("source", f"must be one of {FORMS}; got {text!r}")
    by_tag = kind in ("boundary", "region") and where != ""
    try:
        size = float(size_text)
        of_curve = kind == "curve" and where != ""
        is_text = of_curve or by_tag or not where
        numbers = [] if is_text else [float(word) for word in where.split(",")]
    except ValueError:
        raise unknown from None
    curve = _curve(where) if of_curve else None
    try:
        match kind, len(numbers):
            case "curve", 0 if curve is not None:
                return sizes.CurveSource(curve, size)
            case "point", 2 | 3:
                return sizes.PointSource(numbers, size)
            case "ball", 3 | 4:
                return sizes.BallSource(numbers[:-1], numbers[-1], size)
            case "box", 4 | 6 as n:
                return sizes.BoxSource(numbers[: n // 2], numbers[n // 2 :], size)
            case "boundary", 0:
                return sizes.BoundarySource(size, tags=_tag(where) if by_tag else None)
            case "region", 0 if by_tag:
                return sizes.RegionSource(_tag(where), size)
    except ValueError as error:
        raise refusal("source", f"{text}: {error}") from error
    raise unknown


def _tag(text: str) -> int | str:
    """Return a tag: its number, or its name."""
    try:
        return int(text)
    except ValueError:
        return text.strip()


def _curve(where: str) -> Any:
    """Return the points of a curve, given as they are or in a text, or the segments in a file."""
    from adaptsize.errors import MeshFileError
    from adaptsize.io import read

    path = Path(where)
    of_text = path.suffix.lower() in _TEXTS
    rows = [point.split(",") for point in where.split(":")]
    if of_text:
        try:
            lines = path.read_text().replace(",", " ").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "is not a text"
            raise MeshFileError(f"{path}: {reason}") from error
        rows = [words for line in lines if (words := line.partition("#")[0].split())]
    try:
        points = [[float(word) for word in row] for row in rows]
    except ValueError as error:
        if not of_text:
            return read(path, kind="segments")
        raise MeshFileError(f"{path}: {error}, where a line must be a point") from error
    dims = {len(point) for point in points}
    if len(points) < 2 or dims not in ({2}, {3}):
        got = f"{len(points)} points of {' or '.join(map(str, sorted(dims)))} coordinates"
        fault = f"{where}: a curve must have at least 2 points of 2 or 3 coordinates, got {got}"
        raise MeshFileError(fault) if of_text else refusal("source", f"curve:{fault}")
    return np.array(points)
