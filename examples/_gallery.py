"""What the examples share: where the files are, a plain mesh, and pictures side by side."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DATA = Path(__file__).parent.parent / "data"
OUTPUT = Path(__file__).parent / "output"

#: Colours of curves that differ for everyone (Okabe and Ito), without red beside green.
CURVES = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#444444"]

Image = npt.NDArray[np.uint8]


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
    path: Path, panels: Sequence[tuple[str, Image]], *, columns: int | None = None
) -> None:
    """Write pictures in rows of ``columns`` (all in one row if None), each under its title.

    Several panels get the letters (a), (b), ... in front of their titles.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    width = max(image.shape[1] for _, image in panels)
    size = max(12, width // 26)
    head = 3 * size  # two lines of title
    height = max(image.shape[0] for _, image in panels) + head
    sheet = Pillow.new("RGB", (columns * width, rows * height), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size)
    for number, (title, image) in enumerate(panels):
        row, column = divmod(number, columns)
        left, top = column * width, row * height
        sheet.paste(Pillow.fromarray(image), (left, top + head))
        text = _lettered(title, number, len(panels))
        pen.multiline_text((left + size, top + size // 4), text, fill="black", font=font)
    sheet.save(path)


def drawing(
    columns: int, rows: int, width: int, *, shape: float = 0.8
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its axes, row by row, each ``width`` pixels wide.

    ``shape`` is the height of a panel over its width.
    """
    from matplotlib.figure import Figure

    # Fonts are set in points.  The figure is at most 12 inches wide, so that 10 points are at least
    # 8 pixels on a page of 700.
    inches = min(4.8, 12.0 / columns)
    size = (inches * columns, inches * shape * rows)
    figure = Figure(size, dpi=width / inches, layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel in panels:
        panel.set_prop_cycle(color=CURVES)
    return figure, panels


def save_drawing(path: Path, figure: Figure) -> None:
    """Write a figure without the date, so that the same drawing is the same file.

    Several panels get the letters (a), (b), ... in front of their titles.
    """
    panels = [axes for axes in figure.axes if axes.get_title()]
    for number, axes in enumerate(panels):
        axes.title.set_text(_lettered(axes.get_title(), number, len(panels)))
    figure.savefig(path, metadata={"Software": None})


def _lettered(title: str, number: int, count: int) -> str:
    """Return the title of a panel with its letter, if there are several."""
    return f"({chr(ord('a') + number)}) {title}" if count > 1 and title else title
