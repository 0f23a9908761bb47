"""The figures of the page: scenes to turn in a browser, with a list to choose from; histograms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.plot.pictures import scene_of_causes
from adaptsize.plot.scene import CLASS_COLORS, Scene, scene_of_mesh
from adaptsize.quality import minimum_angles, radius_ratios
from adaptsize.quality.conformity import edge_ratios
from adaptsize.typing import FloatArray


def scenes_of_mesh(mesh: SimplexMesh, size: SizeFunction | None) -> dict[str, Scene]:
    """Return the scenes by their names; of tetrahedra cut open and whole."""
    shown: dict[str, tuple[npt.NDArray[Any], bool]] = {}
    if size is not None:
        shown["size h"] = size(mesh.points), True
        shown["edge length over size"] = _ratios_at_nodes(mesh, size), True
    shown["quality (radius ratio)"] = radius_ratios(mesh), False
    if mesh.cell_tags is not None:
        shown["region"] = mesh.cell_tags, False
    clips = {", cut open": "auto", "": None} if mesh.cell_dim == 3 else {"": None}
    scenes = {
        label + suffix: scene_of_mesh(
            mesh, values, clip, on_nodes=on_nodes, label=label, classes=label == "region"
        )
        for label, (values, on_nodes) in shown.items()
        for suffix, clip in clips.items()
    }
    report = None if size is None else size.report
    background = None if report is None else report.background
    if report is not None and isinstance(background, SimplexMesh) and background.cell_dim > 1:
        scenes["what controls the size"] = scene_of_causes(report, None)
    return scenes


def _ratios_at_nodes(mesh: SimplexMesh, size: SizeFunction) -> FloatArray:
    """Return the geometric mean of length over size of the edges at each node."""
    logs = np.log(edge_ratios(mesh, size))
    logs[~np.isfinite(logs)] = 0.0
    ends = mesh.edges.ravel()
    sums = np.bincount(ends, np.repeat(logs, 2), mesh.n_points)
    return np.exp(sums / np.maximum(np.bincount(ends, minlength=mesh.n_points), 1))


def figure_of(scenes: Mapping[str, Scene]) -> go.Figure:
    """Return the figure with the list of scenes; the first one is visible."""
    traces, owner = [], []
    for number, scene in enumerate(scenes.values()):
        found = [_triangles(scene)]
        if len(scene.cells) <= 60_000:  # more edges make the page slow
            found.append(_edges(scene))
        traces += [trace.update(visible=number == 0) for trace in found]
        owner += [number] * len(found)
    buttons = [
        {"label": name, "method": "restyle", "args": ["visible", [o == k for o in owner]]}
        for k, name in enumerate(scenes)
    ]
    flat = next(iter(scenes.values())).flat
    eye = (0.0, 0.0, 1.6) if flat else (0.8, -1.07, 0.84)  # as in `adaptsize.plot`
    axis = {"showbackground": False, "showspikes": False}
    figure = go.Figure(traces)
    figure.update_layout(
        margin={"l": 0, "r": 0, "t": 50, "b": 0},
        scene={
            "aspectmode": "data",
            "camera": {  # the viewer's place as in `adaptsize.plot`, in units of the scene
                "eye": dict(zip("xyz", eye, strict=True)),
                "projection": {"type": "orthographic"},
                "up": {"x": 0, "y": int(flat), "z": int(not flat)},
            },
            "dragmode": "pan" if flat else "turntable",
            **dict.fromkeys(("xaxis", "yaxis"), axis),
            "zaxis": {"visible": False} if flat else axis,
        },
        updatemenus=[
            {"buttons": buttons, "x": 0.0, "xanchor": "left", "y": 1.0, "yanchor": "bottom"}
        ],
    )
    return figure


def _triangles(scene: Scene) -> Any:
    values, colours = _colours(scene)
    # Mostly ambient, so that equal values keep equal colours on faces of every direction.
    ambient, diffuse = (1.0, 0.0) if scene.flat else (0.8, 0.45)
    return go.Mesh3d(
        **dict(zip("xyz", scene.points.astype(np.float32).T, strict=True)),
        **dict(zip("ijk", scene.cells.astype(np.int32).T, strict=True)),
        intensity=values.astype(np.float32),
        intensitymode="vertex" if scene.on_nodes else "cell",
        flatshading=True,
        lighting={"ambient": ambient, "diffuse": diffuse, "specular": 0.0, "fresnel": 0.0},
        name=scene.label,
        hoverinfo="x+y" if scene.flat else "x+y+z",
        **colours,
    )


def _colours(scene: Scene) -> tuple[FloatArray, dict[str, Any]]:
    """Return what is coloured, and the scale and bar that explain it."""
    bar: dict[str, Any] = {"title": {"text": scene.label, "side": "right"}}
    if scene.classes:
        count = len(scene.names)
        bar |= {"tickvals": list(range(count)), "ticktext": scene.class_labels}
        colours = [CLASS_COLORS[k % len(CLASS_COLORS)] for k in range(count)]
        scale: Any = [(s / count, c) for k, c in enumerate(colours) for s in (k, k + 1)]
        values = np.searchsorted(scene.names, scene.values).astype(np.float64)
        low, high = -0.5, count - 0.5
    else:
        low, high = scene.limits
        scale, values = "Viridis", np.where(np.isfinite(scene.values), scene.values, high)
        bar["ticktext"], at = [f"{tick:.4g}" for tick in scene.ticks], scene.ticks
        if scene.is_logarithmic:
            values, at = np.log10(values), np.log10(at)
            low, high = np.log10([low, high]).tolist()
        bar["tickvals"] = at.tolist()
    return values, {"colorscale": scale, "colorbar": bar, "cmin": low, "cmax": high}


def _edges(scene: Scene) -> Any:
    """Return all edges as one broken line."""
    pairs = np.concatenate([scene.cells[:, [0, 1]], scene.cells[:, [1, 2]], scene.cells[:, [2, 0]]])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    line = np.full((len(pairs), 3, 3), np.nan, dtype=np.float32)
    line[:, :2] = scene.points[pairs]
    return go.Scatter3d(
        **dict(zip("xyz", line.reshape(-1, 3).T, strict=True)),
        mode="lines",
        line={"color": "#333", "width": 2},
        hoverinfo="skip",
        showlegend=False,
    )


def histogram_of_lengths(mesh: SimplexMesh, size: SizeFunction) -> go.Figure:
    """Return the histogram of edge lengths over sizes, on a logarithmic axis."""
    ratio = edge_ratios(mesh, size)
    logs = np.log2(ratio[np.isfinite(ratio) & (ratio > 0.0)])
    figure = _bars(np.clip(logs, -2.0, 2.0), np.linspace(-2.0, 2.0, 49), "edges")
    powers = [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]
    figure.update_xaxes(
        title_text="edge length over requested size<br>(dashed: factor sqrt 2)",
        tickvals=powers,
        ticktext=[f"{2.0**power:.3g}" for power in powers],
    )
    for bound in (-0.5, 0.5):
        figure.add_vline(bound, line={"dash": "dash", "color": "#888"})
    return figure


def histogram_of_angles(mesh: SimplexMesh) -> go.Figure:
    """Return the histogram of the smallest angles of the cells."""
    limit, kind = (75.0, "dihedral angle") if mesh.cell_dim == 3 else (61.0, "angle")
    angles = np.clip(minimum_angles(mesh), 0.0, limit)
    figure = _bars(angles, np.arange(0.0, limit, 1.5), "cells")
    figure.update_xaxes(title_text=f"smallest {kind} of a cell, degrees")
    return figure


def _bars(values: FloatArray, ends: FloatArray, counted: str) -> go.Figure:
    counts, _ = np.histogram(values, ends)
    figure = go.Figure(go.Bar(x=0.5 * (ends[1:] + ends[:-1]), y=counts, marker_color="#31688e"))
    figure.update_yaxes(title_text=counted)
    figure.update_layout(
        template="plotly_white",
        height=340,
        margin={"l": 10, "r": 10, "t": 20, "b": 10},
        showlegend=False,
        bargap=0.04,
    )
    return figure
