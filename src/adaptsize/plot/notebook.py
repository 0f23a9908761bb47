"""What notebooks show of a mesh or a size function: a small picture and a table."""

from base64 import b64encode
from html import escape

import numpy as np

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.plot.pictures import plot_mesh, plot_size


def html_of(shown: SimplexMesh | SizeFunction) -> str:
    """Return a table and, of up to a million cells, a picture where this machine can draw."""
    background = shown.background if isinstance(shown, SizeFunction) else shown
    rows = {"": type(shown).__name__, "background": repr(background)}
    if isinstance(shown, SizeFunction):
        finite = shown.values[np.isfinite(shown.values)]
        rows["sizes"] = f"{finite.min():.4g} to {finite.max():.4g}" if len(finite) else "inf"
        if shown.report is not None:
            rows["bounded by"] = repr(shown.report).removeprefix("SizeReport(").rstrip(")")
    if isinstance(background, SimplexMesh):
        rows |= _rows_of(background)
    if background is shown:
        del rows["background"]
    table = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(text)}</td></tr>"
        for name, text in rows.items()
        if text
    )
    return f"<div>{_picture(shown, background)}<table>{table}</table></div>"


def _rows_of(mesh: SimplexMesh) -> dict[str, str]:
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    rows = {
        "points": f"{mesh.n_points} in {mesh.dim}-D",
        "cells": repr(mesh).rpartition(", ")[2].rstrip(")"),
        "bounds": ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True)),
    }
    for label, tags, dim in (
        ("regions", mesh.cell_tags, mesh.cell_dim),
        ("tagged facets", mesh.facet_tags, mesh.cell_dim - 1),
    ):
        numbers = [] if tags is None else np.unique(tags).tolist()
        names = [mesh.tag_names.get((dim, tag), str(tag)) for tag in numbers[:12]]
        rows[label] = ", ".join(names) + (", ..." if len(numbers) > len(names) else "")
    rows["fields"] = ", ".join([*mesh.point_data, *mesh.cell_data][:12])
    return rows


def _picture(shown: SimplexMesh | SizeFunction, background: object) -> str:
    if getattr(background, "n_cells", 0) > 1_000_000 or getattr(background, "dim", 1) == 1:
        return ""
    draw = plot_mesh if isinstance(shown, SimplexMesh) else plot_size
    try:
        data = draw(shown, width=480)._repr_png_()  # type: ignore[arg-type]
    except ValueError:  # sizes that are all inf
        return ""
    return f"<img width='480' src='data:image/png;base64,{b64encode(data).decode()}'/>"
