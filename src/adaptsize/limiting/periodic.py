"""Periodic domains: nodes identified by translations, and images of sources beyond the cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, refuse_where
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.topology import components_of
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

# Nodes coincide if they are closer than this share of the diagonal.
_SAME = 1e-7
# Measures are equal if they differ by less than this share.
_EQUAL = 1e-6


@dataclass(frozen=True, eq=False)
class Periodicity:
    """A domain (the cell) that is repeated by translations."""

    domain: SimplexMesh | CartesianGrid
    vectors: FloatArray
    """float64[k, dim]: linearly independent translations."""
    pairs: IntArray
    """int32[n, 2]: nodes and their images."""

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
        rod if every line along each translation leaves the cell after its length.
        """
        domain = self.domain
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
        normals = _normals(domain.points[boundary.facets])
        return all(self._ends_every_line(v, boundary.facets, normals) for v in self.vectors)

    def _has_measure(self, measure: float) -> bool:
        k, dim = self.vectors.shape
        if k < dim:
            return False
        return bool(abs(abs(np.linalg.det(self.vectors)) - measure) < _EQUAL * measure)

    def _ends_every_line(self, vector: FloatArray, facets: IntArray, normals: FloatArray) -> bool:
        """Return whether the facets with an image along a vector are all that it crosses."""
        assert isinstance(self.domain, SimplexMesh)
        start = _pairs_along(self.domain.points, vector, self.domain.diagonal)[:, 0]
        flux = normals @ vector
        ends = np.isin(facets, start).all(axis=1)
        through, crossed = float(np.abs(flux).sum()), float(np.abs(flux[ends]).sum())
        return abs(crossed - 0.5 * through) < _EQUAL * through

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


def as_periodicity(domain: SimplexMesh | CartesianGrid, vectors: npt.ArrayLike) -> Periodicity:
    """Return the periodicity of a mesh or grid after checking that its nodes come in pairs.

    Raises
    ------
    ValueError
        If ``vectors`` has a bad shape or is linearly dependent, if a translation maps no node to
        a node, maps a node into the domain where there is no node, or maps the domain onto its
        own inside.
    """
    given = as_float_array("periodic", vectors)
    if given.ndim != 2 or not 1 <= len(given) <= domain.dim or given.shape[1] != domain.dim:
        raise ValueError(
            f"periodic must hold 1 to {domain.dim} translations, of shape (k, {domain.dim}), "
            f"got shape {given.shape}"
        )
    refuse_where("periodic", ~np.isfinite(given), given, "must be finite")
    if np.linalg.matrix_rank(given, tol=_SAME * domain.diagonal) < len(given):
        raise ValueError(f"periodic must hold linearly independent vectors, got {given.tolist()}")
    return Periodicity(domain, given, _kept_pairs(domain, given))


def _kept_pairs(domain: SimplexMesh | CartesianGrid, vectors: FloatArray) -> IntArray:
    """Return the pairs of nodes, which are kept with the domain as its derived data are."""
    kept, key = vars(domain), vectors.tobytes()
    found = kept.get("_periodic_pairs")
    if found is None or found[0] != key:
        found = kept["_periodic_pairs"] = key, _checked_pairs(domain, vectors)
    pairs: IntArray = found[1]
    return pairs


def _checked_pairs(domain: SimplexMesh | CartesianGrid, vectors: FloatArray) -> IntArray:
    """Return the pairs of nodes and their images, int32[n, 2]; refuse images that do not fit."""
    points, outer = domain.points, _on_boundary(domain)
    found = []
    for steps in product((-1, 0, 1), repeat=len(vectors)):
        if next((s for s in steps if s), 0) != 1:  # each pair of opposite translations once
            continue
        shift = np.array(steps, dtype=np.float64) @ vectors
        pairs = _pairs_along(points, shift, domain.diagonal)
        _refuse_overlap(domain, outer, shift, pairs)
        if sum(map(abs, steps)) == 1 and len(pairs) == 0:
            raise ValueError(
                f"periodic[{steps.index(1)}] = {shift.tolist()} maps no node of the background "
                "to another node"
            )
        found.append(pairs)
    return np.concatenate(found)


def _pairs_along(points: FloatArray, shift: FloatArray, diagonal: float) -> IntArray:
    """Return the nodes that a translation maps to a node, and that node, int32[n, 2]."""
    from scipy.spatial import cKDTree

    near = _SAME * diagonal
    sent, received = _within_box_after(points, shift, near), _within_box_after(points, -shift, near)
    if len(sent) == 0 or len(received) == 0:
        return np.empty((0, 2), np.int32)
    away, which = cKDTree(points[received]).query(points[sent] + shift)
    same = away <= near
    return np.column_stack([sent[same], received[which[same]]]).astype(np.int32)


def _within_box_after(points: FloatArray, shift: FloatArray, near: float) -> npt.NDArray[np.intp]:
    """Return which points a translation leaves in their bounding box."""
    within = np.ones(len(points), np.bool_)
    for x, step in zip(points.T, shift, strict=True):
        if step > near:
            within &= x <= x.max() - step + near
        elif step < -near:
            within &= x >= x.min() - step - near
    return np.flatnonzero(within)


def _refuse_overlap(
    domain: SimplexMesh | CartesianGrid, outer: BoolArray, shift: FloatArray, pairs: IntArray
) -> None:
    """Refuse a translation of the domain into its inside, and of a node to where none is."""
    points, near = domain.points, _SAME * domain.diagonal
    active = getattr(domain, "active", None)
    inside = ~outer[pairs].all(axis=1)
    if inside.any():
        i, j = pairs[np.argmax(inside)]
        raise ValueError(
            f"periodic must be translations to the next cell, but {shift.tolist()} maps node {i} "
            f"to node {j}, which are not both on the boundary: the domain overlaps its image"
        )
    alone = np.setdiff1d(_within_box_after(points, shift, near), pairs[:, 0])
    if active is not None:
        alone = alone[active.ravel()[alone]]
    if len(alone) == 0:
        return
    _, weights, away = domain.locator.weights(points[alone] + shift)
    alone = alone[(away <= near) & (weights.sum(axis=1) > 0.5)]
    if len(alone):
        i = int(alone[0])
        raise ValueError(
            f"periodic needs nodes in pairs, but node {i} at {points[i].tolist()} moved by "
            f"{shift.tolist()} lies in the domain, where there is no node"
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


def _normals(corners: FloatArray) -> FloatArray:
    """Return normals of segments or triangles, of the length or area times a constant."""
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        return np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
    return np.asarray(np.cross(edges[:, 0], edges[:, 1]))
