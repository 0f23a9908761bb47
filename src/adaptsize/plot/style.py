"""One style for all pictures: dark is fine, light is coarse, and the background is transparent.

Text and frames are grey, which can be read on white pages and on dark ones.  Edges are fainter
where they are dense, so that the colours of fine regions remain visible.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps, rc_context, rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import (
    Colormap,
    LinearSegmentedColormap,
    ListedColormap,
    LogNorm,
    Normalize,
)
from matplotlib.figure import Figure

from adaptsize.plot.scene import Scene
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

#: Text, frames and ticks: a contrast of at least 4 on white and on dark pages.
INK = "#7b8087"
#: Edges of elements.
EDGE = (0.06, 0.09, 0.16)
#: What has no value.
NOTHING = "#b9bcc0"
#: Colours from fine to coarse.  The lightness rises evenly, from 24 to 95 of 100.
STOPS = (
    "#561868", "#4d2e82", "#4d4ba3", "#376ebb", "#3691c4", "#5fafca", "#90c9d2", "#c2dfde",
    "#eff2eb",
)  # fmt: skip
SIZES: Colormap = LinearSegmentedColormap.from_list("adaptsize", STOPS)
colormaps.register(SIZES, force=True)
#: Other quantities, whose large values matter; reversed where the small ones do.
FIELDS, QUALITY = "YlOrRd", "YlOrRd_r"
#: Colours of regions and curves, chosen for colour-blind readers (Okabe and Ito 2008).
CLASS_COLORS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#0072B2", "#D55E00")
CURVES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", INK)
#: Settings of matplotlib for this style.
SETTINGS: dict[RcKeyType, Any] = {
    **dict.fromkeys(
        (
            "text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color",
            "grid.color", "legend.labelcolor", "hatch.color",
        ),
        INK,
    ),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), "none"),
    "font.family": "DejaVu Sans",
    "image.cmap": "adaptsize",
    "legend.frameon": False,
    "axes.grid": False,
    "grid.alpha": 0.4,
    "axes.titlesize": "medium",
}  # fmt: skip

#: Pictures are shown about this wide on a page.  Lengths of edges are measured there, in pixels.
_PAGE = 800.0
#: Opacity of long edges, and the length in pixels from which on they have it.
_OPAQUE, _LONG = 0.75, 9.0


def edge_colors(lengths: FloatArray, width: float) -> FloatArray:
    """Return the colours of edges, float64[n, 4], fainter where edges are short.

    Lengths are in pixels of a picture this wide.
    """
    shown = lengths * (_PAGE / width)
    opacity = _OPAQUE * np.clip((shown - 0.8) / _LONG, 0.03, 1.0)
    return np.column_stack([np.tile(EDGE, (len(lengths), 1)), opacity])


def colors_of(scene: Scene) -> ScalarMappable:
    """Return the colours of values, or of positions in ``scene.names`` for classes."""
    low, high = scene.limits
    if scene.classes:
        n = len(scene.names)
        colors = [CLASS_COLORS[i % len(CLASS_COLORS)] for i in range(n)]
        return ScalarMappable(Normalize(-0.5, n - 0.5), ListedColormap(colors))
    if high <= low:
        low, high = low - 0.5 * abs(low), low + 0.5 * max(abs(low), 1e-300)
    return ScalarMappable(
        (LogNorm if scene.is_logarithmic else Normalize)(low, high), scene.colors or SIZES
    )


def text_size(width: float) -> float:
    """Return the height of letters in pixels, relatively larger in small pictures.

    Those stand side by side, scaled down to the width of a page.
    """
    return max(8.0, 0.052 * width if width < 400 else 18.5 + 0.0075 * width)


def with_bar(image: npt.NDArray[np.uint8], scene: Scene, width: int) -> npt.NDArray[np.uint8]:
    """Return a drawing of a scene with its colour bar to the right, ``width`` pixels wide."""
    height = image.shape[0]
    with rc_context(SETTINGS), rc_context({"font.size": 0.72 * text_size(width)}):
        figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0)
        canvas = FigureCanvasAgg(figure)
        figure.figimage(image)
        if np.isfinite(scene.values).any():
            _add_bar(figure, scene, image.shape[1] / width)
        canvas.draw()
        return np.array(canvas.buffer_rgba())


def _add_bar(figure: Figure, scene: Scene, left: float) -> None:
    """Add the colour bar, its title above it, to the right of this share of the figure."""
    width, height = figure.get_size_inches()
    # In points: a number at the top of the bar reaches half a letter above it.
    pad = 0.5 * rcParams["font.size"] + 6.0
    title = (pad + 14.0) / 72.0 / height
    high = min(0.7, 0.55 * width / height, max(0.4, 1.0 - 2.0 * title))
    place = (left + 0.01, 0.5 - 0.5 * high, 0.022, high)
    bar = figure.colorbar(colors_of(scene), cax=figure.add_axes(place))
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=2, which="major")
    bar.minorticks_off()
    if scene.classes and len(scene.names) <= 24:  # more would overlap
        bar.set_ticks(range(len(scene.names)), labels=scene.class_labels)
    elif scene.classes:
        bar.set_ticks([])
    else:
        bar.set_ticks(scene.ticks.tolist(), labels=[f"{tick:.4g}" for tick in scene.ticks])
    bar.ax.set_title(scene.label, loc="left", pad=pad)


def share_of_scene(scene: Scene, width: int) -> float:
    """Return the share of a picture's width that the colour bar and its texts leave."""
    if not np.isfinite(scene.values).any():
        return 1.0
    longest = max((len(name) for name in scene.class_labels), default=0) if scene.classes else 5
    letters = max(longest + 3.0, len(scene.label))
    # Letters are 0.6 times as wide as they are high, on average.
    return min(0.88, max(0.45, 0.965 - 0.6 * letters * text_size(width) / width))
