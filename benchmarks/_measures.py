"""Distances, winding numbers and samples of triangles, by libigl or by plain NumPy.

NumPy, where libigl is absent, compares every point with every triangle.  That is exact, serves as a
reference for libigl, and is quick enough for small cases only.
"""

import numpy as np

try:
    import igl
except ImportError:  # not needed for small cases
    igl = None

#: Numbers per temporary array of the slow versions.
_CHUNK = 2_000_000
#: Points times triangles above which the slow versions take minutes.
_MOST_PAIRS = 3e9


def fan(points, triangles):
    """Return the corners of triangles, one array (n, 3) for each."""
    return points[triangles].transpose(1, 0, 2)


def areas_and_normals(points, triangles):
    """Return the areas, and the unit normals (0 where there is no area)."""
    a, b, c = fan(points, triangles)
    normal = np.cross(b - a, c - a)
    twice = np.linalg.norm(normal, axis=1)
    return 0.5 * twice, normal / np.where(twice > 0.0, twice, 1.0)[:, None]


def enclosed_volume(points, triangles):
    """Return the volume that a closed surface encloses, parts inside twice counted twice."""
    a, b, c = fan(points - points.mean(axis=0), triangles)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def winding_numbers(points, triangles, queries, exact=True):
    """Return how often a surface encloses each point; not ``exact`` is faster, to about .01."""
    if igl is None:
        return winding_numbers_slow(points, triangles, queries)
    function = igl.winding_number if exact else igl.fast_winding_number
    return np.asarray(function(points, np.asarray(triangles, np.int64), queries)).ravel()


def winding_numbers_slow(points, triangles, queries):
    """Return the sum of the solid angles of all triangles over 4 pi."""
    a, b, c = fan(points, triangles)

    def of(some):
        p, q, r = (corner - some[:, None] for corner in (a, b, c))
        lp, lq, lr = (np.linalg.norm(side, axis=2) for side in (p, q, r))
        volume = np.einsum("ijk,ijk->ij", p, np.cross(q, r))
        dots = [np.einsum("ijk,ijk->ij", *pair) for pair in ((p, q), (q, r), (r, p))]
        other = lp * lq * lr + dots[0] * lr + dots[1] * lp + dots[2] * lq
        return np.arctan2(volume, other).sum(axis=1) / (2.0 * np.pi)

    return _in_chunks(of, queries, len(triangles))


def distances(points, triangles, queries):
    """Return the distance of each point from the nearest triangle."""
    if igl is None:
        return distances_slow(points, triangles, queries)
    triangles = np.asarray(triangles, np.int64)
    return np.sqrt(igl.point_mesh_squared_distance(queries, points, triangles)[0])


def distances_slow(points, triangles, queries):
    """Return the least distance from edges and, for points above the inside, from planes."""
    corners = fan(points, triangles)
    _, normals = areas_and_normals(points, triangles)

    def of(some):
        best = np.full(len(some), np.inf)
        above = np.ones((len(some), len(triangles)), bool)
        for a, b in zip(corners, (corners[1], corners[2], corners[0]), strict=True):
            side, away = b - a, some[:, None] - a
            length = np.maximum(np.einsum("ij,ij->i", side, side), np.finfo(float).tiny)
            share = np.clip(np.einsum("ijk,jk->ij", away, side) / length, 0.0, 1.0)
            gap = np.linalg.norm(away - share[..., None] * side, axis=2)
            best = np.minimum(best, gap.min(axis=1))
            above &= np.einsum("ijk,jk->ij", away, np.cross(normals, side)) > 0.0
        height = np.abs(np.einsum("ijk,jk->ij", some[:, None] - corners[0], normals))
        return np.minimum(best, np.where(above, height, np.inf).min(axis=1))

    return _in_chunks(of, queries, len(triangles))


def _in_chunks(function, queries, n_triangles):
    if len(queries) * n_triangles > _MOST_PAIRS:
        raise SystemExit("libigl is needed for surfaces of this size: pip install libigl")
    step = max(1, _CHUNK // (9 * max(n_triangles, 1)))
    parts = [function(queries[first : first + step]) for first in range(0, len(queries), step)]
    return np.concatenate(parts) if parts else np.empty(0)


def samples(points, triangles, count, rng):
    """Return points on a surface, and the triangle of each.

    All corners of all triangles, and about ``count`` points on edges and inside triangles, evenly.
    """
    area, _ = areas_and_normals(points, triangles)
    spacing = np.sqrt(max(area.sum(), 1e-30) / count)
    own = np.arange(len(triangles))
    places, owners = [fan(points, triangles).reshape(-1, 3)], [np.tile(own, 3)]
    sides = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    )
    edges, first = np.unique(sides, axis=0, return_index=True)
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    times = np.minimum(np.ceil(np.linalg.norm(b - a, axis=1) / spacing).astype(int), 10_000)
    edge = np.repeat(np.arange(len(edges)), times)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(times) - times, times) + 0.5) / times[edge]
    places.append(a[edge] + share[:, None] * (b - a)[edge])
    owners.append(np.tile(own, 3)[first[edge]])
    times = np.floor(area / spacing**2 + rng.random(len(area))).astype(int)
    inner = np.repeat(own, times)
    weights = rng.dirichlet(np.ones(3), len(inner))
    places.append(np.einsum("ij,ijk->ik", weights, points[triangles[inner]]))
    owners.append(inner)
    return np.concatenate(places), np.concatenate(owners)
