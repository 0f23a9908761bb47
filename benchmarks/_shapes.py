"""Surfaces for benchmarks: simple shapes, their files, and steps that several generators need."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull


class Surface(NamedTuple):
    """Triangles, by the numbers of their corners."""

    points: np.ndarray
    cells: np.ndarray


# --- files ----------------------------------------------------------------------------------------


def off(surface: Surface) -> str:
    """Return the text of a file of OFF, with the numbers as they are."""
    points = [" ".join(map(repr, row)) for row in surface.points.tolist()]
    cells = [f"3 {a} {b} {c}" for a, b, c in surface.cells.tolist()]
    return "\n".join(["OFF", f"{len(points)} {len(cells)} 0", *points, *cells, ""])


def stl(surface: Surface) -> bytes:
    """Return a binary file of STL: single precision, every triangle on its own."""
    kinds = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    facets = np.zeros(len(surface.cells), kinds)
    facets["corners"] = surface.points[surface.cells]
    return bytes(80) + np.array(len(facets), "<u4").tobytes() + facets.tobytes()


# --- shapes ---------------------------------------------------------------------------------------


def box(*edges: float, n: int = 3) -> Surface:
    """Return the surface of a box around the origin, n squares along each edge."""
    lattice = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(lattice)).reshape((n + 1,) * 3)
    triangles = []
    for axis in range(3):
        for end, is_turned in ((0, axis != 1), (n, axis == 1)):
            side = np.take(number, end, axis=axis)
            a, b, c, d = side[:-1, :-1], side[1:, :-1], side[1:, 1:], side[:-1, 1:]
            both = [np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]
            faces = np.concatenate([half.reshape(-1, 3) for half in both])
            triangles.append(faces[:, ::-1] if is_turned else faces)
    return used(Surface((lattice / n - 0.5) * (edges or 1.0), np.concatenate(triangles)))


def ball(n: int = 120, radius: float = 0.5) -> Surface:
    """Return a sphere of n nodes, on a spiral."""
    height = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    across = np.sqrt(1.0 - height**2)
    points = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    cells = ConvexHull(points).simplices
    a, b, c = points[cells].transpose(1, 0, 2)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    return Surface(radius * points, np.where(inwards[:, None], cells[:, ::-1], cells))


def ring(n: int = 20, m: int = 8, radius: float = 0.15) -> Surface:
    """Return a torus."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    far = 0.4 + radius * np.cos(v)
    points = np.stack([far * np.cos(u), far * np.sin(u), radius * np.sin(v)], axis=-1)
    number = np.arange(n * m).reshape(n, m)
    right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    corner = np.roll(right, -1, axis=1)
    both = [np.stack([number, right, corner], -1), np.stack([number, corner, up], -1)]
    return Surface(points.reshape(-1, 3), np.concatenate([half.reshape(-1, 3) for half in both]))


def moved(surface: Surface, shift: object, factor: float = 1.0) -> Surface:
    """Return the surface scaled, then shifted."""
    return Surface(factor * surface.points + np.asarray(shift, float), surface.cells)


def turned(surface: Surface) -> Surface:
    """Return the surface with its normals the other way."""
    return Surface(surface.points, surface.cells[:, ::-1])


def together(*surfaces: Surface) -> Surface:
    """Return several surfaces as one."""
    first = np.cumsum([0, *[len(s.points) for s in surfaces]])
    cells = [s.cells + start for s, start in zip(surfaces, first[:-1], strict=True)]
    return Surface(np.concatenate([s.points for s in surfaces]), np.concatenate(cells))


def used(surface: Surface) -> Surface:
    """Return the surface without the points of no triangle."""
    kept, cells = np.unique(surface.cells, return_inverse=True)
    return Surface(surface.points[kept], cells.reshape(-1, 3))


# --- defects of the triangles, which leave the shape as it is -------------------------------------


def with_slivers(surface: Surface, count: int, rng: np.random.Generator) -> Surface:
    """Divide edges very close to an end."""
    points, cells = list(surface.points), [tuple(c) for c in surface.cells.tolist()]
    for _ in range(count):
        a, b, _ = cells[int(rng.integers(0, len(cells)))]
        place = 10.0 ** rng.uniform(-12, -2)
        points.append((1.0 - place) * points[a] + place * points[b])
        new, beside = len(points) - 1, [c for c in cells if a in c and b in c]
        for cell in beside:
            cells.remove(cell)
            cells += [tuple(new if v == old else v for v in cell) for old in (a, b)]
    return Surface(np.array(points), np.array(cells))


def with_doubled(surface: Surface, chosen: np.ndarray, rng: np.random.Generator) -> Surface:
    """Repeat chosen triangles, half of them the other way round."""
    again = surface.cells[chosen]
    over = rng.random(len(again)) < 0.5
    again = np.where(over[:, None], again[:, ::-1], again)
    return Surface(surface.points, np.concatenate([surface.cells, again]))


def with_flipped(surface: Surface, chosen: np.ndarray) -> Surface:
    """Turn the normals of chosen triangles."""
    return Surface(surface.points, np.where(chosen[:, None], surface.cells[:, ::-1], surface.cells))
