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
    from adaptsize.typing import FloatArray

_COLOUR = "#31688e"
_ROOT = float(np.sqrt(2.0))


def histograms(mesh: SimplexMesh, size: SizeFunction | None) -> list[go.Figure]:
    """Return the histograms of lengths, only where sizes are known, and of angles."""
    return ([] if size is None else [_lengths(mesh, size)]) + [_angles(mesh)]


def _lengths(mesh: SimplexMesh, size: SizeFunction) -> go.Figure:
    ratio = edge_ratios(mesh, size)
    logs = np.log2(ratio[np.isfinite(ratio) & (ratio > 0.0)])
    figure = _bars(np.clip(logs, -2.0, 2.0), np.linspace(-2.0, 2.0, 49), "edges")
    ticks = [0.25, 0.5, 1 / _ROOT, 1.0, _ROOT, 2.0, 4.0]
    figure.update_xaxes(
        title_text="edge length over requested size<br>(dashed: factor sqrt 2)",
        tickvals=np.log2(ticks),
        ticktext=[f"{x:.3g}" for x in ticks],
    )
    for bound in (-0.5, 0.5):
        figure.add_vline(bound, line={"dash": "dash", "color": "#888"})
    return figure


def _angles(mesh: SimplexMesh) -> go.Figure:
    solid = mesh.cell_dim == 3
    limit = 75.0 if solid else 61.0
    angles = np.clip(minimum_angles(mesh), 0.0, limit)
    figure = _bars(angles, np.arange(0.0, limit, 1.5), "cells")
    figure.update_xaxes(
        title_text=f"smallest {'dihedral ' if solid else ''}angle of a cell, degrees"
    )
    return figure


def _bars(values: FloatArray, ends: FloatArray, counted: str) -> go.Figure:
    import plotly.graph_objects as go

    counts, _ = np.histogram(values, ends)
    figure = go.Figure(go.Bar(x=0.5 * (ends[1:] + ends[:-1]), y=counts, marker_color=_COLOUR))
    figure.update_yaxes(title_text=counted)
    figure.update_layout(
        template="plotly_white",
        height=340,
        margin={"l": 10, "r": 10, "t": 20, "b": 10},
        showlegend=False,
        bargap=0.04,
    )
    return figure
