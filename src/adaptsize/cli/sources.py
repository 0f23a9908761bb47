"""Sources as words of a command line: ``ball:0,0,0,2=0.1``."""

from __future__ import annotations

from typing import Any

_HELP = "point:x,y,z=h, ball:x,y,z,r=h, box:x0,y0,z0,x1,y1,z1=h, boundary[:tag]=h, region:tag=h"


def parse_source(text: str) -> Any:
    """Return the source that ``text`` describes.

    Raises
    ------
    ValueError
        If it is none of the forms.

    Examples
    --------
    >>> parse_source("ball:0,0,0,2=0.1").radius
    2.0
    >>> parse_source("boundary:3=0.5").tags
    3
    """
    from adaptsize import sizes

    what, equals, size_text = text.partition("=")
    kind, _, where = what.partition(":")
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
    raise ValueError(f"--source must be one of {_HELP}; got {text!r}")
