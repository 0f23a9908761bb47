"""What the viewer of a report shows: the scenes, and their arrays in one compressed block."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.colors import to_hex

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.plot.pictures import scene_of_causes
from adaptsize.plot.scene import Scene, scene_of_mesh
from adaptsize.plot.style import CLASS_COLORS, FIELDS, QUALITY, SIZES
from adaptsize.quality.conformity import edge_ratios
from adaptsize.quality.elements import radius_ratios
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
            colors=colors,
        )
        for label, (values, on_nodes, colors) in shown.items()
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


def data_of(scenes: Mapping[str, Scene]) -> dict[str, Any]:
    """Return what the viewer reads, plain values.

    Coordinates are rounded to 1/65535 of the extents, values to 1/255 of their range.  Scenes with
    the same cells share them.
    """
    block = _Block()
    geometries: list[dict[str, Any]] = []
    numbers: dict[tuple[bytes, bytes], int] = {}
    found = []
    for name, scene in scenes.items():
        key = scene.points.tobytes(), scene.cells.tobytes()
        if key not in numbers:
            numbers[key] = len(geometries)
            geometries.append(_geometry(scene, block))
        found.append({"name": name, "geometry": numbers[key], **_coloured(scene, block)})
    return {"geometries": geometries, "scenes": found, "block": block.text()}


class _Block:
    """Arrays one after the other, compressed."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, array: npt.NDArray[Any], kind: str) -> list[int]:
        """Append an array; return where it starts, in bytes, and its number of entries."""
        part = np.ascontiguousarray(array, kind).tobytes()
        start = self._length
        self._parts.append(part)
        self._length += len(part)
        return [start, array.size]

    def text(self) -> str:
        return base64.b64encode(zlib.compress(b"".join(self._parts), 9)).decode()


def _geometry(scene: Scene, block: _Block) -> dict[str, Any]:
    used, cells = np.unique(scene.cells, return_inverse=True)
    points = scene.points[used]
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    steps = np.rint((points - low) / np.where(size > 0.0, size, 1.0) * 65535.0)
    return {
        "points": block.add(steps, "<u2"),
        "cells": block.add(cells, "<u4"),
        "low": low.tolist(),
        "size": size.tolist(),
        "flat": scene.flat,
    }


def _coloured(scene: Scene, block: _Block) -> dict[str, Any]:
    """Return the values of a scene, 0 to 255, and what explains them."""
    values = scene.values[np.unique(scene.cells)] if scene.on_nodes else scene.values
    result: dict[str, Any] = {
        "label": scene.label, "classes": scene.classes, "on_nodes": scene.on_nodes
    }  # fmt: skip
    if scene.classes:
        places = np.searchsorted(scene.names, np.where(np.isfinite(values), values, np.inf)) % 256
        ticks: list[tuple[float, str]] = list(enumerate(scene.class_labels))
        result["colours"] = CLASS_COLORS
        return result | {"values": block.add(places, "<u1"), "ticks": ticks}
    low, high = scene.limits
    if not high > low:
        high = low + max(abs(low), 1e-300)
    scaled = _scaled(np.where(np.isfinite(values), values, high), low, high, scene.is_logarithmic)
    at = _scaled(scene.ticks, low, high, scene.is_logarithmic)
    ticks = [(place, f"{tick:.4g}") for place, tick in zip(at.tolist(), scene.ticks, strict=True)]
    colours = colormaps[scene.colors or SIZES.name](np.linspace(0.0, 1.0, 12))
    return result | {
        "values": block.add(np.rint(255.0 * np.clip(scaled, 0.0, 1.0)), "<u1"),
        "ticks": ticks,
        "colours": [to_hex(colour) for colour in colours],
        "low": low,
        "high": high,
        "logarithmic": scene.is_logarithmic,
    }


def _scaled(values: FloatArray, low: float, high: float, logarithmic: bool) -> FloatArray:
    """Return the places of values in a range, 0 to 1."""
    if logarithmic:
        values, low, high = np.log(np.maximum(values, low)), np.log(low), np.log(high)
    return (values - low) / (high - low)
