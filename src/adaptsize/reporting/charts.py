"""Histograms of edge lengths over sizes, and of angles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize.quality import minimum_angles
from adaptsize.quality.conformity import edge_ratios

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.typing import FloatArray, IntArray

_COLOUR = "#31688e"
_ROOT = float(np.sqrt(2.0))


def histograms(mesh: SimplexMesh, size: SizeFunction | None) -> go.Figure:
    """Return the histograms side by side; that of lengths only where sizes are known."""
    from plotly.subplots import make_subplots

    solid = mesh.cell_dim == 3
    angle = f"smallest {'dihedral ' if solid else ''}angle of a cell, degrees"
    titles = (
        [angle]
        if size is None
        else ["edge length over requested size (dashed: factor sqrt 2)", angle]
    )
    figure = make_subplots(1, len(titles), horizontal_spacing=0.1)
    if size is not None:
        ratio = edge_ratios(mesh, size)
        logs = np.log2(ratio[np.isfinite(ratio) & (ratio > 0.0)])
        counts, ends = np.histogram(np.clip(logs, -2.0, 2.0), np.linspace(-2.0, 2.0, 49))
        figure.add_trace(_bars(counts, 0.5 * (ends[1:] + ends[:-1])), 1, 1)
        ticks = [0.25, 0.5, 1 / _ROOT, 1.0, _ROOT, 2.0, 4.0]
        text = [f"{x:.3g}" for x in ticks]
        figure.update_xaxes(tickvals=np.log2(ticks), ticktext=text, row=1, col=1)
        for bound in (-0.5, 0.5):
            figure.add_vline(bound, line={"dash": "dash", "color": "#888"}, row=1, col=1)
    limit = 75.0 if solid else 61.0
    counts, ends = np.histogram(np.clip(minimum_angles(mesh), 0.0, limit), np.arange(0, limit, 1.5))
    figure.add_trace(_bars(counts, 0.5 * (ends[1:] + ends[:-1])), 1, len(titles))
    for column, title in enumerate(titles, 1):
        figure.update_xaxes(title_text=title, row=1, col=column)
        figure.update_yaxes(title_text="cells" if title == angle else "edges", row=1, col=column)
    figure.update_layout(
        template="plotly_white",
        height=340,
        margin={"l": 10, "r": 10, "t": 20, "b": 10},
        showlegend=False,
        bargap=0.04,
    )
    return figure


def _bars(counts: IntArray, middles: FloatArray) -> go.Bar:
    import plotly.graph_objects as go

    return go.Bar(x=middles, y=counts, marker_color=_COLOUR)
