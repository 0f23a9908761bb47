"""Periodic domains: nodes identified by translations or rotations, and images beyond the cell."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, refuse_where
from adaptsize._pickling import once
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.topology import components_of
from adaptsize.geometry.boundary import facet_normals, flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

# Nodes coincide if they are closer than this share of the diagonal.
_SAME = 1e-7
# Measures are equal if they differ by less than this share.
_EQUAL = 1e-6


@dataclass(frozen=True, eq=False)
class Periodicity:
    """A domain (the cell) that is repeated by translations, or by rotations."""

    domain: SimplexMesh | CartesianGrid
    vectors: FloatArray
    """float64[k, dim]: linearly independent translations; none for rotations."""
    pairs: IntArray
    """int32[n, 2]: nodes and their images."""
    maps: FloatArray
    """float64[k, dim, dim + 1]: the translations or rotations as [R | t]."""

    @property
    def motions(self) -> FloatArray:
        """The translations, float64[k, dim], or the rotations [R | t]."""
        return self.vectors if len(self.vectors) else self.maps

    @cached_property
    def classes(self) -> tuple[IntArray, IndexArray]:
        """Nodes that have an image, and for each of them the number of its class."""
        nodes, local = np.unique(self.pairs, return_inverse=True)
        return nodes.astype(np.int32), components_of(local.reshape(-1, 2), len(nodes))

    def least(self, sizes: FloatArray) -> FloatArray:
        """Return sizes of the nodal shape, the smallest of each class at all of its nodes."""
        nodes, label = self.classes
        lowered = sizes.copy()
        least = np.full(len(nodes), np.inf)
        np.minimum.at(least, label, lowered.ravel()[nodes])
        lowered.reshape(-1)[nodes] = least[label]
        return lowered

    @cached_property
    def is_convex(self) -> bool:
        """Whether the cell and its images make up a convex domain, as far as the tests can tell.

        The cell must be convex.  Then its images fill space if there are ``dim`` of them and
        their parallelepiped has the measure of the cell.  With fewer, they make up a layer or a
        rod if every line along each translation leaves the cell after its length.  Rotations are
        left to fast marching.
        """
        domain = self.domain
        if len(self.vectors) == 0:
            return False
        if isinstance(domain, CartesianGrid):
            if domain.active is not None:
                return False
            on_axes = bool((np.count_nonzero(self.vectors, axis=1) == 1).all())
            return self._has_measure(float(np.prod(domain.upper - domain.lower))) or on_axes
        if domain.cell_dim != domain.dim or len(np.unique(domain.cells)) < domain.n_points:
            return False
        if domain.dim == 1:
            return True
        boundary = flat_boundary(domain, 1)
        if not is_convex(domain.points, boundary):
            return False
        if self._has_measure(float(domain.measures.sum())):
            return True
        normals = facet_normals(domain.points[boundary.facets])
        return all(_ends_every_line(domain, v, boundary.facets, normals) for v in self.vectors)

    def _has_measure(self, measure: float) -> bool:
        k, dim = self.vectors.shape
        if k < dim:
            return False
        return bool(abs(abs(np.linalg.det(self.vectors)) - measure) < _EQUAL * measure)

    def shifts(self) -> Iterator[FloatArray]:
        """Yield all translations that may bring a point of the cell nearer to another one.

        For x, y in the cell, x - (y + L) is shorter than x - y only if L is shorter than two
        diameters.
        """
        farthest = 2.0 * self.domain.diagonal
        most = np.floor(farthest * np.linalg.norm(np.linalg.pinv(self.vectors), axis=0) + 1e-9)
        for steps in product(*(range(-int(n), int(n) + 1) for n in most)):
            shift = np.array(steps, dtype=np.float64) @ self.vectors
            if any(steps) and np.linalg.norm(shift) < farthest:
                yield shift


def _ends_every_line(
    domain: SimplexMesh, vector: FloatArray, facets: IntArray, normals: FloatArray
) -> bool:
    """Return whether the facets with an image along a vector are all that it crosses."""
    points = domain.points
    start = pairs_of(points, points + vector, domain.diagonal)[:, 0]
    flux = normals @ vector
    ends = np.isin(facets, start).all(axis=1)
    through, crossed = float(np.abs(flux).sum()), float(np.abs(flux[ends]).sum())
    return abs(crossed - 0.5 * through) < _EQUAL * through


def as_periodicity(domain: SimplexMesh | CartesianGrid, motions: npt.ArrayLike) -> Periodicity:
    """Return the periodicity of a mesh or grid after checking that its nodes come in pairs.

    Raises
    ------
    ValueError
        If ``motions`` has a bad shape, is linearly dependent or no rotation, if a motion maps no
        node to a node, maps a node into the domain where there is no node, or maps the domain onto
        its own inside.
    """
    given, dim = as_float_array("periodic", motions), domain.dim
    if given.ndim == 3 and given.shape[1:] == (dim, dim + 1) and dim > 1 and len(given):
        _check_rotations(given, domain.diagonal)
        return Periodicity(domain, np.empty((0, dim)), _kept_pairs(domain, given), given)
    if given.ndim != 2 or not 1 <= len(given) <= dim or given.shape[1] != dim:
        raise ValueError(
            f"periodic must hold 1 to {dim} translations, of shape (k, {dim}), got shape "
            f"{given.shape}; rotations [R | t] have shape (k, {dim}, {dim + 1})"
        )
    refuse_where("periodic", ~np.isfinite(given), given, "must be finite")
    if np.linalg.matrix_rank(given, tol=_SAME * domain.diagonal) < len(given):
        raise ValueError(f"periodic must hold linearly independent vectors, got {given.tolist()}")
    return Periodicity(domain, given, _kept_pairs(domain, given), _as_maps(given))


def _as_maps(motions: FloatArray) -> FloatArray:
    """Return translations or rotations as maps [R | t], float64[k, dim, dim + 1]."""
    if motions.ndim == 3:
        return motions
    k, dim = motions.shape
    same = np.broadcast_to(np.eye(dim), (k, dim, dim))
    return np.concatenate([same, motions[:, :, None]], axis=2)


def _check_rotations(given: FloatArray, diagonal: float) -> None:
    """Refuse maps x -> R x + t of which R is no rotation, or that are the identity."""
    refuse_where("periodic", ~np.isfinite(given), given, "must be finite")
    turn = given[:, :, :-1]
    rest = np.abs(turn @ turn.swapaxes(1, 2) - np.eye(turn.shape[1])).max(axis=(1, 2))
    refuse_where(
        "periodic",
        (rest > _SAME) | (np.linalg.det(turn) < 0.0),
        given,
        "must be [R | t], R a rotation",
    )
    still = np.abs(turn - np.eye(turn.shape[1])).max(axis=(1, 2)) <= _SAME
    still &= np.linalg.norm(given[:, :, -1], axis=1) <= _SAME * diagonal
    refuse_where("periodic", still, given, "must not be the identity")


def _kept_pairs(domain: SimplexMesh | CartesianGrid, motions: FloatArray) -> IntArray:
    """Return the pairs of nodes, which are kept with the domain as its derived data are."""
    name = f"_pairs_by_{motions.tobytes().hex()}"
    return once(domain, name, lambda: _checked_pairs(domain, motions))


def _checked_pairs(domain: SimplexMesh | CartesianGrid, motions: FloatArray) -> IntArray:
    """Return the pairs of nodes and their images, int32[n, 2]; refuse images that do not fit."""
    points, outer = domain.points, _on_boundary(domain)
    found = []
    for steps, whole in combined(_as_maps(motions)):
        motion, there = (whole if motions.ndim == 3 else whole[:, -1]), moved(whole, points)
        pairs = pairs_of(points, there, domain.diagonal)
        _refuse_overlap(domain, outer, motion, there, pairs)
        if sum(map(abs, steps)) == 1 and len(pairs) == 0:
            raise ValueError(
                f"periodic[{steps.index(1)}] = {motion.tolist()} maps no node of the background "
                "to another node"
            )
        found.append(pairs)
    return np.concatenate(found)


def combined(maps: FloatArray) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
    """Yield how often each map is applied, and the map [R | t] of all together.

    They are all neighbours of the cell, also across its edges and corners: each map is applied -1,
    0 or 1 times, one of each two opposite combinations.  Those that lead back to the cell are left
    out.  Nodes and facets are paired by the same maps.
    """
    still = np.eye(maps.shape[1], maps.shape[2])
    far = max(1.0, float(np.abs(maps[:, :, -1]).max()))
    scale = np.array([1.0] * maps.shape[1] + [far])
    for steps in product((-1, 0, 1), repeat=len(maps)):
        if next((one for one in steps if one), 0) == 1:
            whole = power(maps, steps)
            if np.abs((whole - still) / scale).max() > _SAME:
                yield steps, whole


def moved(maps: FloatArray, points: FloatArray) -> FloatArray:
    """Return the images of points under a map [R | t], or each under its own."""
    if maps.ndim == 2:
        return np.asarray(points @ maps[:, :-1].T + maps[:, -1])
    return np.asarray(np.einsum("nij,nj->ni", maps[:, :, :-1], points) + maps[:, :, -1])


def inverse(one: FloatArray) -> FloatArray:
    """Return the inverse of a rotation and translation [R | t]."""
    back = one[:, :-1].T
    return np.column_stack([back, -back @ one[:, -1]])


def power(maps: FloatArray, steps: tuple[int, ...]) -> FloatArray:
    """Return the map that applies each motion so many times."""
    dim = maps.shape[1]
    found = np.eye(dim, dim + 1)
    for one, times in zip(maps, steps, strict=True):
        each = one if times > 0 else inverse(one)
        for _ in range(abs(times)):
            shift = moved(each, found[None, :, -1])[0]
            found = np.column_stack([each[:, :-1] @ found[:, :-1], shift])
    return found


def pairs_of(points: FloatArray, moved: FloatArray, diagonal: float) -> IntArray:
    """Return the nodes that a motion maps to a node, and that node, int32[n, 2]."""
    from scipy.spatial import cKDTree

    near = _SAME * diagonal
    sent = _within_box(moved, points, near)
    if len(sent) == 0:
        return np.empty((0, 2), np.int32)
    received = _within_box(points, moved[sent], near)
    away, which = cKDTree(points[received]).query(moved[sent])
    same = away <= near
    return np.column_stack([sent[same], received[which[same]]]).astype(np.int32)


def _within_box(points: FloatArray, others: FloatArray, near: float) -> IndexArray:
    """Return which points are in the bounding box of others."""
    lower, upper = others.min(axis=0) - near, others.max(axis=0) + near
    return np.flatnonzero(((points >= lower) & (points <= upper)).all(axis=1))


def _refuse_overlap(
    domain: SimplexMesh | CartesianGrid,
    outer: BoolArray,
    motion: FloatArray,
    moved: FloatArray,
    pairs: IntArray,
) -> None:
    """Refuse a motion of the domain into its inside, and of a node to where none is."""
    points, near = domain.points, _SAME * domain.diagonal
    active = getattr(domain, "active", None)
    inside = ~outer[pairs].all(axis=1)
    if inside.any():
        i, j = pairs[np.argmax(inside)]
        raise ValueError(
            f"periodic must be motions to the next cell, but {motion.tolist()} maps node {i} "
            f"to node {j}, which are not both on the boundary: the domain overlaps its image"
        )
    alone = np.setdiff1d(_within_box(moved, points, near), pairs[:, 0])
    if active is not None:
        alone = alone[active.ravel()[alone]]
    if len(alone) == 0:
        return
    _, weights, away = domain.locator.weights(moved[alone])
    alone = alone[(away <= near) & (weights.sum(axis=1) > 0.5)]
    if len(alone):
        i = int(alone[0])
        raise ValueError(
            f"periodic needs nodes in pairs, but node {i} at {points[i].tolist()} moved by "
            f"{motion.tolist()} lies in the domain, where there is no node"
        )


def _on_boundary(domain: SimplexMesh | CartesianGrid) -> BoolArray:
    """Return which nodes are on the boundary; of a grid, on that of its box."""
    if isinstance(domain, CartesianGrid):
        index = np.indices(domain.shape).reshape(domain.dim, -1)
        last = np.array(domain.shape)[:, None] - 1
        return np.asarray(((index == 0) | (index == last)).any(axis=0))
    outer = np.zeros(domain.n_points, np.bool_)
    outer[domain.facets[domain.facet_cell_counts == 1]] = True
    return outer
