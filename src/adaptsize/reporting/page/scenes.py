"""What the viewer of a report shows: the scenes, with their arrays compressed."""

import base64
import io
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.plot.pictures import scene_of_causes
from adaptsize.plot.scene import Scene, scene_of_mesh
from adaptsize.plot.style import CLASS_COLORS, CURVES, FIELDS, INK, QUALITY, SETTINGS, colors_of
from adaptsize.quality.conformity import edge_ratios
from adaptsize.quality.elements import minimum_angles, radius_ratios
from adaptsize.typing import FloatArray


def scenes_of_mesh(mesh: SimplexMesh, size: SizeFunction | None) -> dict[str, Scene]:
    """Return the scenes by their names; of tetrahedra cut open and whole."""
    shown: dict[str, tuple[npt.NDArray[Any], bool, str | None]] = {}
    if size is not None:
        shown["size h"] = size(mesh.points), True, None
        shown["edge length over size"] = _ratios_at_nodes(mesh, size), True, FIELDS
    shown["quality (radius ratio)"] = radius_ratios(mesh), False, QUALITY
    if mesh.cell_tags is not None:
        shown["region"] = mesh.cell_tags, False, None
    clips = {", cut open": "auto", "": None} if mesh.cell_dim == 3 else {"": None}
    scenes = {
        label + suffix: scene_of_mesh(
            mesh,
            values,
            clip,
            on_nodes=on_nodes,
            label=label,
            classes=label == "region",
            tags=tuple(colours_of_tags(values)) if label == "region" else (),
            colors=colors,
        )
        for label, (values, on_nodes, colors) in shown.items()
        for suffix, clip in clips.items()
    }
    faces = faces_of(mesh)
    if faces is not None and faces.cell_tags is not None and mesh.cell_dim == 3:
        scenes["face"] = scene_of_mesh(
            faces,
            faces.cell_tags,
            None,
            on_nodes=False,
            label="face",
            classes=True,
            tags=tuple(colours_of_tags(faces.cell_tags)),
        )
    report = None if size is None else size.report
    background = None if report is None else report.background
    if report is not None and isinstance(background, SimplexMesh) and background.cell_dim > 1:
        scenes["what controls the size"] = scene_of_causes(report, None)
    return scenes


def faces_of(mesh: SimplexMesh) -> SimplexMesh | None:
    """Return the tagged facets as a mesh whose regions they are, or None."""
    if mesh.tagged_facets is None or mesh.facet_tags is None or len(mesh.tagged_facets) == 0:
        return None
    return SimplexMesh(
        mesh.points, mesh.tagged_facets, cell_tags=mesh.facet_tags, tag_names=mesh.tag_names
    )


def colours_of_tags(tags: npt.NDArray[Any]) -> dict[int, str]:
    """Return the colour of each tag in the scenes."""
    return {int(tag): CLASS_COLORS[k % len(CLASS_COLORS)] for k, tag in enumerate(np.unique(tags))}


def _ratios_at_nodes(mesh: SimplexMesh, size: SizeFunction) -> FloatArray:
    """Return the geometric mean of length over size of the edges at each node."""
    logs = np.log(edge_ratios(mesh, size))
    logs[~np.isfinite(logs)] = 0.0
    ends = mesh.edges.ravel()
    sums = np.bincount(ends, np.repeat(logs, 2), mesh.n_points)
    return np.exp(sums / np.maximum(np.bincount(ends, minlength=mesh.n_points), 1))


def data_of(scenes: Mapping[str, Scene]) -> dict[str, Any]:
    """Return what the viewer reads, plain values.

    Coordinates are rounded to 1/65535 of the extents, values to 1/255 of their range.  Scenes with
    the same cells share them.
    """
    geometries: list[dict[str, Any]] = []
    numbers: dict[tuple[bytes, bytes], int] = {}
    found = []
    for name, scene in scenes.items():
        key = scene.points.tobytes(), scene.cells.tobytes()
        if key not in numbers:
            numbers[key] = len(geometries)
            geometries.append(_geometry(scene))
        found.append({"name": name, "geometry": numbers[key], **_coloured(scene)})
    return {"geometries": geometries, "scenes": found}


def _packed(array: npt.NDArray[Any], kind: str) -> str:
    """Return the numbers of an array, compressed, as text."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(array, kind).tobytes(), 9)).decode()


def _geometry(scene: Scene) -> dict[str, Any]:
    used, cells = np.unique(scene.cells, return_inverse=True)
    points = scene.points[used]
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    steps = np.rint((points - low) / np.where(size > 0.0, size, 1.0) * 65535.0)
    return {
        "points": _packed(steps, "<u2"),
        "cells": _packed(cells, "<u4"),
        "low": low.tolist(),
        "size": size.tolist(),
        "flat": scene.flat,
    }


def _coloured(scene: Scene) -> dict[str, Any]:
    """Return the values of a scene, 0 to 255 or numbers of classes, and what explains them."""
    values = scene.values[np.unique(scene.cells)] if scene.on_nodes else scene.values
    result: dict[str, Any] = {
        "label": scene.label, "classes": scene.classes, "on_nodes": scene.on_nodes
    }  # fmt: skip
    if scene.classes:
        places = np.searchsorted(scene.names, np.where(np.isfinite(values), values, np.inf))
        ticks: list[tuple[float, str]] = list(enumerate(scene.class_labels))
        result["colours"] = CLASS_COLORS
        return result | {"values": _packed(places, "<u4"), "ticks": ticks}
    mapped = colors_of(scene)
    low, high = scene.limits
    scaled = mapped.norm(np.where(np.isfinite(values), values, high))
    at = np.asarray(mapped.norm(scene.ticks)).tolist()
    ticks = [(place, f"{tick:.4g}") for place, tick in zip(at, scene.ticks, strict=True)]
    return result | {
        "values": _packed(np.rint(255.0 * np.clip(scaled, 0.0, 1.0)), "<u1"),
        "ticks": ticks,
        "colours": [to_hex(colour) for colour in mapped.cmap(np.linspace(0.0, 1.0, 12))],
        "low": low,
        "high": high,
        "logarithmic": bool(scene.is_logarithmic),
    }


def histogram_of_lengths(mesh: SimplexMesh, size: SizeFunction) -> str:
    """Return the histogram of edge lengths over sizes, on a logarithmic axis."""
    ratio = edge_ratios(mesh, size)
    logs = np.log2(ratio[np.isfinite(ratio) & (ratio > 0.0)])
    ticks = {power: f"{2.0**power:.3g}" for power in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)}
    title = "edges by length over requested size (dashed: factor sqrt 2)"
    return _histogram(
        np.clip(logs, -2.0, 2.0), np.linspace(-2.0, 2.0, 49), ticks, title, (-0.5, 0.5)
    )


def histogram_of_angles(mesh: SimplexMesh) -> str:
    """Return the histogram of the smallest angles of the cells."""
    limit, kind = (75, "dihedral angle") if mesh.cell_dim == 3 else (61, "angle")
    ticks = {float(angle): f"{angle}" for angle in range(0, limit, 10)}
    angles = np.clip(minimum_angles(mesh), 0.0, limit)
    return _histogram(
        angles, np.arange(0.0, limit, 1.5), ticks, f"cells by smallest {kind}, degrees"
    )


def _histogram(
    values: FloatArray, ends: FloatArray, ticks: Mapping[float, str], title: str,
    bounds: Sequence[float] = (),
) -> str:  # fmt: skip
    """Return a chart as an element of HTML."""
    file = io.StringIO()
    with rc_context(SETTINGS), rc_context({"svg.fonttype": "none", "font.size": 10.5}):
        figure = Figure(figsize=(4.8, 2.6), layout="constrained")
        axes = figure.subplots()
        axes.hist(values, ends.tolist(), rwidth=0.85, color=CURVES[0])
        axes.set_xticks(list(ticks), labels=list(ticks.values()))
        axes.set_yticks([0, int(np.histogram(values, ends)[0].max())])
        axes.set_xlabel(title)
        axes.spines[["top", "right"]].set_visible(False)
        for bound in bounds:
            axes.axvline(bound, color=INK, linestyle="--", linewidth=0.8)
        figure.savefig(file, format="svg")
    text = file.getvalue()
    return text[text.index("<svg") :]
