"""Scenes of a mesh to turn in a browser, as one figure with a list to choose from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.plot.scene import CLASS_COLORS, Scene, make_scene
from adaptsize.quality import radius_ratios
from adaptsize.quality.conformity import edge_ratios

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from adaptsize.domain_size.report import SizeReport

#: Edges are drawn up to this number of triangles in a scene.
_MOST_WITH_EDGES = 60_000
#: Towards the viewer, as in `adaptsize.plot`, in units of the scene.
_EYE = {"x": 0.8, "y": -1.07, "z": 0.84}
#: Mostly ambient, so that equal values keep equal colours on faces of every direction.
_LIGHT = {"ambient": 0.8, "diffuse": 0.45, "specular": 0.0, "fresnel": 0.0}


@dataclass(frozen=True)
class View:
    """One entry of the list."""

    name: str
    scene: Scene


def views_of_mesh(mesh: SimplexMesh, size: SizeFunction | None) -> list[View]:
    """Return the views of sizes and quality; of tetrahedra cut open and whole."""
    shown: list[tuple[str, npt.NDArray[Any], bool]] = []
    if size is not None:
        shown.append(("size h", size(mesh.points), True))
        shown.append(("edge length over size", _ratios_at_nodes(mesh, size), True))
    shown.append(("quality (radius ratio)", radius_ratios(mesh), False))
    if mesh.cell_tags is not None:
        shown.append(("region", mesh.cell_tags, False))
    views = []
    for name, values, on_nodes in shown:
        for clip in ("auto", None) if mesh.cell_dim == 3 else (None,):
            scene = make_scene(
                mesh, values, label=name, clip=clip, on_nodes=on_nodes, classes=name == "region"
            )
            views.append(View(f"{name}, cut open" if clip else name, scene))
    return views


def views_of_causes(report: SizeReport) -> list[View]:
    """Return the view of what controls the size where; none on grids and octrees."""
    mesh = report.background
    if not isinstance(mesh, SimplexMesh) or mesh.cell_dim == 1:
        return []
    codes = report.cause[mesh.cells]
    counts = np.stack([(codes == k).sum(axis=1) for k in report.codes])
    name = "what controls the size"
    scene = make_scene(
        mesh, counts.argmax(axis=0), label=name, clip=None, on_nodes=False, classes=True
    )
    return [View(name, replace(scene, class_names=dict(enumerate(report.causes))))]


def _ratios_at_nodes(mesh: SimplexMesh, size: SizeFunction) -> npt.NDArray[np.float64]:
    """Return the geometric mean of length over size of the edges at each node."""
    logs = np.log(edge_ratios(mesh, size))
    logs[~np.isfinite(logs)] = 0.0
    ends = mesh.edges.ravel()
    sums = np.bincount(ends, np.repeat(logs, 2), mesh.n_points)
    return np.exp(sums / np.maximum(np.bincount(ends, minlength=mesh.n_points), 1))


def figure_of(views: list[View]) -> go.Figure:
    """Return the figure with the list of views; the first one is visible."""
    import plotly.graph_objects as go

    traces, owner = [], []
    for number, view in enumerate(views):
        found = [_triangles(view.scene, visible=number == 0)]
        if len(view.scene.cells) <= _MOST_WITH_EDGES:
            found.append(_edges(view.scene, visible=number == 0))
        traces += found
        owner += [number] * len(found)
    buttons = [
        {"label": v.name, "method": "restyle", "args": ["visible", [o == k for o in owner]]}
        for k, v in enumerate(views)
    ]
    flat = views[0].scene.flat
    eye = {"x": 0.0, "y": 0.0, "z": 1.6} if flat else _EYE
    camera = {"eye": eye, "projection": {"type": "orthographic"}}
    camera["up"] = {"x": 0, "y": 1 if flat else 0, "z": 0 if flat else 1}
    axis = {"showbackground": False, "showspikes": False}
    figure = go.Figure(traces)
    figure.update_layout(
        margin={"l": 0, "r": 0, "t": 50, "b": 0},
        scene={
            "aspectmode": "data",
            "camera": camera,
            "dragmode": "pan" if flat else "turntable",
            **{f"{name}axis": axis for name in "xy"},
            "zaxis": {"visible": False} if flat else axis,
        },
        updatemenus=[
            {"buttons": buttons, "x": 0.0, "xanchor": "left", "y": 1.0, "yanchor": "bottom"}
        ],
    )
    return figure


def _triangles(scene: Scene, *, visible: bool) -> Any:
    import plotly.graph_objects as go

    points, cells = scene.points.astype(np.float32), scene.cells
    values, bar = _colours(scene)
    return go.Mesh3d(
        **dict(zip("xyz", points.T, strict=True)),
        **dict(zip("ijk", cells.T.astype(np.int32), strict=True)),
        intensity=values.astype(np.float32),
        intensitymode="vertex" if scene.on_nodes else "cell",
        flatshading=True,
        lighting=_LIGHT if not scene.flat else {**_LIGHT, "ambient": 1.0, "diffuse": 0.0},
        name=scene.label,
        hoverinfo="x+y" if scene.flat else "x+y+z",
        visible=visible,
        **bar,
    )


def _colours(scene: Scene) -> tuple[npt.NDArray[np.float64], dict[str, Any]]:
    """Return what is coloured, and the scale and bar that explain it."""
    title = {"text": scene.label, "side": "right"}
    if scene.classes:
        names = scene.names
        values = np.searchsorted(names, scene.values).astype(np.float64)
        count = len(names)
        colours = [CLASS_COLORS[k % len(CLASS_COLORS)] for k in range(count)]
        scale = [(s / count, c) for k, c in enumerate(colours) for s in (k, k + 1)]
        ticks = {"tickvals": list(range(count)), "ticktext": scene.class_labels}
        limits = {"cmin": -0.5, "cmax": count - 0.5}
        return values, {"colorscale": scale, "colorbar": {"title": title, **ticks}, **limits}
    low, high = scene.limits
    values = np.where(np.isfinite(scene.values), scene.values, high)
    at, text = scene.ticks, [f"{tick:.4g}" for tick in scene.ticks]
    if scene.is_logarithmic:
        values, at = np.log10(values), np.log10(at)
        low, high = np.log10([low, high]).tolist()
    bar = {"title": title, "tickvals": at.tolist(), "ticktext": text}
    return values, {"colorscale": "Viridis", "colorbar": bar, "cmin": low, "cmax": high}


def _edges(scene: Scene, *, visible: bool) -> Any:
    """Return all edges as one broken line."""
    import plotly.graph_objects as go

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
        visible=visible,
    )
