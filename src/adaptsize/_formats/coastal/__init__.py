"""Shorelines and ocean meshes: polygons and lines as domains, and the format of ADCIRC."""

from adaptsize._formats.coastal import fort14, polygon_files
from adaptsize._formats.format import Format

FORMATS = {
    "fort.14": Format(
        (".14", ".grd", ".gr3"), fort14.write, fort14.read,
        holds=frozenset({"cells", "tags"}), dims=(2,),
    ),
    "polygons": Format(tuple(polygon_files.READERS), None, polygon_files.load),
}  # fmt: skip
