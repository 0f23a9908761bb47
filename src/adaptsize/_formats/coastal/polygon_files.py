"""Files of polygons and lines: GeoJSON, shapefiles, tables of points, and Triangle's ``.poly``."""

import csv
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptsize._checks import as_path, as_points, describe, place_text, warn_caller
from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.coastal.outlines import Line
from adaptsize._formats.coastal.polygons import domain_of
from adaptsize._formats.guards import about_file, check_readable
from adaptsize._formats.limited import read_limited
from adaptsize._formats.text import check_last_number, numbers, rows_of
from adaptsize.errors import InputWarning, MeshFileError
from adaptsize.typing import FloatArray

#: Properties that may hold the name of a feature, the first that is there.
_NAMES = ("boundary", "name", "type", "kind")
_DEGREES = (
    "coordinates look like longitude and latitude: all lengths and sizes are in degrees, which "
    "differ in the two directions; project them to a plane first, for example by pyproj or ogr2ogr"
)


#: The beginning of a geometry in well-known text.
_GEOMETRY = re.compile(
    r"(?:SRID=\d+;\s*)?\b(?:MULTI)?(?:POINT|LINESTRING|POLYGON|GEOMETRYCOLLECTION)\s*Z?M?\s*\(",
    re.IGNORECASE,
)
#: Stands for a geometry in a table.
_PLACE = "\x01"


class Content(NamedTuple):
    """The lines in a file."""

    lines: list[Line]
    in_holes: FloatArray | None = None
    """float64[k, 2]: points in the holes, if the format has them."""


@contextmanager
def naming(path: Any) -> Iterator[None]:
    """Add the path of a file, if it is one, to errors."""
    try:
        yield
    except ValueError as error:
        if isinstance(path, str | os.PathLike):
            raise about_file(path, error) from error
        raise


def read_file(path: str | os.PathLike[str], notes: list[str]) -> Content:
    """Return the lines in a file of any of these formats."""
    file = as_path("outer", path)
    with naming(path):
        check_readable(file)
        reader = READERS.get(file.suffix.lower())
        if reader is None:
            known = ", ".join(READERS)
            raise MeshFileError(f"holds no polygons that can be read; known are {known}")
        return reader(file, notes)


def load(path: Path) -> RawMesh:
    """Return the domain between the lines in a file, with the names of its boundaries."""
    notes: list[str] = []
    try:
        content = READERS[path.suffix.lower()](path, notes)
        mesh = domain_of(content.lines, notes, in_holes=content.in_holes)
    except ValueError as error:
        raise MeshFileError(str(error)) from error
    blocks: list[tuple[str, Any]] = [("triangle", mesh.cells)]
    tags = [np.zeros(mesh.n_cells, np.int32)]
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        blocks.append(("line", mesh.tagged_facets))
        tags.append(mesh.facet_tags)
    return RawMesh(mesh.points, blocks, {}, {"cell_tags": tags}, mesh.tag_names, notes)


# --- GeoJSON --------------------------------------------------------------------------------------


def _read_geojson(path: Path, notes: list[str]) -> Content:
    content = path.read_bytes()
    letters = np.frombuffer(content, np.uint8)
    opened, closed = (np.isin(letters, np.frombuffer(both, np.uint8)) for both in (b"[{", b"]}"))
    # Brackets within each other: a MultiPolygon in a collection has 8.
    if np.cumsum(opened.astype(np.int8) - closed.astype(np.int8), dtype=np.int32).max() > 100:
        raise MeshFileError("is nested too deeply for GeoJSON")
    return of_geojson(json.loads(content), notes)


def of_geojson(data: Any, notes: list[str]) -> Content:
    """Return the lines in an object of GeoJSON."""
    lines: list[Line] = []
    others: list[str] = []

    def add(item: Any, name: str | None, source: str) -> None:
        kind = item.get("type") if isinstance(item, Mapping) else None
        if kind == "FeatureCollection":
            for k, part in enumerate(_list(item, "features", source)):
                add(part, None, f"features[{k}]")
        elif kind == "Feature":
            if item.get("geometry") is not None:
                add(item["geometry"], _name_in(item.get("properties")), source)
        elif kind == "GeometryCollection":
            for k, part in enumerate(_list(item, "geometries", source)):
                add(part, name, f"{source}, geometry {k}")
        elif kind in ("MultiPolygon", "MultiLineString"):
            for part in _list(item, "coordinates", source):
                add({"type": kind[5:], "coordinates": part}, name, source)
        elif kind in ("Polygon", "LineString"):
            is_ring, rows = kind == "Polygon", _list(item, "coordinates", source)
            for k, part in enumerate(rows if is_ring else [rows]):
                line = _line(_points(part, source), name, source, is_ring=is_ring)
                lines.append(line._replace(is_hole=is_ring and k > 0))
        elif kind in ("Point", "MultiPoint"):
            others.append(source)
        else:
            raise ValueError(f"{source} must be a geometry of GeoJSON, got {describe(item)}")

    add(data, None, "the geometry")
    if others:
        notes.append(f"{len(others)} points left out, the first in {others[0]}")
    # The standard knows no other coordinates, but programs write them; older ones say so.
    has_crs = isinstance(data, Mapping) and "crs" in data and "CRS84" not in str(data["crs"])
    if lines and not has_crs:
        largest = np.max([np.abs(line.points).max(axis=0) for line in lines], axis=0)
        if (largest <= (180.0, 90.0)).all():
            warn_caller(_DEGREES, InputWarning)
    return Content(lines)


def _list(item: Mapping[str, Any], key: str, source: str) -> list[Any]:
    found = item.get(key)
    if not isinstance(found, list | tuple):
        raise ValueError(f"{source} must have a list of {key}, got {describe(found)}")
    return list(found)


def _points(rows: Any, source: str) -> FloatArray:
    """Return the first two coordinates of each point."""
    try:
        return as_points(source, [row[:2] for row in rows], 2)
    except (TypeError, OverflowError) as error:
        raise ValueError(f"{source} must have lists of points, got {describe(rows)}") from error


def _name_in(properties: Any) -> str | None:
    """Return the name of a feature."""
    found = properties if isinstance(properties, Mapping) else {}
    texts = {str(key).lower(): text for key, text in found.items() if isinstance(text, str)}
    return next((texts[key].strip() for key in _NAMES if texts.get(key, "").strip()), None)


def _line(points: FloatArray, name: str | None, source: str, *, is_ring: bool) -> Line:
    if len(points) == 0:
        raise ValueError(f"{source} has a line without points")
    if is_ring and (points[0] != points[-1]).any():
        ends = " and ends at ".join(place_text(points[k]) for k in (0, -1))
        raise ValueError(f"{source} has an open ring, which begins at {ends}")
    return Line(points, name, source, closes=is_ring)


# --- other formats --------------------------------------------------------------------------------


def _read_shp(path: Path, notes: list[str]) -> Content:
    about = path.with_suffix(".prj")
    if about.is_file() and about.read_bytes()[:100].lstrip().startswith((b"GEOGCS", b"GEOGCRS")):
        warn_caller(_DEGREES, InputWarning)
    return of_geojson(read_limited("foreign.read_shp", path), notes)


def _read_csv(path: Path, notes: list[str]) -> Content:
    """Read x, y and perhaps a name on each line, or geometries as text (WKT).

    Blank lines and new names begin new lines.
    """
    content = path.read_bytes()
    text = content.decode("utf-8-sig")
    if _GEOMETRY.search(text):
        return of_geojson(_features_in(text), notes)
    rows: list[list[tuple[float, float]]] = []
    names: list[str | None] = []
    begins = True
    for number, line in enumerate(text.splitlines(), 1):
        words = _words(line.partition("#")[0])
        if not any(words):
            begins = True
            continue
        try:
            point = float(words[0]), float(words[1])
        except (ValueError, IndexError) as error:
            if not rows:  # the names of the columns
                continue
            raise MeshFileError(f"line {number} must be x, y, got {describe(line)}") from error
        name = words[2] or None if len(words) > 2 else None
        if begins or name != names[-1]:
            rows.append([])
            names.append(name)
        rows[-1].append(point)
        begins = False
    if names and names[-1] is None:
        check_last_number(content)
    lines = [
        Line(as_points(f"line {k}", points, 2), name, f"line {k}", closes=name is None)
        for k, (points, name) in enumerate(zip(rows, names, strict=True))
    ]
    return Content(lines)


def _words(line: str) -> list[str]:
    """Return the columns of a line: between commas, semicolons or tabs, or else between spaces."""
    words = [word.strip() for word in re.split("[,;\t]", line)]
    return words if len(words) > 1 else line.split(maxsplit=2)


def _features_in(text: str) -> dict[str, Any]:
    """Return the geometries of well-known text in a table, with its other columns, as GeoJSON."""
    import shapely

    pieces, geometries, end = [], [], 0
    for start in _GEOMETRY.finditer(text):
        if start.start() < end:  # in a collection
            continue
        pieces.append(text[end : start.start()])
        end = _end_of(text, start)
        geometries.append(text[start.start() : end])
    pieces.append(text[end:])
    # A letter stands for each geometry, so that its commas divide no columns.
    table = [line for line in _PLACE.join(pieces).splitlines() if line.strip()]
    sign = max(",;\t", key="".join(table).count)
    rows = list(csv.reader(table, delimiter=sign))
    header = None if any(_PLACE in word for word in rows[0]) else rows.pop(0)
    features, at = [], iter(geometries)
    for row in rows:
        if not any(_PLACE in word for word in row):
            raise MeshFileError(f"has a row without a geometry: {describe(sign.join(row))}")
        words = next(at)
        try:
            shape = shapely.from_wkt(words.rpartition(";")[2])
        except shapely.GEOSException as error:
            raise MeshFileError(f"has a geometry that is no text of OGC ({error})") from error
        others = [word.strip() for word in row if _PLACE not in word]
        keys = [key for key, word in zip(header or (), row, strict=False) if _PLACE not in word]
        properties = dict(zip(keys or ["name"], others, strict=False))
        geometry = None if shape.is_empty else shapely.geometry.mapping(shape)
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def _end_of(text: str, start: re.Match[str]) -> int:
    """Return where a geometry in well-known text ends."""
    depth = 0
    for k in range(start.end() - 1, len(text)):
        depth += (text[k] == "(") - (text[k] == ")")
        if depth == 0:
            return k + 1
    raise MeshFileError("is truncated (a geometry has no closing bracket)")


def _read_poly(path: Path, notes: list[str]) -> Content:
    """Read nodes, segments with markers, and points in holes, as Triangle does."""
    content = path.read_bytes()
    check_last_number(content)
    rows = _rows(content)
    nodes, after = _table(rows, 4)
    if not len(nodes):
        nodes = _table(_rows(path.with_suffix(".node").read_bytes()), 4)[0]
    ends, after = _table(after, 2)
    holes = _table(after, 1)[0]
    if not len(ends):
        raise MeshFileError("has no segments")
    at = rows_of(ends[:, 1:3], nodes[:, 0], "a segment")
    points = as_points("the nodes", nodes[:, 1:3], 2)[at]
    markers = ends[:, 3].astype(int) if ends.shape[1] > 3 else np.zeros(len(ends), int)
    lines = [
        Line(pair, str(marker) if marker else None, f"segment {number:g}", closes=False)
        for pair, marker, number in zip(points, markers, ends[:, 0], strict=True)
    ]
    return Content(lines, as_points("the holes", holes[:, 1:3], 2))


def _rows(content: bytes) -> list[list[bytes]]:
    lines = (line.partition(b"#")[0].split() for line in content.splitlines())
    return [words for words in lines if words]


def _table(rows: list[list[bytes]], n_counts: int) -> tuple[FloatArray, list[list[bytes]]]:
    """Return the numbers of the table that begins in the first row, and the rows after it."""
    count = int(numbers(rows[0][:1], np.int64)[0]) if rows else 0
    if not rows or len(rows[0]) < n_counts or count < 0 or len(rows) <= count:
        raise MeshFileError("is truncated (a table has fewer rows than its first row says)")
    table = [numbers(row, np.float64) for row in rows[1 : count + 1]]
    if count and len({len(row) for row in table} | {max(len(table[0]), 3)}) > 1:
        raise MeshFileError("has a table with rows of different lengths")
    return np.array(table).reshape(count, -1) if count else np.empty((0, 3)), rows[count + 1 :]


READERS = {
    ".geojson": _read_geojson,
    ".json": _read_geojson,
    ".shp": _read_shp,
    ".csv": _read_csv,
    ".poly": _read_poly,
}
