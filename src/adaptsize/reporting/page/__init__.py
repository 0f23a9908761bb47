"""A report on a mesh as one page of HTML, with nothing to fetch."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

import adaptsize
from adaptsize import _calls
from adaptsize._checks import as_path, as_tolerance, check_type
from adaptsize._formats.guards import write_whole
from adaptsize._formats.text import write_text
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.quality import check_mesh, size_conformity
from adaptsize.quality.certificate import MeshCheck
from adaptsize.quality.elements import minimum_angles
from adaptsize.reporting.outcome import Outcome, kind_of, outcome_of_remeshing

#: Regions, and faces, that are listed.
_MOST_PARTS = 60
#: What `viewer.js` works on.
SCENE = """<div class="tools"><select id="scenes" aria-label="what to show"></select>
<label><input type="checkbox" id="edges" checked> edges</label>
<button id="whole">whole mesh</button>
<span>Drag to turn, shift and drag to move, scroll to zoom, click for values.</span></div>
<div class="scene"><canvas id="view" tabindex="0" aria-label="the mesh"></canvas>
<div id="bar"></div><div id="mark" hidden></div></div><p id="note"></p>"""


def report(
    path: str | os.PathLike[str],
    mesh: SimplexMesh,
    size: SizeFunction | None = None,
    *,
    original: SimplexMesh | None = None,
    tolerance: float = 1e-3,
    title: str | None = None,
    times: Sequence[tuple[str, float]] = (),
    about: Mapping[str, str] | None = None,
) -> None:
    """Write a page with the mesh in 3-D, its sizes and quality, and the worst places.

    The page is one HTML file without references to the network.  It shows the mesh as a
    scene that can be turned, whole and cut open, with the sizes, the quality, the edge length
    over the size, the regions, the tagged faces, and what controls the sizes.  Below are a table of
    regions and faces with their names and colours, histograms of edge lengths
    over sizes and of angles, the comparison with the request, and the checks.  A click on one of
    the worst places shows it in the mesh.

    Parameters
    ----------
    path : str or path
        File to write, ending in ``.html`` or ``.htm``, completely or not at all.
    mesh : SimplexMesh
        Triangles or tetrahedra.
    size : SizeFunction, optional
        The requested sizes.  By default the nodal field ``h`` of the mesh, if there is one.  Its
        ``report``, if any, adds the causes and the predicted number of elements.
    original : SimplexMesh, optional
        The mesh or surface from which ``mesh`` was made, to compare the boundaries.
    tolerance : float
        Allowed distance of the boundaries, over the diagonal of ``original``; at most 1.
    title : str, optional
        Heading of the page; by default the name of the file.
    times : sequence of (str, float)
        Names of steps and the seconds they took, for the table.
    about : mapping of str to str, optional
        Where the mesh comes from, such as the input, the command and the generator.  It is printed
        at the head of the page, below the calls that made the mesh and above the date and the
        version.

    Raises
    ------
    ValueError
        If an argument is invalid.

    Notes
    -----
    The file has 20 kB for the viewer and about 10 bytes per triangle shown.  It needs a browser
    with WebGL 2, of 2023 or later.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> report("square.html", mesh)  # doctest: +SKIP
    """
    target = as_path("path", path)
    if target.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"path must end in .html or .htm, got {os.fspath(path)!r}")
    mesh = as_mesh("mesh", mesh)
    if mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")
    for name, value, kind in (
        ("size", size, SizeFunction),
        ("original", original, SimplexMesh),
        ("title", title, str),
    ):
        if value is not None:
            check_type(name, value, kind)
    tolerance = as_tolerance("tolerance", tolerance)
    if size is None and "h" in mesh.point_data:
        size = SizeFunction(mesh, mesh.point_data["h"])
    outcome = None
    if size is not None and original is not None and size.report is not None:
        outcome = outcome_of_remeshing(mesh, original, size, tolerance)
        check = outcome.check
    else:
        check = check_mesh(mesh, original=original, size=size, tolerance=tolerance)
        if size is not None:
            outcome = Outcome(kind_of(mesh), size_conformity(mesh, size), check)
    head = {"title": title, "times": times, "about": {**_calls_of(mesh), **(about or {})}}
    write_page(target, mesh, size, outcome, check, head)


def _calls_of(mesh: SimplexMesh) -> dict[str, str]:
    """Return the calls that made a mesh, for the head of its page, as far as they are known."""
    origin = _calls.origin_of(mesh)
    if origin is None:
        return {}
    return {"made by": _calls.text_of_steps(_calls.as_steps(origin.call))}


def write_page(
    target: Path,
    mesh: SimplexMesh,
    size: SizeFunction | None,
    outcome: Outcome | None,
    check: MeshCheck,
    head: Mapping[str, Any],
) -> None:
    """Write the page of `report` from what is known of the mesh.

    ``head`` has the arguments ``title``, ``times`` and ``about`` of `report`.
    """
    from adaptsize.reporting.page import scenes  # matplotlib takes a while

    warnings = [] if outcome is None else outcome.warnings()
    charts = [] if size is None else [scenes.histogram_of_lengths(mesh, size)]
    charts.append(scenes.histogram_of_angles(mesh))
    heading = f"{escape(head['title'] or target.stem)}: {kind_of(mesh)}"
    data = json.dumps(scenes.data_of(scenes.scenes_of_mesh(mesh, size))).replace("<", "\\u003c")
    origin = [
        *head["about"].items(),
        ("date", datetime.now().astimezone().isoformat(" ", "seconds")),
        ("version", f"adaptsize {adaptsize.__version__}"),
        ("units", "lengths in the unit of the coordinates, angles in degrees"),
    ]
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{heading}</title><style>{_file('page.css')}</style></head><body>",
        f'<h1>{heading}</h1><div class="head">{_table(origin)}</div>',
        *(f'<p class="warning">{escape(text)}</p>' for text in warnings),
        "<h2>Mesh</h2>",
        SCENE,
        "<h2>Summary</h2>",
        _table(_rows(mesh, outcome, None if size is None else size.report, head["times"])),
        *_parts(mesh),
        '<h2>Edge lengths and angles</h2><div class="charts">',
        *(f"<figure>{chart}</figure>" for chart in charts),
        "</div><h2>Cells with the smallest angles</h2>",
        _worst_cells(mesh),
        "<h2>Checks</h2>",
        _checks(check),
        f"<script>const DATA = {data};\n{_file('viewer.js')}</script>",
        "</body></html>",
    ]
    write_whole(target, lambda path: write_text(path, "\n".join(parts)))


def _file(name: str) -> str:
    return files("adaptsize.reporting.page").joinpath(name).read_text(encoding="utf-8")


def _rows(
    mesh: SimplexMesh,
    outcome: Outcome | None,
    sizes: SizeReport | None,
    times: Sequence[tuple[str, float]],
) -> list[tuple[str, str]]:
    """Return the rows of the table: topic and finding."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    rows = [
        ("points", str(mesh.n_points)),
        ("extents", " x ".join(f"{x:.4g}" for x in np.asarray(high - low))),
    ]
    rows += outcome.rows if outcome else [("cells", f"{mesh.n_cells} {kind_of(mesh)}")]
    if sizes is not None:
        rows.append(("sizes", sizes.choices))
    if times:
        parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in times)
        rows.append(("time", f"{sum(seconds for _, seconds in times):.1f} s: {parts}"))
    return rows


def _parts(mesh: SimplexMesh) -> list[str]:
    """Return the table of regions and tagged facets: name, colour in the scene, number, measure."""
    from adaptsize.reporting.page.scenes import colours_of_tags, faces_of

    rows: list[str] = []
    measures = ("length", "area", "volume")
    for kind, part in (("region", mesh), ("face", faces_of(mesh))):
        if part is None or part.cell_tags is None:
            continue
        colours = colours_of_tags(part.cell_tags)
        for tag in list(colours)[:_MOST_PARTS]:
            cells = part.cell_tags == tag
            name = part.tag_names.get((part.cell_dim, tag), "")
            size = f"{measures[part.cell_dim - 1]} {part.measures[cells].sum():.6g}"
            swatch = f'<span class="swatch" style="background: {colours[tag]}"></span>'
            rows.append(
                f"<tr><th>{kind} {tag}</th><td>{swatch} {escape(name)}</td>"
                f'<td class="number">{int(cells.sum())} {kind_of(part)}</td>'
                f'<td class="number">{size}</td></tr>'
            )
        if len(colours) > _MOST_PARTS:
            rows.append(f"<tr><td></td><td>{len(colours) - _MOST_PARTS} more</td></tr>")
    if not rows:
        return []
    table = f'<div class="scroll"><table>{"".join(rows)}</table></div>'
    return ["<h2>Regions and faces</h2>", table]


def _table(rows: Sequence[tuple[str, str]]) -> str:
    body = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f'<div class="scroll"><table>{body}</table></div>'


def _checks(check: MeshCheck) -> str:
    """Return the table of checks, with the worst places below those that are not met."""
    rows = []
    for requirement in check.requirements:
        missed = '<span class="failed">missed</span>'
        state = missed if requirement.status == "missed" else requirement.status
        name, text = escape(requirement.name), escape(requirement.text)
        rows.append(f"<tr><th>{name}</th><td>{state}</td><td>{text}</td></tr>")
        rows += [_place(place.point, f"{place.value:.4g}") for place in requirement.places]
    rows += [f"<tr><th>note</th><td></td><td>{escape(note)}</td></tr>" for note in check.notes]
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'


def _worst_cells(mesh: SimplexMesh) -> str:
    """Return the table of the cells with the smallest angles."""
    angles = minimum_angles(mesh)
    worst = np.argsort(angles)[:5]
    middles = mesh.points[mesh.cells[worst]].mean(axis=1).tolist()
    rows = [
        _place(middle, f"{angle:.3g} degrees")
        for middle, angle in zip(middles, angles[worst].tolist(), strict=True)
    ]
    return f"<table>{''.join(rows)}</table>"


def _place(point: Sequence[float], value: str) -> str:
    """Return a row with a button that shows a place in the mesh."""
    at = ", ".join(f"{x:.6g}" for x in point)
    button = f'<button data-at="[{at}]">show</button>'
    return f'<tr><td></td><td>{button}</td><td class="number">{value} at ({at})</td></tr>'
