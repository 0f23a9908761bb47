"""The tables of docs/files.md say what the table of formats does."""

import re
from functools import partial
from pathlib import Path

from adaptsize._formats.formats import FORMATS

PAGE = (Path(__file__).parents[2] / "docs/files.md").read_text(encoding="utf-8")
PROGRAMS = {
    "foreign.read_vtk": "VTK",
    "foreign.read_su2": "meshio",
    "xdmf.read": "meshio",
    "foreign.read_trimesh": "trimesh",
    "abaqus.read": "adaptsize",
    "gmsh.read": "adaptsize",
    "medit.read": "adaptsize",
}
FORMAT_OF = {suffix: form for form in FORMATS.values() for suffix in form.suffixes}


def table(section):
    """The rows below a heading, by the suffixes outside of parentheses in their first cell."""
    found = {}
    for line in PAGE.partition(f"\n## {section}\n")[2].partition("\n## ")[0].splitlines():
        first, *others = [cell.strip() for cell in line.strip("|").split("|")]
        for suffix in re.findall(r"`(\.[\w.]+)`", re.sub(r"\(.*?\)", "", first)):
            if line.startswith("|"):
                found[suffix] = others
    return found


def test_each_format_that_is_read_has_its_row_with_its_reader():
    rows = table("Reading")
    assert set(rows) == {suffix for suffix, form in FORMAT_OF.items() if form.read is not None}
    for suffix, (_, program, *_) in rows.items():
        read = FORMAT_OF[suffix].read
        by = PROGRAMS[read.args[0]] if isinstance(read, partial) else "adaptsize"
        assert program == {".shp": "pyshp"}.get(suffix, by), suffix


def test_each_format_that_is_written_has_its_row_with_what_it_holds():
    rows = table("Writing")
    written = {suffix for suffix, form in FORMAT_OF.items() if form.write is not None}
    assert set(rows) == written - {".xmf", ".meshb", ".nas", ".fem"}
    for suffix, (fields, tags, _) in rows.items():
        holds = FORMAT_OF[suffix].holds
        has_fields = fields.split()[0] not in ("no", "`depth`", "PLY") or suffix == ".ply"
        assert has_fields == bool(holds & {"fields", "sizes"}), suffix
        assert (tags not in ("", "no")) == ("tags" in holds), suffix
