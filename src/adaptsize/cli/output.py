"""Output of the commands: text and pictures."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid, Octree, SimplexMesh
    from adaptsize.domain_size.report import SizeReport


def draw(path: Path | None, *what: Any) -> None:
    """Draw the sizes."""
    from adaptsize.plot import plot_size

    _draw_with(plot_size, path, *what)


def draw_causes(path: Path | None, report: SizeReport) -> None:
    """Draw which cause controls which part."""
    from adaptsize.plot import plot_causes

    _draw_with(plot_causes, path, report)


def _draw_with(plot: Callable[..., Any], path: Path | None, *what: Any) -> None:
    """Draw to a file, if a path is given.  If drawing is impossible, only print a message."""
    if path is None:
        return
    from adaptsize.errors import PlotError

    try:
        plot(*what, path=path)
    except (PlotError, ImportError) as error:
        say(f"no picture: {error}")


def print_written(path: Path, background: SimplexMesh | CartesianGrid | Octree) -> None:
    """Print the number of points and cells in a written file.  An octree is written as a mesh."""
    from adaptsize.background import Octree

    written = background.mesh if isinstance(background, Octree) else background
    print(f"{path}: {written.n_points} points, {written.n_cells} cells")


def say(text: str) -> None:
    """Print a message to standard error."""
    print(f"adaptsize: {text}", file=sys.stderr)
