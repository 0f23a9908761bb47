"""A report on a mesh as one page of HTML, with nothing to fetch."""

from __future__ import annotations

import os
from collections.abc import Sequence
from html import escape
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import adaptsize
from adaptsize._checks import as_path, as_tolerance, check_type
from adaptsize._formats.guards import write_whole
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.quality import check_mesh, size_conformity
from adaptsize.quality.certificate import MeshCheck
from adaptsize.reporting.outcome import Outcome, kind_of, outcome_of_remeshing

_STYLE = """
body { color: #222; font: 15px/1.45 system-ui, sans-serif; margin: 1rem auto; max-width: 1100px;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0.5rem 0; } h2 { font-size: 1.15rem; margin: 1.5rem 0 0.5rem; }
table { border-collapse: collapse; } .scroll { overflow-x: auto; }
td, th { border-bottom: 1px solid #ddd; padding: 0.25rem 0.9rem 0.25rem 0; text-align: left;
  vertical-align: top; }
th { font-weight: 600; white-space: nowrap; } .number { font-variant-numeric: tabular-nums; }
.failed { color: #a33c00; font-weight: 600; } footer { color: #666; margin: 2rem 0; }
/* The scale of a scene follows its height: on narrow pages the mesh would be cut at its sides. */
.scene { height: min(640px, 60px + 64vw); } .scene > div { height: 100%; }
.charts { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(26rem, 100%), 1fr)); }
.warning { background: #fff6e0; border-left: 4px solid #d99a00; padding: 0.3rem 0.8rem; }
"""


def report(
    path: str | os.PathLike[str],
    mesh: SimplexMesh,
    size: SizeFunction | None = None,
    *,
    original: SimplexMesh | None = None,
    tolerance: float = 1e-3,
    title: str | None = None,
    times: Sequence[tuple[str, float]] = (),
) -> None:
    """Write a page with the mesh in 3-D, its sizes and quality, and the worst places.

    The page is one HTML file without references to the network.  It shows the mesh as a
    scene that can be turned, whole and cut open, with the sizes, the quality, the edge length
    over the size, and what controls the sizes.  Below are histograms of edge lengths over sizes
    and of angles, the comparison with the request, and the worst places with their coordinates.

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

    Raises
    ------
    ValueError
        If an argument is invalid.
    ImportError
        If plotly is not installed.

    Notes
    -----
    The file has about 5 MB for the viewer (plotly.js) and 150 bytes per triangle shown.

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
    check_plotly()
    from adaptsize.reporting import figures

    if size is None and "h" in mesh.point_data:
        size = SizeFunction(mesh, mesh.point_data["h"])
    outcome = None
    if size is not None and original is not None and size.report is not None:
        outcome = outcome_of_remeshing(mesh, original, size, tolerance)
    elif size is not None:
        outcome = Outcome(kind_of(mesh), size_conformity(mesh, size))
    warnings = [] if outcome is None else outcome.warnings()
    charts = [] if size is None else [figures.histogram_of_lengths(mesh, size)]
    charts.append(figures.histogram_of_angles(mesh))
    config = {"responsive": True, "displaylogo": False}
    scene, *bars = (
        figure.to_html(full_html=False, include_plotlyjs=number == 0, config=config)
        for number, figure in enumerate(
            [figures.figure_of(figures.scenes_of_mesh(mesh, size)), *charts]
        )
    )
    heading = f"{escape(title or target.stem)}: {kind_of(mesh)}"
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{heading}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{heading}</h1>",
        *(f'<p class="warning">{escape(text)}</p>' for text in warnings),
        "<h2>Mesh</h2><p>Choose what to show from the list; drag to turn, scroll to zoom.</p>",
        f'<div class="scene">{scene}</div>',
        "<h2>Summary</h2>",
        _table(_rows(mesh, outcome, None if size is None else size.report, times)),
        '<h2>Edge lengths and angles</h2><div class="charts">',
        *bars,
        "</div><h2>Demands</h2>",
        _demands(check_mesh(mesh, original=original, size=size, tolerance=tolerance)),
        f"<footer>adaptsize {escape(adaptsize.__version__)}</footer>",
        "</body></html>",
    ]

    def write_text(path: Path) -> None:
        path.write_text("\n".join(parts), encoding="utf-8")

    write_whole(target, write_text)


def check_plotly() -> None:
    """Refuse a report without plotly."""
    if find_spec("plotly") is None:
        raise ImportError('reports need plotly; install it with: pip install "adaptsize[report]"')


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


def _table(rows: Sequence[tuple[str, str]]) -> str:
    body = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f'<div class="scroll"><table>{body}</table></div>'


def _demands(check: MeshCheck) -> str:
    """Return the table of demands, with the worst places below those that are not met."""
    rows = []
    for demand in check.demands:
        state = "met" if demand.is_met else '<span class="failed">not met</span>'
        rows.append(
            f"<tr><th>{escape(demand.name)}</th><td>{state}</td><td>{escape(demand.text)}</td></tr>"
        )
        for place in demand.places:
            at = ", ".join(f"{x:.6g}" for x in place.point)
            rows.append(
                f'<tr><td></td><td></td><td class="number">{place.value:.4g} at ({at})</td></tr>'
            )
    rows += [f"<tr><th>note</th><td></td><td>{escape(note)}</td></tr>" for note in check.notes]
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'
