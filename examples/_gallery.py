"""What the examples share: where the files are, a plain mesh, and pictures side by side."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_rgb
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh
from adaptsize.plot.style import CURVES, FIELDS, INK, QUALITY, SETTINGS, edge_colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from adaptsize.plot.scene import Scene

DATA = Path(__file__).parent.parent / "data"
OUTPUT = Path(__file__).parent / "output"

matplotlib.rcParams.update(SETTINGS)

Image = npt.NDArray[np.uint8]

__all__ = [
    "CURVES", "DATA", "FIELDS", "INK", "QUALITY", "draw_mesh", "drawing", "has_mmg",
    "jittered_rectangle", "node_at", "run", "save_drawing", "save_image_thumbnail", "save_panels",
    "save_scenes",
]  # fmt: skip


def run(main: Callable[[Path], dict[str, Any]]) -> None:
    """Call ``main`` with the directory named on the command line; print what it returns."""
    output = Path(sys.argv[1]) if len(sys.argv) > 1 else OUTPUT
    output.mkdir(parents=True, exist_ok=True)
    for name, value in main(output).items():
        print(f"{name}: {value:.4g}" if isinstance(value, float) else f"{name}: {value}")
    print(f"pictures in {output}")


def has_mmg() -> bool:
    """Whether Mmg is there, which plane meshes need to be remeshed."""
    from adaptsize.remeshing import available_backends

    return available_backends()["mmg"].installed


def jittered_rectangle(
    lower: Sequence[float], upper: Sequence[float], n_side: int, *, seed: int = 20050711
) -> SimplexMesh:
    """Return Delaunay triangles of a grid, its inner points moved by up to 0.3 spacings.

    ``n_side`` is the number of nodes along the longer side.
    """
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    spacing = float((high - low).max()) / (n_side - 1)
    counts = np.rint((high - low) / spacing).astype(int) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    inner = ((points > low + 0.5 * spacing) & (points < high - 0.5 * spacing)).all(axis=1)
    moves = np.random.default_rng(seed).uniform(-0.3, 0.3, (int(inner.sum()), 2))
    points[inner] += moves * spacing
    return SimplexMesh(points, Delaunay(points).simplices)


def node_at(mesh: SimplexMesh, place: Sequence[float]) -> int:
    """Return the node closest to a place."""
    return int(np.argmin(np.linalg.norm(mesh.points - place, axis=1)))


def save_panels(
    path: Path, panels: Sequence[tuple[str, Image]], *, columns: int | None = None, thumb: int = -1
) -> None:
    """Write pictures in rows of ``columns`` (all in one row if None), each under its title.

    Several panels get the letters (a), (b), ... in front of their titles.  Panel ``thumb``, without
    its colour bar, becomes the thumbnail.
    """
    columns = columns or len(panels)
    width = max(image.shape[1] for _, image in panels)
    shape = max(image.shape[0] for _, image in panels) / width
    figure, axes = drawing(columns, -(-len(panels) // columns), width, shape=shape + 0.11)
    for panel, (title, image) in zip(axes, panels, strict=False):
        panel.imshow(image, interpolation="antialiased")
        panel.set_title(title, loc="left")
    for panel in axes:
        panel.axis("off")
    save_drawing(path, figure)
    save_image_thumbnail(path, panels[thumb][1])


def save_image_thumbnail(path: Path, image: Image) -> None:
    """Write a picture without its colour bar as the thumbnail of ``path``."""
    width = image.shape[1]
    empty = image[:, :, 3].max(axis=0) == 0
    ends = np.flatnonzero(np.diff(np.concatenate([[0], empty, [0]]))).reshape(-1, 2)
    inner = ends[(ends[:, 0] > 0.35 * width) & (ends[:, 1] < image.shape[1])]
    right = inner[np.argmax(inner[:, 1] - inner[:, 0]), 0] if len(inner) else image.shape[1]
    figure, (panel,) = drawing(1, 1, width)
    panel.imshow(image[:, :right])
    save_thumbnail(path, figure, panel)


def save_scenes(
    path: Path,
    scenes: Mapping[str, Scene],
    seen_from: tuple[float, float, float] | None = None,
) -> None:
    """Write scenes that readers can turn on the page of an example, about 10 bytes per triangle.

    Those of `report` are ``scenes_of_mesh(mesh, size)``.  ``seen_from`` is the direction from
    which the first view looks at them.
    """
    from adaptsize.reporting.page.scenes import data_of

    view = {} if seen_from is None else {"seen_from": seen_from}
    path.write_text(json.dumps(data_of(scenes) | view), encoding="utf-8")


def drawing(
    columns: int, rows: int, width: int, *, shape: float = 0.8
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its axes, row by row, each ``width`` pixels wide.

    ``shape`` is the height of a panel over its width.
    """
    from matplotlib.figure import Figure

    # Fonts are set in points: in a figure of 9 inches, 10 points are 11 pixels on a page of 740.
    # A single panel has few texts, which are set smaller.
    inches = 4.8 if columns == rows == 1 else 9.0 / columns
    size = (inches * columns, inches * shape * rows)
    figure = Figure(size, dpi=width / inches, layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel in panels:
        panel.set_prop_cycle(color=CURVES)
    return figure, panels


def save_drawing(path: Path, figure: Figure, thumb: Axes | None = None) -> None:
    """Write a figure without the date, so that the same drawing is the same file.

    Several panels get the letters (a), (b), ... in front of their titles.  Panel ``thumb`` becomes
    the thumbnail.  A black line on the ground of a page is an error: on dark pages it is not seen.
    """
    for axes in figure.axes:
        if not (axes.images or axes.collections or axes.patches):
            refuse_black([*axes.lines])
    panels = [axes for axes in figure.axes if axes.get_title() or axes.get_title("left")]
    for number, axes in enumerate(panels):
        for title in (axes.title, axes._left_title):
            title.set_text(_lettered(title.get_text(), number, len(panels)))
    figure.savefig(path, metadata={"Software": None})
    if thumb is not None:
        save_thumbnail(path, figure, thumb)


def refuse_black(lines: Sequence[Line2D]) -> None:
    """Raise a ValueError if a line is black."""
    for line in lines:
        if to_rgb(line.get_color()) == (0.0, 0.0, 0.0):
            raise ValueError(f"{line.get_label()} is black, which dark pages hide; draw it in INK")


def save_thumbnail(path: Path, figure: Figure, panel: Axes) -> None:
    """Write one panel without texts as a square, ``NAME.thumb.png`` beside the picture."""
    for axes in figure.axes:
        axes.set_visible(axes is panel)
    for legend in figure.legends:
        legend.set_visible(False)
    figure.set_layout_engine("none")
    figure.set_size_inches(3.2, 3.2)
    plain = panel.get_aspect() == 1.0
    panel.set_position((0.02, 0.02, 0.96, 0.96))
    panel.set_title("")
    panel.set_title("", loc="left")
    panel.set(xlabel="", ylabel="", xticks=[], yticks=[])
    panel.minorticks_off()
    if legend := panel.get_legend():
        legend.remove()
    if plain:
        panel.axis("off")
    figure.savefig(path.with_suffix(".thumb.png"), dpi=100, metadata={"Software": None})


def _lettered(title: str, number: int, count: int) -> str:
    """Return the title of a panel with its letter, if there are several."""
    return f"({chr(ord('a') + number)}) {title}" if count > 1 and title else title


def draw_mesh(
    panel: Axes,
    mesh: SimplexMesh,
    values: npt.NDArray[Any] | None = None,
    *,
    width: float = 0.6,
    **look: Any,
) -> ScalarMappable:
    """Draw a plane mesh with its edges on axes of matplotlib, and return the colours.

    ``values`` of nodes or cells are by default the sizes of the triangles.  Edges get fainter where
    they are short in the limits of the axes; without limits, these are set to the mesh.  ``width``
    is that of long edges, in points; ``look`` goes to matplotlib's ``tripcolor``.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LogNorm

    if values is None:
        values = np.sqrt(4.0 / np.sqrt(3.0) * mesh.measures)
        low, high = np.quantile(values, (0.002, 0.998))
        look.setdefault("norm", LogNorm(low, max(high, 1.001 * low)))
    if len(values) == mesh.n_points:
        look.setdefault("shading", "gouraud")
    tripcolor: Any = panel.tripcolor  # whose overloads do not take unpacked arguments
    x, y = mesh.points.T
    drawn: ScalarMappable = tripcolor(x, y, mesh.cells, values, rasterized=True, **look)
    whole, (left, right) = panel.get_figure(root=True), panel.get_xlim()
    assert whole is not None
    lines = mesh.points[mesh.edges]
    pixels = mesh.edge_lengths * (100.0 * panel.get_position().width * whole.get_figwidth())
    pixels = pixels / abs(right - left)  # on the page
    colors = edge_colors(pixels, 800.0)
    outline = mesh.facet_cell_counts == 1
    ends = np.sort(mesh.facets[outline], axis=1) @ [mesh.n_points, 1]
    outer = np.isin(np.sort(mesh.edges, axis=1) @ [mesh.n_points, 1], ends)
    colors[outer] = (*to_rgb(INK), 1.0)
    widths = np.where(outer, 1.5 * width, width * np.clip(0.4 + pixels / 25.0, 0.4, 1.0))
    panel.add_collection(LineCollection(list(lines), colors=colors, linewidths=widths))
    return drawn
