"""Meshes of cells that are repeated by translations or rotations, with matching sides."""

from collections.abc import Callable
from typing import Any

import numpy as np

from adaptsize import CartesianGrid, SimplexMesh

Unit = tuple[SimplexMesh, Any]


def _square(n: int) -> SimplexMesh:
    return CartesianGrid([0.0, 0.0], 1.0 / n, (n + 1, n + 1)).mesh


def _cube(n: int) -> SimplexMesh:
    return CartesianGrid([0.0, 0.0, 0.0], 1.0 / n, (n + 1,) * 3).mesh


def _with_sides(mesh: SimplexMesh, tags: np.ndarray) -> SimplexMesh:
    """Return a mesh of which the facets on the sides of the unit box have tags 1, 2, ..."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    found, numbers = [], []
    for d in range(mesh.dim):
        for k, value in enumerate((low[d], high[d])):
            on = np.abs(mesh.points[mesh.facets][:, :, d] - value).max(axis=1) < 1e-9
            found.append(mesh.facets[on])
            numbers += [1 + 2 * d + k] * int(on.sum())
    return SimplexMesh(
        mesh.points, mesh.cells, cell_tags=tags, tagged_facets=np.concatenate(found),
        facet_tags=numbers, tag_names={(mesh.cell_dim - 1, 1): "left"},
    )  # fmt: skip


def _near_lattice(
    points: np.ndarray, centres: list[list[float]], radius: float, order: float = 2.0
) -> np.ndarray:
    """Return which points are in balls around centres or their images."""
    step = points[:, None] - np.array(centres)
    away = np.linalg.norm(step - np.round(step), ord=order, axis=2)
    return np.asarray((away < radius).any(axis=1))


def plane_inclusions() -> Unit:
    """A square with inclusions across its sides and corners, with tags of all sides."""
    mesh = _square(24)
    middles = mesh.points[mesh.cells].mean(axis=1)
    inside = _near_lattice(middles, [[0.0, 0.0], [0.5, 0.9], [0.1, 0.55]], 0.17)
    return _with_sides(mesh, np.where(inside, 7, 3)), np.eye(2)


def parallelogram() -> Unit:
    """A lattice cell with oblique vectors."""
    vectors = np.array([[1.0, 0.1], [0.45, 0.8]])
    mesh = _square(9)
    return SimplexMesh(mesh.points @ vectors, mesh.cells), vectors


def hexagon() -> Unit:
    """A hexagonal cell, whose third pair of sides is a difference of the translations."""
    corners = [[np.cos(a), np.sin(a)] for a in np.arange(6) * np.pi / 3.0]
    points, cells, n = [], [], 6
    for k in range(6):
        a, b = np.array(corners[k]), np.array(corners[(k + 1) % 6])
        first = len(points)
        number = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                number[i, j] = first + len(number)
                points.append((i * a + j * b) / n)
        for i in range(n):
            for j in range(n - i):
                cells.append([number[i, j], number[i + 1, j], number[i, j + 1]])
                if i + j < n - 1:
                    cells.append([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]])
    places, node = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    x = np.zeros((len(places), 2))
    x[node.ravel()] = points
    vectors = [[1.5, np.sqrt(0.75)], [0.0, 2.0 * np.sqrt(0.75)]]
    return SimplexMesh(x, node.ravel()[np.array(cells)]), np.array(vectors)


def wavy_strip() -> Unit:
    """A strip that is repeated along x, with wavy sides and a wavy top."""
    mesh = _square(12)
    x, y = mesh.points.T
    moved = np.column_stack([x + 0.08 * np.sin(7.0 * y), y * (1.0 + 0.1 * np.sin(2.0 * np.pi * x))])
    return SimplexMesh(moved, mesh.cells), np.array([[1.0, 0.0]])


def _rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def rotor_sector() -> Unit:
    """An eighth of a ring with a magnet across its side, and an origin elsewhere."""
    mesh, angle, middle = _square(12), np.pi / 4.0, np.array([3.0, -2.0])
    r, a = 1.0 + mesh.points[:, 0], angle * mesh.points[:, 1]
    points = middle + np.column_stack([r * np.cos(a), r * np.sin(a)])
    turn = mesh.points[mesh.cells].mean(axis=1)
    magnet = (np.abs(turn[:, 0] - 0.6) < 0.17) & (np.abs(turn[:, 1] - 0.5) > 0.33)
    turned = _rotation(angle)
    motion = np.column_stack([turned, middle - turned @ middle])
    return SimplexMesh(points, mesh.cells, cell_tags=magnet.astype(int)), motion[None]


def sector(whole: float, n: int) -> Unit:
    """A sector of a disc with n rings of cells, which contains the centre."""
    points, cells = [], []
    for i in range(n + 1):
        for j in range(i + 1):
            angle = whole * (j / i if i else 0.0)
            points.append([i / n * np.cos(angle), i / n * np.sin(angle)])
    for i in range(n):
        one, other = i * (i + 1) // 2, (i + 1) * (i + 2) // 2
        for j in range(i + 1):
            cells.append([one + j, other + j, other + j + 1])
            if j < i:
                cells.append([one + j, other + j + 1, one + j + 1])
    motion = np.column_stack([_rotation(whole), np.zeros(2)])
    return SimplexMesh(np.array(points), cells), motion[None]


def sector_with_axis() -> Unit:
    """A sixth of a disc."""
    return sector(np.pi / 3.0, 8)


def box_with_inclusions() -> Unit:
    """A cube with a cube across its corners, with tags of all sides."""
    mesh = _cube(4)
    middles = mesh.points[mesh.cells].mean(axis=1)
    inside = _near_lattice(middles, [[0.0, 0.0, 0.0]], 1.0 / 4.0, np.inf)
    return _with_sides(mesh, np.where(inside, 2, 1)), np.eye(3)


def gyroid() -> Unit:
    """The solid between two gyroid surfaces."""
    mesh = _cube(6)
    x, y, z = 2.0 * np.pi * mesh.points.T

    def level() -> np.ndarray:
        return np.asarray(np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x))

    kept = np.abs(level()[mesh.cells].mean(axis=1)) < 0.7
    nodes, cells = np.unique(mesh.cells[kept], return_inverse=True)
    return SimplexMesh(mesh.points[nodes], cells.reshape(-1, 4)), np.eye(3)


def rotor_sector_in_space() -> Unit:
    """A sixth of a ring that is repeated around and along its axis."""
    mesh, angle = CartesianGrid([0.0] * 3, [1.0 / 4, 1.0 / 8, 1.0 / 3], (5, 9, 4)).mesh, np.pi / 3.0
    r, a = 1.0 + mesh.points[:, 0], angle * mesh.points[:, 1]
    points = np.column_stack([r * np.cos(a), r * np.sin(a), mesh.points[:, 2]])
    turned, raised = np.eye(3, 4), np.eye(3, 4)
    turned[:2, :2] = _rotation(angle)
    raised[2, 3] = 1.0
    return SimplexMesh(points, mesh.cells), np.stack([turned, raised])


def column() -> Unit:
    """A column that is repeated along x and y, with a tagged sheet inside."""
    mesh = CartesianGrid([0.0, 0.0, 0.0], [0.2, 0.2, 0.2], (6, 6, 8)).mesh
    sheet = np.abs(mesh.points[mesh.facets][:, :, 2] - 0.6).max(axis=1) < 1e-9
    return SimplexMesh(
        mesh.points, mesh.cells, tagged_facets=mesh.facets[sheet], facet_tags=[5] * sheet.sum()
    ), np.eye(3)[:2]


def sheet() -> Unit:
    """A wavy surface in space that is repeated along x and y."""
    mesh = _square(12)
    x, y = 2.0 * np.pi * mesh.points.T
    points = np.column_stack([mesh.points, 0.1 * np.sin(x) * np.cos(y)])
    return SimplexMesh(points, mesh.cells), np.eye(3)[:2]


UNITS: dict[str, Callable[[], Unit]] = {
    one.__name__: one
    for one in (
        plane_inclusions, parallelogram, hexagon, wavy_strip, rotor_sector, sector_with_axis,
        box_with_inclusions, gyroid, rotor_sector_in_space, column, sheet,
    )
}  # fmt: skip
