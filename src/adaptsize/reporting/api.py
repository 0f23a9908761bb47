"""Public function: a report on a mesh as one page of HTML."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from adaptsize._checks import as_path, as_tolerance, check_type
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.report import SizeReport
from adaptsize.quality import check_mesh, size_conformity
from adaptsize.reporting.outcome import Outcome, kind_of, outcome_of_remeshing


def report(
    path: str | os.PathLike[str],
    mesh: SimplexMesh,
    size: SizeFunction | None = None,
    *,
    original: SimplexMesh | None = None,
    size_report: SizeReport | None = None,
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
        The requested sizes.  By default the nodal field ``h`` of the mesh, if there is one.
    original : SimplexMesh, optional
        The mesh or surface from which ``mesh`` was made, to compare the boundaries.
    size_report : SizeReport, optional
        Of ``size_function(..., full_output=True)``, to show causes and predicted elements.
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
    check_type("mesh", mesh, SimplexMesh)
    if mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")
    for name, value, kind in (
        ("size", size, SizeFunction),
        ("original", original, SimplexMesh),
        ("size_report", size_report, SizeReport),
        ("title", title, str),
    ):
        if value is not None:
            check_type(name, value, kind)
    tolerance = as_tolerance("tolerance", tolerance)
    check_plotly()
    from adaptsize.reporting.charts import histograms
    from adaptsize.reporting.page import page_of
    from adaptsize.reporting.views import figure_of, views_of_causes, views_of_mesh

    if size is None and "h" in mesh.point_data:
        size = SizeFunction(mesh, mesh.point_data["h"])
    views = views_of_mesh(mesh, size)
    if size_report is not None:
        views += views_of_causes(size_report)
    outcome = _outcome(mesh, size, original, size_report, tolerance)
    check = check_mesh(mesh, original=original, size=size, tolerance=tolerance)
    text = page_of(
        title or target.stem,
        kind_of(mesh),
        rows=_rows(mesh, outcome, size_report, times),
        warnings=outcome.warnings() if outcome else [],
        check=check,
        scene=figure_of(views),
        charts=histograms(mesh, size),
    )
    _write(text, target)


def check_plotly() -> None:
    """Refuse a report without plotly."""
    if find_spec("plotly") is None:
        raise ImportError('reports need plotly; install it with: pip install "adaptsize[report]"')


def _outcome(
    mesh: SimplexMesh,
    size: SizeFunction | None,
    original: SimplexMesh | None,
    size_report: SizeReport | None,
    tolerance: float,
) -> Outcome | None:
    if size is None:
        return None
    if original is not None and size_report is not None:
        return outcome_of_remeshing(mesh, original, size, size_report, tolerance)
    return Outcome(kind_of(mesh), size_conformity(mesh, size))


def _rows(
    mesh: SimplexMesh,
    outcome: Outcome | None,
    size_report: SizeReport | None,
    times: Sequence[tuple[str, float]],
) -> list[tuple[str, str]]:
    """Return the rows of the table: topic and finding."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    rows = [
        ("points", str(mesh.n_points)),
        ("extents", " x ".join(f"{x:.4g}" for x in np.asarray(high - low))),
    ]
    rows += outcome.rows if outcome else [("cells", f"{mesh.n_cells} {kind_of(mesh)}")]
    if size_report is not None:
        rows.append(("sizes", size_report.choices))
    if times:
        parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in times)
        rows.append(("time", f"{sum(seconds for _, seconds in times):.1f} s: {parts}"))
    return rows


def _write(text: str, path: Path) -> None:
    unfinished = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        unfinished.write_text(text, encoding="utf-8")
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
