"""Parts with slots and gaps, given by their surfaces, and exact distances inside them."""

import numpy as np
from shapes import joined

from adaptsize import SimplexMesh, limit_gradient


def slotted():
    """A block with a slot of width 0.2, as a polygon."""
    return [(-5, -5), (5, -5), (5, 5), (0.1, 5), (0.1, -3), (-0.1, -3), (-0.1, 5), (-5, 5)]


def comb(n_fins, width=1.0, gap=0.2, height=6.0):
    """Fins on a bar, as a polygon."""
    points = [(0.0, 0.0), (n_fins * (width + gap) - gap, 0.0)]
    for k in reversed(range(n_fins)):
        left = k * (width + gap)
        points += [(left + width, 1.0 + height), (left, 1.0 + height)]
        points += [(left, 1.0), (left - gap, 1.0)] if k > 0 else []
    return points


def c_ring(n=40, gap=0.1):
    """A ring of radii 4 and 5 with a gap, as a polygon."""
    angle = np.linspace(gap, 2.0 * np.pi - gap, n)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return [*(5.0 * circle), *(4.0 * circle[::-1])]


def in_plane(polygon):
    """Triangles in a polygon, counter-clockwise, by clipping ears."""
    points, left, cells = np.asarray(polygon, float), list(range(len(polygon))), []

    def turn(a, b, c):
        (u, v), (s, t) = points[b] - points[a], points[c] - points[a]
        return u * t - v * s

    def is_ear(k):
        a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
        rest = (i for i in left if i not in (a, b, c))
        return turn(a, b, c) > 1e-12 and not any(
            turn(a, b, i) >= 0 and turn(b, c, i) >= 0 and turn(c, a, i) >= 0 for i in rest
        )

    while len(left) > 2:
        k = next(k for k in range(len(left)) if is_ear(k))
        cells.append([left[k - 1], left[k], left[(k + 1) % len(left)]])
        left.pop(k)
    return SimplexMesh(points, cells)


def extruded(polygon, height):
    """The surface of a prism."""
    flat, n = in_plane(polygon), len(polygon)
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    layers = [np.column_stack([flat.points, np.full(n, z)]) for z in (0.0, height)]
    sides = [np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])]
    return SimplexMesh(
        np.concatenate(layers), [*flat.cells[:, ::-1], *(flat.cells + n), *np.concatenate(sides)]
    )


def distances_in_prism(polygon, place):
    """Exact distances from a place inside a prism, as a function of points."""
    flat = in_plane(polygon)
    nowhere = np.full(flat.n_points, np.inf)
    source = np.array([place[:2]]), np.array([1e-9])
    info = limit_gradient.with_info(flat, nowhere, 1.0, method="exact", point_sources=source)[1]

    def distances(points):
        along = info.sources.evaluate(points[:, :2]) - 1e-9
        return np.hypot(along, points[:, 2] - place[2])

    return distances


def two_blocks(gap=0.1):
    """Two blocks side by side."""
    left = extruded([(0, 0), (4, 0), (4, 4), (0, 4)], 2.0)
    right = extruded([(4 + gap, 0), (8, 0), (8, 4), (4 + gap, 4)], 2.0)
    return joined(left, right)


def tube(centres, radius, m=12):
    """The surface of a tube along a curve that is not vertical."""
    along = np.gradient(centres, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    up = np.array([0.0, 0.0, 1.0]) - along[:, 2:] * along
    up /= np.linalg.norm(up, axis=1)[:, None]
    side, angle = np.cross(along, up), 2.0 * np.pi * np.arange(m) / m
    ring = np.cos(angle)[:, None] * up[:, None] + np.sin(angle)[:, None] * side[:, None]
    points = (centres[:, None] + radius * ring).reshape(-1, 3)
    k, i = np.arange(len(centres) - 1)[:, None] * m, np.arange(m)
    a, b = (k + i).ravel(), (k + (i + 1) % m).ravel()
    last = (len(centres) - 1) * m
    ends = [
        np.column_stack([np.full(m, len(points)), (i + 1) % m, i]),
        np.column_stack([np.full(m, len(points) + 1), last + i, last + (i + 1) % m]),
    ]
    sides = [np.column_stack([a, b, b + m]), np.column_stack([a, b + m, a + m])]
    return SimplexMesh([*points, centres[0], centres[-1]], np.concatenate([*sides, *ends]))


def spring(turns=5, n=30):
    """A spring of radius 3 and pitch 1.2, made of a wire of radius 0.5."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, turns * n + 1)
    return tube(np.column_stack([3 * np.cos(angle), 3 * np.sin(angle), 0.6 * angle / np.pi]), 0.5)


def revolved(profile, n=32):
    """The surface of a body of revolution, whose profile starts and ends on the axis."""
    (_, low), *between, (_, high) = profile
    r, z = np.array(between).T
    m, angle = len(r), 2.0 * np.pi * np.arange(n) / n
    points = np.stack(
        [np.outer(np.cos(angle), r), np.outer(np.sin(angle), r), np.tile(z, (n, 1))], -1
    )
    k, i = np.arange(n)[:, None], np.arange(m - 1)
    a, b = (k * m + i).ravel(), ((k + 1) % n * m + i).ravel()
    first, after = np.arange(n) * m, (np.arange(n) + 1) % n * m
    cells = [
        np.column_stack([a, b, b + 1]),
        np.column_stack([a, b + 1, a + 1]),
        np.column_stack([np.full(n, n * m), after, first]),
        np.column_stack([np.full(n, n * m + 1), first + m - 1, after + m - 1]),
    ]
    return SimplexMesh([*points.reshape(-1, 3), (0, 0, low), (0, 0, high)], np.concatenate(cells))


def nested_cups():
    """A cup in another one, with a gap of 0.2."""
    outer = revolved([(0, 0), (5, 0), (5, 6), (4, 6), (4, 1), (0, 1)])
    inner = revolved([(0, 1.2), (3.8, 1.2), (3.8, 6.5), (2.8, 6.5), (2.8, 2.2), (0, 2.2)])
    return joined(outer, inner)
