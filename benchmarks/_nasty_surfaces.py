"""Surfaces that mesh generators dislike, each fixed by a seed and a number.

A surface is a shape with one kind of defect, in random units, perhaps far from the origin, and
stored as OFF (numbers as they are) or STL (single precision, every triangle on its own).
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, Delaunay


class Surface(NamedTuple):
    points: np.ndarray
    cells: np.ndarray


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
            (folder / f"{name}.stl").write_bytes(_stl(surface))
        else:
            (folder / f"{name}.off").write_text(_off(surface), encoding="utf-8")


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


def _off(surface: Surface) -> str:
    points = [" ".join(map(repr, row)) for row in surface.points.tolist()]
    cells = [f"3 {a} {b} {c}" for a, b, c in surface.cells.tolist()]
    return "\n".join(["OFF", f"{len(points)} {len(cells)} 0", *points, *cells, ""])


def _stl(surface: Surface) -> bytes:
    kinds = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    facets = np.zeros(len(surface.cells), kinds)
    facets["corners"] = surface.points[surface.cells]
    return bytes(80) + np.array(len(facets), "<u4").tobytes() + facets.tobytes()


# --- shapes ---------------------------------------------------------------------------------------


def _box(*edges: float, n: int = 3) -> Surface:
    """Return the surface of a box around the origin, n squares along each edge."""
    lattice = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(lattice)).reshape((n + 1,) * 3)
    triangles = []
    for axis in range(3):
        for end, turned in ((0, axis != 1), (n, axis == 1)):
            side = np.take(number, end, axis=axis)
            a, b, c, d = side[:-1, :-1], side[1:, :-1], side[1:, 1:], side[:-1, 1:]
            both = [np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]
            faces = np.concatenate([half.reshape(-1, 3) for half in both])
            triangles.append(faces[:, ::-1] if turned else faces)
    return _used(Surface((lattice / n - 0.5) * (edges or 1.0), np.concatenate(triangles)))


def _ball(n: int = 120, radius: float = 0.5) -> Surface:
    """Return a sphere of n nodes, on a spiral."""
    height = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    across = np.sqrt(1.0 - height**2)
    points = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    cells = ConvexHull(points).simplices
    a, b, c = points[cells].transpose(1, 0, 2)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    return Surface(radius * points, np.where(inwards[:, None], cells[:, ::-1], cells))


def _ring(n: int = 20, m: int = 8, radius: float = 0.15) -> Surface:
    """Return a torus."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    far = 0.4 + radius * np.cos(v)
    points = np.stack([far * np.cos(u), far * np.sin(u), radius * np.sin(v)], axis=-1)
    number = np.arange(n * m).reshape(n, m)
    right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    corner = np.roll(right, -1, axis=1)
    both = [np.stack([number, right, corner], -1), np.stack([number, corner, up], -1)]
    return Surface(points.reshape(-1, 3), np.concatenate([half.reshape(-1, 3) for half in both]))


def _shape(rng: np.random.Generator) -> Surface:
    return (_box, _ball, _ring)[int(rng.integers(0, 3))]()


def _moved(surface: Surface, shift: object, factor: float = 1.0) -> Surface:
    return Surface(factor * surface.points + np.asarray(shift, float), surface.cells)


def _turned(surface: Surface) -> Surface:
    return Surface(surface.points, surface.cells[:, ::-1])


def _together(*surfaces: Surface) -> Surface:
    first = np.cumsum([0, *[len(s.points) for s in surfaces]])
    cells = [s.cells + start for s, start in zip(surfaces, first[:-1], strict=True)]
    return Surface(np.concatenate([s.points for s in surfaces]), np.concatenate(cells))


def _used(surface: Surface) -> Surface:
    used, cells = np.unique(surface.cells, return_inverse=True)
    return Surface(surface.points[used], cells.reshape(-1, 3))


# --- defects --------------------------------------------------------------------------------------


def _crossing(rng: np.random.Generator) -> Surface:
    """Two bodies through each other."""
    return _together(_shape(rng), _moved(_shape(rng), rng.uniform(-0.5, 0.5, 3)))


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
        return _together(Surface(lifted, cells), Surface(lifted, cells[:, ::-1]))
    return Surface(lifted, cells)


def _slivers(rng: np.random.Generator) -> Surface:
    """Edges are divided very close to an end."""
    surface = _shape(rng)
    points, cells = list(surface.points), [tuple(c) for c in surface.cells.tolist()]
    for _ in range(30):
        a, b, _ = cells[int(rng.integers(0, len(cells)))]
        place = 10.0 ** rng.uniform(-12, -2)
        points.append((1.0 - place) * points[a] + place * points[b])
        new, beside = len(points) - 1, [c for c in cells if a in c and b in c]
        for cell in beside:
            cells.remove(cell)
            cells += [tuple(new if v == old else v for v in cell) for old in (a, b)]
    return Surface(np.array(points), np.array(cells))


def _doubled(rng: np.random.Generator) -> Surface:
    """Faces are there twice, some of them the other way round."""
    surface = _shape(rng)
    again = surface.cells[rng.random(len(surface.cells)) < rng.choice([0.05, 0.5, 1.0])]
    over = rng.random(len(again)) < 0.5
    again = np.where(over[:, None], again[:, ::-1], again)
    return Surface(surface.points, np.concatenate([surface.cells, again]))


def _flipped(rng: np.random.Generator) -> Surface:
    """Turn normals either way."""
    surface = _shape(rng)
    over = rng.random(len(surface.cells)) < rng.choice([0.01, 0.5, 1.0])
    return Surface(surface.points, np.where(over[:, None], surface.cells[:, ::-1], surface.cells))


def _nested(rng: np.random.Generator) -> Surface:
    """Put a cavity or a body inside a body; the gap may be narrow."""
    surface = _shape(rng)
    inner = _moved(surface, 0.0, float(rng.choice([0.3, 0.9, 0.999])))
    inner = _turned(inner) if rng.random() < 0.5 else inner
    return _together(surface, inner)


def _touching(rng: np.random.Generator) -> Surface:
    """Two boxes that share a face, part of one, an edge or a node."""
    shift = [(1.0, 0.0, 0.0), (1.0, 0.4, 0.3), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0)]
    boxes = _box(), _moved(_box(n=int(rng.choice([3, 4]))), shift[int(rng.integers(0, 4))])
    return _together(*boxes)


def _narrow_gap(rng: np.random.Generator) -> Surface:
    """Two boxes, or a ball above a box, with a gap that no tolerance resolves."""
    gap = float(rng.choice([1e-3, 1e-6, 1e-9]))
    other = _box(n=4) if rng.random() < 0.5 else _ball()
    top = 0.5 + gap - other.points[:, 2].min()
    return _together(_box(), _moved(other, (0.0, 0.0, top)))


def _thin(rng: np.random.Generator) -> Surface:
    """Return a plate, a needle, or a shell."""
    thickness = float(rng.choice([1e-2, 1e-4, 1e-6]))
    kind = int(rng.integers(0, 3))
    if kind == 0:
        return _box(1.0, 0.7, thickness)
    if kind == 1:
        return _box(1.0, thickness, thickness)
    return _together(_ball(), _turned(_ball(radius=0.5 - thickness)))


def _fins(rng: np.random.Generator) -> Surface:
    """Sheets that stick out of a body, and triangles that stand alone."""
    surface = _shape(rng)
    n = len(surface.points)
    count = int(rng.integers(1, 8))
    edges = surface.cells[rng.integers(0, len(surface.cells), count), :2]
    points = np.concatenate([surface.points, rng.uniform(-1.0, 1.0, (count, 3))])
    fins = np.column_stack([edges, n + np.arange(count)])
    alone = Surface(rng.uniform(-1.0, 1.0, (3, 3)), np.array([[0, 1, 2]]))
    return _together(Surface(points, np.concatenate([surface.cells, fins])), alone)


def _torn(rng: np.random.Generator) -> Surface:
    """Triangles on their own, whose corners differ a little."""
    surface = _shape(rng)
    corners = surface.points[surface.cells].reshape(-1, 3)
    corners = corners + rng.normal(size=corners.shape) * rng.choice([1e-12, 1e-7, 1e-4, 1e-2])
    return Surface(corners, np.arange(len(corners)).reshape(-1, 3))


def _hanging_nodes(rng: np.random.Generator) -> Surface:
    """Two halves of a box whose nodes do not meet."""
    left, right = _box(n=3), _moved(_box(n=5), (1.0, 0.0, 0.0))
    inner = [~(np.abs(s.points[s.cells][:, :, 0] - 0.5) < 1e-9).all(axis=1) for s in (left, right)]
    return _together(
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
    return _together(whole, alone, Surface(rng.random((5, 3)), np.empty((0, 3), int)))


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
        _moved(_box(n=1), rng.uniform(-1.0, 1.0, 3), float(rng.choice([0.05, 0.2, 0.6])))
        for _ in range(int(rng.integers(5, 40)))
    ]
    return _together(*boxes)


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
