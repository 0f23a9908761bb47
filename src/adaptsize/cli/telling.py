"""What commands print and draw in the end."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid, Octree, SimplexMesh


def draw(path: Path | None, *what: Any) -> None:
    """Draw the sizes; a machine that cannot draw is no reason to fail."""
    if path is None:
        return
    from adaptsize.errors import PlotError
    from adaptsize.plot import plot_size

    try:
        plot_size(*what, path=path)
    except (PlotError, ImportError) as error:
        say(f"no picture: {error}")


def print_written(path: Path, background: SimplexMesh | CartesianGrid | Octree) -> None:
    """Say what is in a file that was written; an octree is written as its mesh."""
    from adaptsize.background import Octree

    written = background.mesh if isinstance(background, Octree) else background
    print(f"{path}: {written.n_points} points, {written.n_cells} cells")


def say(text: str) -> None:
    """Print a message that is no result."""
    print(f"adaptsize: {text}", file=sys.stderr)
