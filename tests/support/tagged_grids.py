"""Random tags in grids of simplices: boxes, wedges, prisms, patches, sheets and lines."""

from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.stats import special_ortho_group

from adaptsize import SimplexMesh
from adaptsize.quality.boundary import distances_from, region_measures
from adaptsize.remeshing.straight_edges import feature_edges
from adaptsize.remeshing.surface import facets_of


def random_tags(seed, dim, *, is_moved=False):
    """Return a mesh with straight interfaces and tagged facets, and its spacing.

    Regions are boxes in a grid of random spacing, or wedges and prisms, whose diagonal sides are at
    more than the ridge angle to the other ones.
    """
    rng = np.random.default_rng(seed)
    n = rng.integers(3, 6, dim)
    kind = ("boxes", "wedges", "prism")[seed % 3]
    if kind == "boxes":
        steps = [rng.uniform(0.5, 1.5, k) for k in n]
    else:  # sides of wedges and prisms are plane
        steps = [np.full(k, rng.uniform(0.75, 1.2)) for k in n]
    index, cells = unit_grid(n)
    tags = _regions(kind, index[cells].mean(axis=1), n, rng)
    tags = rng.permutation(np.arange(-5, 20))[tags]  # regions are not in the order of the tags
    axes = [np.concatenate([[0.0], np.cumsum(step)]) for step in steps]
    points = np.column_stack([axis[i] for axis, i in zip(axes, index.T, strict=True)])
    if is_moved:
        points = points @ special_ortho_group.rvs(dim, random_state=rng)
        points = 10.0 ** rng.uniform(-3, 3) * (points + rng.uniform(-5.0, 5.0, dim))
    mesh = SimplexMesh(points, cells, cell_tags=tags)
    facets, facet_tags = _tagged_facets(mesh, index, n, rng)
    spacing = float(np.median(mesh.edge_lengths)) / np.sqrt(2.0)
    return replace(mesh, tagged_facets=facets, facet_tags=facet_tags), spacing


def _regions(kind, centres, n, rng):
    """Return numbers of regions from 5 on, given the centres of cells in a grid of unit cells."""
    tags = np.full(len(centres), 5)
    if kind == "prism":
        x, y = centres[:, :2].T
        below = np.column_stack([np.floor(x), np.floor(y), x % 1.0 > y % 1.0])
        triangle = np.unique(below, axis=0, return_inverse=True)[1].reshape(-1)
        tags[(rng.random(triangle.max() + 1) < 0.3)[triangle]] = 7
        if len(n) == 3:
            low, high = _range(n[2], rng)
            tags[(centres[:, 2] < low) | (centres[:, 2] > high)] = 5
        return tags
    for tag in range(7, 8 + rng.integers(3)):
        low, high = np.array([_range(k, rng) for k in n]).T
        inside = ((centres > low) & (centres < high)).all(axis=1)
        if kind == "wedges":
            i, j = rng.choice(len(n), 2, replace=False)
            inside &= centres[:, i] - low[i] > centres[:, j] - low[j]
        tags[inside] = tag
    return tags


def unit_grid(n):
    """Return the nodes of a grid of unit cells, and Kuhn's simplices."""
    shape = np.array(n) + 1
    number = np.arange(shape.prod()).reshape(shape)
    starts = np.argwhere(np.ones(n, bool))
    cells = []
    for order in permutations(range(len(n))):
        steps = np.cumsum(np.eye(len(n), dtype=int)[list(order)], axis=0)
        corners = [starts, *(starts + step for step in steps)]
        cells.append(np.stack([number[tuple(corner.T)] for corner in corners], axis=1))
    return np.argwhere(np.ones(shape, bool)), np.concatenate(cells)


def _range(n, rng):
    """Return two different integers from 0 to n, the smaller one first."""
    return np.sort(rng.choice(n + 1, 2, replace=False))


def _tagged_facets(mesh, index, n, rng):
    """Return a patch of the boundary, two sheets or lines inside, and the sides of a box."""
    facets = mesh.facets
    corners, middles = index[facets], index[facets].mean(axis=1)
    tags = np.zeros(len(facets), int)
    for tag in (31, 32, 33):
        axis = rng.integers(len(n))
        level = rng.integers(1, n[axis]) if tag > 31 else rng.choice([0, n[axis]])
        low, high = np.array([_range(k, rng) for k in n]).T
        inside = (middles > low) & (middles < high)
        inside[:, axis] = (corners[:, :, axis] == level).all(axis=1)
        tags[inside.all(axis=1)] = tag
    low, high = np.array([_range(k, rng) for k in n]).T
    if rng.random() < 0.5:
        in_box = (corners >= low[None, None]).all(axis=(1, 2)) & (corners <= high).all(axis=(1, 2))
        on_side = ((corners == low) | (corners == high)).all(axis=1).any(axis=1)
        tags[in_box & on_side & (tags == 0)] = 34
    return facets[tags > 0], tags[tags > 0]


def changes(new, old):
    """Return by how much regions, tagged facets, interfaces and their edges have changed.

    Measures are relative, distances over the diagonal.
    """
    found = {}
    before, after = region_measures(old), region_measures(new)
    assert before.keys() == after.keys()
    found["regions"] = max(abs(after[tag] / before[tag] - 1.0) for tag in before)
    assert set(np.unique(new.facet_tags)) == set(np.unique(old.facet_tags))
    sets = [
        [mesh.tagged_facets[mesh.facet_tags == tag] for mesh in (new, old)]
        for tag in np.unique(old.facet_tags)
    ]
    skins = [(SimplexMesh(new.points, a), SimplexMesh(old.points, b)) for a, b in sets]
    found["tagged"] = max(_change(*pair) for pair in skins)
    found["tagged distance"] = max(_distance(*pair) for pair in skins) / old.diagonal
    skin = facets_of(new), facets_of(old)
    found["facets"] = _change(*skin)
    found["facets distance"] = _distance(*skin) / old.diagonal
    if old.dim == 3:
        curves = [SimplexMesh(one.points, feature_edges(one)) for one in skin]
        found["edges"] = _change(*curves)
        found["edges distance"] = _distance(*curves) / old.diagonal
    return found


def _change(new, old):
    return abs(new.measures.sum() / old.measures.sum() - 1.0)


def _distance(new, old):
    return max(distances_from(new, old).largest, distances_from(old, new).largest)
