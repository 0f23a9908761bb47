"""Drawing by matplotlib, for machines on which VTK finds no OpenGL.

Cells are drawn from back to front, with one colour each.  This hides cells behind
others correctly if the cells are of moderate size, which is sufficient for meshes.
"""

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from adaptsize.plot.scene import Scene
from adaptsize.plot.style import NOTHING, colors_of, edge_colors
from adaptsize.typing import FloatArray


def draw(scene: Scene, width: int, height: int) -> npt.NDArray[np.uint8]:
    """Return the scene alone as uint8[height, width, 4], red, green, blue and opacity."""
    seen = scene.points @ scene.axes.T
    corners = seen[scene.cells]
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    values = scene.values[scene.cells].mean(axis=1) if scene.on_nodes else scene.values
    shown = np.searchsorted(scene.names, values) if scene.classes else values
    faces = colors_of(scene).to_rgba(np.where(np.isfinite(values), shown, scene.limits[0]))
    faces[~np.isfinite(values)] = to_rgba(NOTHING)
    faces[:, :3] *= _brightness(scene, corners)[:, None]

    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0, facecolor="none")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_aspect("equal")
    axes.axis("off")
    edges = faces
    if scene.shows_edges:
        low, high = scene.frame
        pixels = 0.96 * min(width / max(high[0] - low[0], 1e-300), height / (high[1] - low[1]))
        lengths = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1) * pixels
        lines = edge_colors(lengths, width)
        edges = faces.copy()
        edges[:, :3] += lines[:, 3:] * (lines[:, :3] - edges[:, :3])
    axes.add_collection(
        PolyCollection(
            list(corners[order][:, :, :2]),
            facecolors=faces[order],
            edgecolors=edges[order],
            linewidths=0.4 * width / 1600,
        )
    )
    axes.autoscale_view()
    canvas.draw()
    return np.array(canvas.buffer_rgba())


def _brightness(scene: Scene, corners: FloatArray) -> FloatArray:
    """Return the brightness of each cell, from its angle to the viewer: see `Scene.light`."""
    if scene.flat or corners.shape[1] < 3:
        return np.ones(len(corners))
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    brightness: FloatArray = 1.0 - scene.light * (1.0 - np.abs(normal[:, 2]) / length)
    return brightness
