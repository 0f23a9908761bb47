"""The memory that a command is about to need."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.cli.console import Console

#: Bytes for the sizes of a surface, per triangle: 0.8 GB for 600 000 (benchmarks/large_inputs.py).
_PER_TRIANGLE = 1300.0
#: Bytes for a mesh by Mmg, per element made: 1 GB for 1 million, in both processes together.
_PER_ELEMENT = 1000.0
#: Less than this is not worth a line.
_LEAST = 1e9


def announce_memory_of_sizes(console: Console, mesh: SimplexMesh) -> None:
    """Print how much memory the sizes of a surface in space need, if it is much."""
    if mesh.cell_dim < mesh.dim == 3:
        _announce(console, _PER_TRIANGLE * mesh.n_cells, f"the sizes of {mesh.n_cells} triangles")


def announce_memory_of_mesh(
    console: Console, old: SimplexMesh, target: str, n_elements: float
) -> None:
    """Print how much memory a new mesh needs, if it is much and is not a surface in space."""
    if old.cell_dim == old.dim or target != "triangles":
        _announce(console, _PER_ELEMENT * n_elements, f"about {n_elements:.2g} elements")


def _announce(console: Console, needed: float, what: str) -> None:
    if needed < _LEAST:
        return
    text = f"{what} need about {needed / 1e9:.1f} GB of memory"
    installed = _installed_memory()
    if needed > installed:
        console.warn(f"{text}; this machine has {installed / 1e9:.1f} GB")
    else:
        console.say(text)


def _installed_memory() -> float:
    """Return the bytes of memory of this machine, inf if that is not known."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # AttributeError: on Windows
        return float("inf")
