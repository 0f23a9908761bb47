"""Drawing by VTK, through pyvista, without a window."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._isolated import environment, isolated
from adaptsize.plot.scene import CLASS_COLORS, Scene

_WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
#: Place of a colour bar with names, which are left of it, over the picture's width.
_BAR_OF_NAMES = 0.89

_PROBE = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkWindowToImageFilter
window, renderer, grab = vtkRenderWindow(), vtkRenderer(), vtkWindowToImageFilter()
window.SetOffScreenRendering(1)
window.SetSize(16, 16)
renderer.SetBackground(1.0, 1.0, 1.0)
window.AddRenderer(renderer)
window.Render()
grab.SetInput(window)
grab.Update()
print("drawn" if grab.GetOutput().GetScalarRange() == (255.0, 255.0) else "blank")
"""


def is_possible() -> bool:
    """Whether VTK can draw here.  Tested once, in a child process, because VTK may crash."""
    return _render_window() is not None


@cache
def _render_window() -> str | None:
    """Return the name of the VTK window class that draws here, "" for VTK's own choice."""
    candidates = [""]
    if sys.platform == "linux" and _WINDOW_VARIABLE not in os.environ:
        without_display = ["vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"]
        # Without a display, VTK's default window prints errors on standard error.
        candidates = [*([""] if os.environ.get("DISPLAY") else []), *without_display]
    return next((name for name in candidates if _can_draw(name)), None)


def _can_draw(window: str) -> bool:
    chosen = {_WINDOW_VARIABLE: window} if window else {}
    try:
        with tempfile.TemporaryDirectory(prefix="adaptsize-") as folder:
            child = subprocess.run(
                isolated(_PROBE),
                cwd=folder,
                env={**environment(), **chosen},
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=60.0,
                check=False,
            )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return child.returncode == 0 and child.stdout.strip() == b"drawn"


@contextmanager
def _chosen_window() -> Iterator[None]:
    """Make VTK create the kind of window that was found to work."""
    before = os.environ.get(_WINDOW_VARIABLE)
    window = _render_window()
    if window:
        os.environ[_WINDOW_VARIABLE] = window
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_WINDOW_VARIABLE, None)
        else:
            os.environ[_WINDOW_VARIABLE] = before


def draw(scene: Scene, width: int, height: int) -> npt.NDArray[np.uint8]:
    """Return the picture as uint8[height, width, 3]."""
    import pyvista

    rows = np.insert(scene.cells, 0, scene.cells.shape[1], axis=1).ravel()
    lines = scene.cells.shape[1] == 2
    drawn = pyvista.PolyData(
        scene.points, faces=None if lines else rows, lines=rows if lines else None
    )
    values = np.where(np.isfinite(scene.values), scene.values, np.nan)
    if scene.classes:
        places = np.searchsorted(scene.names, values).astype(np.float64)
        values = np.where(np.isfinite(values), places, np.nan)
    with _chosen_window():
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=[width, height])
        try:
            plotter.set_background("white")
            plotter.add_mesh(drawn, scalars=values, **_appearance(scene, width))
            if not scene.classes:
                _write_ticks(plotter, scene)
            if not (scene.flat or scene.is_shaded or lines):
                # Without shading, edges of more than 30 degrees show the shape.
                edges = drawn.extract_feature_edges(30.0, clear_data=True)
                if edges.n_cells:
                    plotter.add_mesh(edges, color="#202020", line_width=width / 800, lighting=False)
            _place_camera(plotter.camera, scene, width / height, _mesh_share(scene, width))
            plotter.enable_anti_aliasing("ssaa")
            image = plotter.screenshot(return_img=True)
        finally:
            plotter.close()
    return np.ascontiguousarray(image[:, :, :3], dtype=np.uint8)


def _appearance(scene: Scene, width: int) -> dict[str, Any]:
    return {
        "preference": "point" if scene.on_nodes else "cell",
        "nan_color": "lightgrey",
        "show_edges": scene.shows_edges,
        "edge_color": "#202020",
        "line_width": max(0.5, width / 1600),
        "lighting": scene.is_shaded,
        "ambient": 0.25,
        "interpolate_before_map": True,
        **(_class_colors(scene) if scene.classes else _range_colors(scene)),
        "show_scalar_bar": bool(np.isfinite(scene.values).any()),
        "scalar_bar_args": _bar(scene, _text_size(width)),
    }


def _text_size(width: int) -> int:
    """Return the height of letters in pixels, relatively larger in small pictures.

    Those stand side by side, scaled down to the width of a page.
    """
    return max(8, round(0.036 * width if width < 560 else 17.4 + 0.005 * width))


def _range_colors(scene: Scene) -> dict[str, Any]:
    low, high = scene.limits
    if high <= low:  # VTK needs a nonempty range
        low, high = low - 0.5 * abs(low), low + 0.5 * max(abs(low), 1e-300)
    return {"cmap": "viridis", "clim": (low, high), "log_scale": scene.is_logarithmic}


def _class_colors(scene: Scene) -> dict[str, Any]:
    n = len(scene.names)
    named = {float(i): label for i, label in enumerate(scene.class_labels)}
    return {
        "cmap": [CLASS_COLORS[i % len(CLASS_COLORS)] for i in range(n)],
        "clim": (-0.5, n - 0.5),
        "annotations": named if n <= 24 else None,  # more would overlap
    }


def _bar(scene: Scene, text: int) -> dict[str, Any]:
    return {
        "title": scene.label + "\n",  # the empty line separates it from the first number
        "vertical": True,
        "fmt": " %.4g",
        "n_labels": 0 if scene.classes else 5,  # `_write_ticks` replaces them
        "position_x": _BAR_OF_NAMES if scene.class_names else 0.815,
        "position_y": 0.15,
        "width": 0.07,
        "height": 0.7,
        "title_font_size": text,
        "label_font_size": text,
        "color": "black",
        "unconstrained_font_size": True,
    }


def _write_ticks(plotter: Any, scene: Scene) -> None:
    """Write round numbers at the colour bar, where they belong."""
    from pyvista import convert_array

    for bar in plotter.scalar_bars.values():
        bar.SetCustomLabels(convert_array(scene.ticks))
        bar.UseCustomLabelsOn()


def _mesh_share(scene: Scene, width: int) -> float:
    """Return the share of the picture's width that the colour bar and its names leave."""
    if not scene.class_names:
        return 0.76
    longest = max((len(name) for name in scene.class_labels), default=0)
    # Letters are 0.6 times as wide as high, on average.
    return min(0.76, _BAR_OF_NAMES - 0.6 * longest * _text_size(width) / width)


def _place_camera(camera: Any, scene: Scene, aspect: float, share: float) -> None:
    """Set up a parallel projection along ``scene.axes``, the mesh in this share of the width."""
    axes = scene.axes
    low, high = scene.frame
    size = np.maximum(high - low, 1e-12 * max(float((high - low).max()), 1e-300))
    tall = 1.06 * max(size[1], size[0] / (share * aspect))
    focus = 0.5 * (low + high)
    focus[0] += 0.5 * (1.0 - share) * tall * aspect
    far = 2.0 * float(np.linalg.norm(size)) + tall
    camera.focal_point = focus @ axes
    camera.position = (focus + np.array([0.0, 0.0, far])) @ axes
    camera.up = axes[1]
    camera.parallel_projection = True
    camera.parallel_scale = 0.5 * tall
    camera.clipping_range = (0.1 * far, 2.0 * far)
