"""Drawing by matplotlib, for machines on which VTK finds no OpenGL.

Cells are drawn from back to front, with one colour each.  This hides cells behind
others correctly if the cells are of moderate size, which is sufficient for meshes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize.plot.scene import CLASS_COLORS, Scene
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable


def draw(scene: Scene, width: int, height: int) -> npt.NDArray[np.uint8]:
    """Return the picture as uint8[height, width, 3]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    colors = _color_map(scene)
    seen = scene.points @ scene.axes.T
    corners = seen[scene.cells]
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    values = scene.values_of_cells
    shown = np.searchsorted(scene.names, values) if scene.classes else values
    faces = colors.to_rgba(np.where(np.isfinite(values), shown, scene.limits[0]))
    faces[~np.isfinite(values)] = (0.83, 0.83, 0.83, 1.0)
    faces[:, :3] *= _brightness(scene, corners)[:, None]

    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.03, 0.80, 0.94))
    axes.set_aspect("equal")
    axes.axis("off")
    edges = (0.13, 0.13, 0.13, 1.0) if scene.shows_edges else "face"
    axes.add_collection(
        PolyCollection(
            list(corners[order][:, :, :2]),
            facecolors=faces[order],
            edgecolors=edges,
            linewidths=0.4 * width / 1600,
        )
    )
    axes.autoscale_view()
    if np.isfinite(scene.values).any():
        bar = figure.colorbar(colors, cax=figure.add_axes((0.86, 0.15, 0.025, 0.7)))
        bar.set_label(scene.label, size=max(6.0, 0.012 * width))
        bar.ax.tick_params(labelsize=max(6.0, 0.010 * width), which="both")
        bar.minorticks_off()
        if scene.classes:
            bar.set_ticks(range(len(scene.names)), labels=scene.class_labels)
        else:
            bar.set_ticks(scene.ticks.tolist(), labels=[f"{tick:.4g}" for tick in scene.ticks])
    canvas.draw()
    return np.array(canvas.buffer_rgba())[:, :, :3]


def _color_map(scene: Scene) -> ScalarMappable:
    """Return the colours of values, or of positions in ``scene.names`` for classes."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    low, high = scene.limits
    if scene.classes:
        n = len(scene.names)
        colors = [CLASS_COLORS[i % len(CLASS_COLORS)] for i in range(n)]
        return ScalarMappable(Normalize(-0.5, n - 0.5), ListedColormap(colors))
    return ScalarMappable((LogNorm if scene.is_logarithmic else Normalize)(low, high), "viridis")


def _brightness(scene: Scene, corners: FloatArray) -> FloatArray:
    """Return the brightness of each cell: if shaded, from its angle to the viewer."""
    if not scene.is_shaded or corners.shape[1] < 3:
        return np.ones(len(corners))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    brightness: FloatArray = 0.55 + 0.45 * np.abs(normal[:, 2]) / length
    return brightness
