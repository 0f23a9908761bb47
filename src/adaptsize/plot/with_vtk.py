"""Drawing by VTK, through pyvista, without a window or in one."""

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

from adaptsize._children import environment, isolated
from adaptsize.plot.scene import Scene
from adaptsize.plot.style import EDGE, INK, NOTHING, colors_of, edge_colors

_WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
_WITHOUT_DISPLAY = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
#: Pixels that are drawn for one of the picture, in each direction.
_FINER = 2
#: Share of the width of a window that the colour bar leaves.
_SHARE = 0.82

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


def opens_windows() -> bool:
    """Whether a window can open: on a display.  Not from notebooks, which show pictures."""
    import pyvista
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    if pyvista.OFF_SCREEN or "ipykernel" in sys.modules or _render_window() != "":
        return False
    # VTK's own choice needs no display if DISPLAY names none that exists.
    return vtkRenderWindow().GetClassName() not in _WITHOUT_DISPLAY


@cache
def _render_window() -> str | None:
    """Return the name of the VTK window class that draws here, "" for VTK's own choice."""
    candidates = [""]
    if sys.platform == "linux" and _WINDOW_VARIABLE not in os.environ:
        # Without a display, VTK's default window prints errors on standard error.
        candidates = [*([""] if os.environ.get("DISPLAY") else []), *_WITHOUT_DISPLAY]
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
    """Return the scene alone as uint8[height, width, 4], red, green, blue and opacity."""
    import pyvista
    from PIL import Image

    size = [_FINER * width, _FINER * height]
    with _chosen_window():
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=size, lighting="none")
        # Averaging smooths edges enough; this halves the time of software that renders.
        plotter.render_window.SetMultiSamples(0)
        try:
            drawn = _add(plotter, scene, width)
            _place_camera(plotter.camera, scene, width / height)
            pixels = 0.5 * height / plotter.camera.parallel_scale
            nearer = 2.0 / pixels * scene.axes[2]  # faces would hide half of their edges
            if not scene.flat:
                # Edges of more than 30 degrees show the shape.
                edges = drawn.extract_feature_edges(30.0, clear_data=True).translate(1.5 * nearer)
                if edges.n_cells:
                    plotter.add_mesh(edges, **_lines(1.4 * width), color=EDGE, opacity=0.8)
            if scene.shows_edges and scene.cells.shape[1] > 2:
                edges, colors = _element_edges(scene, width, pixels)
                edges.translate(nearer, inplace=True)
                plotter.add_mesh(edges, scalars=colors, rgba=True, **_lines(width))
            large = plotter.screenshot(transparent_background=True, return_img=True)
        finally:
            plotter.close()
    # Averaging pixels smooths edges also against the transparent background.
    image = Image.fromarray(np.asarray(large, np.uint8)).convert("RGBa")
    return np.array(image.resize((width, height), Image.Resampling.BOX).convert("RGBA"))


def show(scene: Scene) -> npt.NDArray[np.uint8]:
    """Show the scene in a window until it is closed, and return the last view as `draw` does."""
    import pyvista
    from PIL import Image

    width, height = pyvista.global_theme.window_size
    bar = {
        "title": f"{scene.label}\n",
        "n_labels": 0 if scene.classes else 5,
        "fmt": "%.3g",
        "color": INK,
        "vertical": True,
        "position_x": _SHARE + (0.08 if scene.classes else 0.04),  # names are at the left
        "position_y": 0.25,
        "height": 0.5,
    }
    with _chosen_window():
        plotter: Any = pyvista.Plotter(notebook=False, lighting="none")
        plotter.background_color = "white"
        _add(
            plotter,
            scene,
            width // _FINER,
            show_edges=scene.shows_edges,
            edge_color=EDGE,
            edge_opacity=0.5,
            show_scalar_bar=bool(np.isfinite(scene.values).any()),
            scalar_bar_args=bar,
            annotations=dict(enumerate(scene.class_labels)) if scene.classes else None,
        )
        _place_camera(plotter.camera, scene, _SHARE * width / height)
        plotter.camera.SetWindowCenter(1.0 - _SHARE, 0.0)
        plotter.show(title="adaptsize", screenshot=True)
    return np.array(Image.fromarray(plotter.image).convert("RGBA"))


def _add(plotter: Any, scene: Scene, width: int, **look: Any) -> Any:
    """Add the cells in their colours, and a light; return them."""
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
    colors = colors_of(scene)
    usual = {
        "preference": "point" if scene.on_nodes else "cell",
        "nan_color": NOTHING,
        "line_width": _FINER * max(0.8, width / 800),
        "lighting": not scene.flat,
        "ambient": 1.0 - scene.light,
        "diffuse": scene.light,
        "specular": 0.0,
        "interpolate_before_map": True,
        "cmap": colors.cmap,
        "clim": (colors.norm.vmin, colors.norm.vmax),
        "log_scale": scene.is_logarithmic,
        "show_scalar_bar": False,
    }
    plotter.add_mesh(drawn, scalars=values, **usual | look)
    if not scene.flat:
        plotter.add_light(pyvista.Light(light_type="headlight"))
    return drawn


def _lines(width: float) -> dict[str, Any]:
    return {"line_width": _FINER * max(0.5, width / 1600), "lighting": False}


def _element_edges(scene: Scene, width: int, pixels: float) -> tuple[Any, npt.NDArray[np.uint8]]:
    """Return the edges of the cells and their colours; a unit of length has so many pixels."""
    import pyvista

    around = [scene.cells, np.roll(scene.cells, -1, axis=1)]
    pairs = np.unique(np.sort(np.stack(around, axis=-1).reshape(-1, 2), axis=1), axis=0)
    seen = scene.points @ scene.axes[:2].T
    lengths = np.linalg.norm(seen[pairs[:, 1]] - seen[pairs[:, 0]], axis=1) * pixels
    lines = pyvista.PolyData(scene.points, lines=np.insert(pairs, 0, 2, axis=1).ravel())
    return lines, np.asarray(np.rint(255.0 * edge_colors(lengths, width)), np.uint8)


def _place_camera(camera: Any, scene: Scene, aspect: float) -> None:
    """Set up a parallel projection along ``scene.axes`` that shows the whole scene."""
    axes = scene.axes
    low, high = scene.frame
    size = np.maximum(high - low, 1e-12 * max(float((high - low).max()), 1e-300))
    tall = 1.04 * max(size[1], size[0] / aspect)
    focus = 0.5 * (low + high)
    far = 2.0 * float(np.linalg.norm(size)) + tall
    camera.focal_point = focus @ axes
    camera.position = (focus + np.array([0.0, 0.0, far])) @ axes
    camera.up = axes[1]
    camera.parallel_projection = True
    camera.parallel_scale = 0.5 * tall
    camera.clipping_range = (0.1 * far, 2.0 * far)
