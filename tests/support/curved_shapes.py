"""Triangulated surfaces of known curvature, irregular on purpose."""

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, cKDTree

from adaptsize import SimplexMesh


def uneven_angles(n, seed):
    """Angles of n points around a circle whose distances vary by a factor up to three."""
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, n)
    return 2.0 * np.pi * np.cumsum(steps) / steps.sum()


def sliver_cylinder(n_around, seed, *, radius=1.0, height=2.0, rings=()):
    """A cylinder as CAD programs export it: long strips of uneven width, caps as fans.

    Returns the mesh; nodes come ring by ring, bottom first.
    """
    rng = np.random.default_rng(seed)
    angle = uneven_angles(n_around, seed)
    circle = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    levels = [0.0, *rings, height]
    points = np.concatenate([np.column_stack([circle, np.full(n_around, z)]) for z in levels])
    cells = []
    for first in range(0, len(points) - n_around, n_around):
        for i in range(n_around):
            a, b = first + i, first + (i + 1) % n_around
            c, d = a + n_around, b + n_around
            cells += [[a, b, d], [a, d, c]] if rng.random() < 0.5 else [[a, b, c], [b, d, c]]
    top = len(points) - n_around
    for i in range(1, n_around - 1):
        cells += [[0, i + 1, i], [top, top + i, top + i + 1]]
    return SimplexMesh(points, cells)


def prism(n_around, n_along, seed):
    """Return the sides of a regular prism, its unfolded nodes, and the length around it."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(n_around), np.linspace(0.0, 3.0, n_along), indexing="ij")
    v[:, 1:-1] += rng.uniform(-0.8, 0.8, v[:, 1:-1].shape) / n_along
    node = np.arange(u.size).reshape(u.shape)
    a, b = node, np.roll(node, -1, axis=0)
    quads = np.stack([a[:, :-1], b[:, :-1], b[:, 1:], a[:, 1:]], axis=-1).reshape(-1, 4)
    cells = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    turn = 2.0 * np.pi * u.ravel() / n_around
    side = 2.0 * np.sin(np.pi / n_around)
    points = np.column_stack([np.cos(turn), np.sin(turn), v.ravel()])
    flat = np.column_stack([side * u.ravel(), v.ravel()])
    return SimplexMesh(points, cells), flat, n_around * side


def around_prism(flat, around, nodes):
    """Return the distances of all nodes of a prism from some, float64[n, k]; see `prism`."""
    images = flat[nodes][:, None] + around * np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    return np.linalg.norm(flat[:, None, None] - images, axis=3).min(axis=2)


def free_cylinder(n_around, seed):
    """Irregular Delaunay triangles on a unit cylinder and its caps; all nodes lie on the mantle."""
    spacing, height = 2.0 * np.pi / n_around, 2.0
    u, v = _jittered(n_around, round(height / spacing), seed, open_in_v=True)
    cells = _periodic_delaunay(u, v, 2.0 * np.pi, height, periodic_v=False)
    angle = 2.0 * np.pi * u
    points = np.column_stack([np.cos(angle), np.sin(angle), height * v])
    corners = points[cells]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cells = cells[np.linalg.norm(normal, axis=1) > 1e-9]  # flat ones along the straight rims
    rims = [np.flatnonzero(v == end) for end in (0.0, 1.0)]
    caps = [rim[Delaunay(points[rim, :2]).simplices] for rim in rims]
    return SimplexMesh(points, np.concatenate([cells, *caps]))


def irregular_torus(n_around, seed):
    """Jittered Delaunay triangles on a torus, and the larger principal curvature at the nodes."""
    big, small = 1.0, 0.4
    u, v = _jittered(round(n_around * big / small), n_around, seed)
    cells = _periodic_delaunay(u, v, 2.0 * np.pi * big, 2.0 * np.pi * small, periodic_v=True)
    return _on_torus(u, v, cells, big, small)


def smooth_torus(n_around, *, big=1.0, small=0.4):
    """Triangles on a torus of smoothly varying shape, and the larger principal curvature."""
    nu, nv = round(n_around * big / small), n_around
    i, j = np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij")
    u = i / nu + 0.03 * np.sin(2.0 * np.pi * (2.0 * i / nu + j / nv))
    v = j / nv + 0.05 * np.sin(2.0 * np.pi * (i / nu + j / nv))
    a = i * nv + j
    b, c = (i + 1) % nu * nv + j, i * nv + (j + 1) % nv
    d = (i + 1) % nu * nv + (j + 1) % nv
    quads = np.stack([[a, b, d], [a, d, c]]).reshape(2, 3, -1)
    return _on_torus(u.ravel(), v.ravel(), quads.transpose(0, 2, 1).reshape(-1, 3), big, small)


def irregular_ellipsoid(spacing, seed):
    """Hull of random points no closer than ``spacing``, and the larger principal curvature."""
    rng = np.random.default_rng(seed)
    axes = np.array([1.0, 1.5, 2.0])
    points = rng.normal(size=(20_000, 3))
    points *= (1.0 / np.linalg.norm(points, axis=1))[:, None]
    points = points * axes
    tree = cKDTree(points)
    free = np.ones(len(points), dtype=bool)
    kept = []
    for i, neighbours in enumerate(tree.query_ball_point(points, spacing)):
        if free[i]:
            kept.append(i)
            free[neighbours] = False
    points = points[kept]
    return SimplexMesh(points, ConvexHull(points).simplices), _ellipsoid_curvature(points, axes)


def part_of(mesh, keep):
    """Return the cells whose centroid satisfies ``keep``, and the nodes that they use."""
    cells = mesh.cells[keep(mesh.points[mesh.cells].mean(axis=1))]
    nodes, local = np.unique(cells, return_inverse=True)
    return SimplexMesh(mesh.points[nodes], local.reshape(cells.shape)), nodes


def _ellipsoid_curvature(points, axes):
    """Second fundamental form of x^2/a^2 + y^2/b^2 + z^2/c^2 = 1: P A P / |A x|, P tangential."""
    gradient = points / axes**2
    size = np.linalg.norm(gradient, axis=1)
    normal = gradient / size[:, None]
    project = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    form = project @ np.diag(1.0 / axes**2) @ project / size[:, None, None]
    return np.abs(np.linalg.eigvalsh(form)).max(axis=1)


def _on_torus(u, v, cells, big, small):
    along, around = 2.0 * np.pi * u, 2.0 * np.pi * v
    out = big + small * np.cos(around)
    points = [out * np.cos(along), out * np.sin(along), small * np.sin(around)]
    kappa = np.maximum(1.0 / small, np.abs(np.cos(around)) / out)
    return SimplexMesh(np.column_stack(points), cells), kappa


def _jittered(nu, nv, seed, *, open_in_v=False):
    """Nodes of a staggered grid on the unit square, moved by up to 0.3 of the spacing."""
    rng = np.random.default_rng(seed)
    i, j = np.meshgrid(np.arange(nu), np.arange(nv + open_in_v), indexing="ij")
    inner = (j > 0) & (j < nv) if open_in_v else True
    u = (i + rng.uniform(-0.3, 0.3, i.shape) + 0.5 * (j % 2)) / nu
    v = (j + rng.uniform(-0.3, 0.3, i.shape) * inner) / nv
    return u.ravel() % 1.0, v.ravel() if open_in_v else v.ravel() % 1.0


def _periodic_delaunay(u, v, length_u, length_v, *, periodic_v):
    shifts = [(a, b) for a in (-1, 0, 1) for b in ((-1, 0, 1) if periodic_v else (0,))]
    copies = np.concatenate([np.column_stack([u + a, v + b]) for a, b in shifts])
    cells = Delaunay(copies * [length_u, length_v]).simplices
    centre = copies[cells].mean(axis=1)
    inside = (centre[:, 0] >= 0.0) & (centre[:, 0] < 1.0)
    if periodic_v:
        inside &= (centre[:, 1] >= 0.0) & (centre[:, 1] < 1.0)
    return np.unique(np.sort(cells[inside] % len(u), axis=1), axis=0)
