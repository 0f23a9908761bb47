"""Surfaces that mesh generators dislike, each fixed by a seed and a number.

A surface is a shape with one kind of defect, in random units, perhaps far from the origin, and
stored as OFF (numbers as they are) or STL (single precision, every triangle on its own).
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from _shapes import (
    Surface,
    ball,
    box,
    moved,
    off,
    ring,
    stl,
    together,
    turned,
    with_doubled,
    with_flipped,
    with_slivers,
)
from scipy.spatial import Delaunay


def write_surfaces(folder: Path, count: int, seed: int) -> None:
    """Write the surfaces of a seed, ``NNN-defect.off`` or ``.stl``; those there are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    present = {path.stem for path in folder.iterdir()}
    for number in range(count):
        name = f"{number:03d}-{defect_of(number)}"
        if name in present:
            continue
        rng = np.random.default_rng([20261122, seed, number])
        surface = _placed(_DEFECTS[defect_of(number)](rng), rng)
        if rng.random() < 0.3:
            (folder / f"{name}.stl").write_bytes(stl(surface))
        else:
            (folder / f"{name}.off").write_text(off(surface), encoding="utf-8")


def defect_of(number: int) -> str:
    """Return the defect of a surface, in turn."""
    return list(_DEFECTS)[number % len(_DEFECTS)]


def _placed(surface: Surface, rng: np.random.Generator) -> Surface:
    """Return the surface turned, in other units, and sometimes far from the origin."""
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    unit = 10.0 ** rng.choice([-6.0, -3.0, 0.0, 0.0, 3.0, 6.0])
    offset = rng.choice([0.0, 0.0, 1e2, 1e4]) * rng.normal(size=3)
    points = surface.points @ rotation if rng.random() < 0.5 else surface.points
    return Surface(unit * (points + offset), surface.cells)


def _shape(rng: np.random.Generator) -> Surface:
    return (box, ball, ring)[int(rng.integers(0, 3))]()


# --- defects --------------------------------------------------------------------------------------


def _crossing(rng: np.random.Generator) -> Surface:
    """Two bodies through each other."""
    return together(_shape(rng), moved(_shape(rng), rng.uniform(-0.5, 0.5, 3)))


def _folded(rng: np.random.Generator) -> Surface:
    """Nodes moved so far that the surface crosses itself."""
    surface = _shape(rng)
    moved = rng.normal(size=surface.points.shape) * rng.choice([0.02, 0.1, 0.3])
    return Surface(surface.points + moved * (rng.random((len(moved), 1)) < 0.3), surface.cells)


def _open_shell(rng: np.random.Generator) -> Surface:
    """Leave out a cap."""
    surface = _shape(rng)
    middle = surface.points[surface.cells].mean(axis=1) @ rng.normal(size=3)
    cut = np.quantile(middle, rng.choice([0.05, 0.2, 0.6]))
    return Surface(surface.points, surface.cells[middle >= cut])


def _moth_eaten(rng: np.random.Generator) -> Surface:
    """Triangles are missing here and there."""
    surface = _shape(rng)
    kept = rng.random(len(surface.cells)) >= rng.choice([0.01, 0.1, 0.5])
    kept[0] = True
    return Surface(surface.points, surface.cells[kept])


def _sheet(rng: np.random.Generator) -> Surface:
    """No volume at all: a single sheet, flat or not, or a box without thickness."""
    points = rng.random((40, 2))
    cells = Delaunay(points).simplices
    lifted = np.column_stack([points, rng.choice([0.0, 1e-9, 0.2]) * rng.random(40)])
    if rng.random() < 0.3:
        return together(Surface(lifted, cells), Surface(lifted, cells[:, ::-1]))
    return Surface(lifted, cells)


def _slivers(rng: np.random.Generator) -> Surface:
    """Edges are divided very close to an end."""
    return with_slivers(_shape(rng), 30, rng)


def _doubled(rng: np.random.Generator) -> Surface:
    """Faces are there twice, some of them the other way round."""
    surface = _shape(rng)
    return with_doubled(surface, rng.random(len(surface.cells)) < rng.choice([0.05, 0.5, 1.0]), rng)


def _flipped(rng: np.random.Generator) -> Surface:
    """Turn normals either way."""
    surface = _shape(rng)
    return with_flipped(surface, rng.random(len(surface.cells)) < rng.choice([0.01, 0.5, 1.0]))


def _nested(rng: np.random.Generator) -> Surface:
    """Put a cavity or a body inside a body; the gap may be narrow."""
    surface = _shape(rng)
    inner = moved(surface, 0.0, float(rng.choice([0.3, 0.9, 0.999])))
    inner = turned(inner) if rng.random() < 0.5 else inner
    return together(surface, inner)


def _touching(rng: np.random.Generator) -> Surface:
    """Two boxes that share a face, part of one, an edge or a node."""
    shift = [(1.0, 0.0, 0.0), (1.0, 0.4, 0.3), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0)]
    boxes = box(), moved(box(n=int(rng.choice([3, 4]))), shift[int(rng.integers(0, 4))])
    return together(*boxes)


def _narrow_gap(rng: np.random.Generator) -> Surface:
    """Two boxes, or a ball above a box, with a gap that no tolerance resolves."""
    gap = float(rng.choice([1e-3, 1e-6, 1e-9]))
    other = box(n=4) if rng.random() < 0.5 else ball()
    top = 0.5 + gap - other.points[:, 2].min()
    return together(box(), moved(other, (0.0, 0.0, top)))


def _thin(rng: np.random.Generator) -> Surface:
    """Return a plate, a needle, or a shell."""
    thickness = float(rng.choice([1e-2, 1e-4, 1e-6]))
    kind = int(rng.integers(0, 3))
    if kind == 0:
        return box(1.0, 0.7, thickness)
    if kind == 1:
        return box(1.0, thickness, thickness)
    return together(ball(), turned(ball(radius=0.5 - thickness)))


def _fins(rng: np.random.Generator) -> Surface:
    """Sheets that stick out of a body, and triangles that stand alone."""
    surface = _shape(rng)
    n = len(surface.points)
    count = int(rng.integers(1, 8))
    edges = surface.cells[rng.integers(0, len(surface.cells), count), :2]
    points = np.concatenate([surface.points, rng.uniform(-1.0, 1.0, (count, 3))])
    fins = np.column_stack([edges, n + np.arange(count)])
    alone = Surface(rng.uniform(-1.0, 1.0, (3, 3)), np.array([[0, 1, 2]]))
    return together(Surface(points, np.concatenate([surface.cells, fins])), alone)


def _torn(rng: np.random.Generator) -> Surface:
    """Triangles on their own, whose corners differ a little."""
    surface = _shape(rng)
    corners = surface.points[surface.cells].reshape(-1, 3)
    corners = corners + rng.normal(size=corners.shape) * rng.choice([1e-12, 1e-7, 1e-4, 1e-2])
    return Surface(corners, np.arange(len(corners)).reshape(-1, 3))


def _hanging_nodes(rng: np.random.Generator) -> Surface:
    """Two halves of a box whose nodes do not meet."""
    left, right = box(n=3), moved(box(n=5), (1.0, 0.0, 0.0))
    inner = [~(np.abs(s.points[s.cells][:, :, 0] - 0.5) < 1e-9).all(axis=1) for s in (left, right)]
    return together(
        Surface(left.points, left.cells[inner[0]]), Surface(right.points, right.cells[inner[1]])
    )


def _degenerate(rng: np.random.Generator) -> Surface:
    """Triangles without area, nodes given twice, nodes of no triangle."""
    surface = _shape(rng)
    n = len(surface.points)
    a, b = rng.integers(0, n, (2, 12))
    flat = np.column_stack([a, b, rng.choice([a, b])])
    line = np.vstack([surface.points[:1], surface.points[:1] + 0.1, surface.points[:1] + 0.2])
    alone = Surface(line, np.array([[0, 1, 2]]))
    whole = Surface(surface.points, np.concatenate([surface.cells, flat]))
    return together(whole, alone, Surface(rng.random((5, 3)), np.empty((0, 3), int)))


def _far_node(rng: np.random.Generator) -> Surface:
    """One node far away from all others: a spike, or a body without a size."""
    surface = _shape(rng)
    points = surface.points.copy()
    points[int(rng.integers(0, len(points)))] *= rng.choice([10.0, 1e3, 1e6])
    return Surface(points, surface.cells)


def _few(rng: np.random.Generator) -> Surface:
    """One to four random triangles."""
    n = int(rng.integers(1, 5))
    return Surface(rng.random((3 * n, 3)), np.arange(3 * n).reshape(-1, 3))


def _many_bodies(rng: np.random.Generator) -> Surface:
    """Return a heap of small boxes, some of them in others."""
    boxes = [
        moved(box(n=1), rng.uniform(-1.0, 1.0, 3), float(rng.choice([0.05, 0.2, 0.6])))
        for _ in range(int(rng.integers(5, 40)))
    ]
    return together(*boxes)


_DEFECTS: dict[str, Callable[[np.random.Generator], Surface]] = {
    "crossing-bodies": _crossing,
    "self-intersecting": _folded,
    "open-shell": _open_shell,
    "missing-triangles": _moth_eaten,
    "sheet": _sheet,
    "slivers": _slivers,
    "doubled-faces": _doubled,
    "flipped-normals": _flipped,
    "nested-bodies": _nested,
    "touching-bodies": _touching,
    "narrow-gap": _narrow_gap,
    "thin": _thin,
    "fins": _fins,
    "torn": _torn,
    "hanging-nodes": _hanging_nodes,
    "degenerate": _degenerate,
    "far-node": _far_node,
    "few-triangles": _few,
    "many-bodies": _many_bodies,
    "none": _shape,
}
