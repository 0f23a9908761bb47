"""The size function of an implicit domain, on an octree that is refined by it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptsize._checks import describe
from adaptsize._progress import silent
from adaptsize._size_function import SizeFunction
from adaptsize.background import Octree
from adaptsize.domain_size.on_octree import (
    Beside,
    Shape,
    adapted,
    limited_on_octree,
    longest_edges,
    size_on_octree,
)
from adaptsize.domain_size.report import SizeReport
from adaptsize.domain_size.request import Request
from adaptsize.errors import ResolutionWarning
from adaptsize.geometry.distance.zero_level import boundary_of, is_distance
from adaptsize.geometry.implicit_surface import Implicit, largest_curvature
from adaptsize.geometry.medial.on_meshes import DomainOnMesh, InnerCells
from adaptsize.sizes.budget import calibration
from adaptsize.typing import FloatArray

#: Most leaves of the background, in the plane and in space.
MAX_LEAVES = {2: 100_000, 3: 400_000}
# Rounds of refinement.
_MOST_ROUNDS = 10
# A boundary that turns by more than the crease angle within this share of the diagonal, or within
# the given hmin if that is smaller, has a corner.
_SMALLEST_SHARE = 1e-3
# The curvature jumps between two points if its values differ by more than this factor; the jump is
# found to the number of bisections.
_AT_JUMP = 0.75
_HALVINGS = 5
# Longest and shortest steps for curvatures, in edges of cells and in that length.
_LONGEST_STEP = 0.1
_SHORTEST_STEP = 0.1


@dataclass
class ImplicitDomain:
    """The region where a function is negative."""

    function: Implicit
    tree: Octree
    is_fixed: bool = False
    """Whether the octree is used as it is."""
    _kept: Shape | None = None

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.tree.dim

    def limited(self, request: Request) -> tuple[SizeFunction, SizeReport]:
        """Return the limited sizes and which cause controls them where.

        If the request would be relaxed because of the number of elements, the octree is not
        refined further.
        """
        if not (self.is_fixed or request.h0 is None or callable(request.h0)):
            raise ValueError(
                "h0 must be a function for a domain whose background is chosen, "
                f"got {describe(request.h0)}"
            )
        shape = self._first(request)
        limits = request.limits(_diagonal(shape))
        for _ in range(_MOST_ROUNDS):
            h, report = limited_on_octree(shape, limits, request)
            n_elements = calibration("mmg", self.dim) * report.n_elements
            too_many = n_elements > request.max_elements and not request.is_fixed
            if self.is_fixed or too_many:
                break
            tree = adapted(shape, h, limits[0], request)
            if tree is None:
                break
            if tree.n_leaves > MAX_LEAVES[self.dim]:
                _warn_of_leaves(shape.tree, tree)
                break
            shape = self._shape(tree, request)
        return size_on_octree(shape, h), report

    def _first(self, request: Request) -> Shape:
        """Return the domain as seen on the first octree, kept for relaxed requests."""
        if self._kept is None:
            self._kept = self._shape(self.tree, request)
        return self._kept

    @cached_property
    def _is_distance(self) -> bool:
        values = self.function(self.tree.points)
        return is_distance(self.function, self.tree.points[values < 0.0], self.tree.diagonal)

    def _shape(self, tree: Octree, request: Request) -> Shape:
        """Return the domain as seen on an octree."""
        report = silent if request.report is None else request.report
        values = self.function(tree.points)
        _check_signs(values, tree)
        boundary = boundary_of(self.function, tree, values, self._is_distance)
        nodes = boundary.from_nodes(tree, report)
        domain = DomainOnMesh(tree.mesh, boundary, nodes, report)
        medial = domain.medial_axis()
        everywhere, inner, width = domain.sizes_inside(medial, request.crease_angle)
        assert inner is not None
        feet = nodes.feet(tree.points)[inner.nodes]
        curvature = self._curvature_near(tree, nodes.depth[inner.nodes], inner, feet, request)
        beside = self._beside(tree, inner, feet, curvature, request)
        return Shape(tree, nodes, inner, width, everywhere, curvature, beside)

    def _curvature_near(
        self,
        tree: Octree,
        depth: FloatArray,
        inner: InnerCells,
        feet: FloatArray,
        request: Request,
    ) -> FloatArray:
        """Return the curvature at the closest points of nodes near the boundary, else nan."""
        reach = longest_edges(inner.mesh)
        near = depth <= reach
        curvature = np.full(len(depth), np.nan)
        curvature[near] = self._curvature(tree, feet[near], reach[near], request)
        return curvature

    def _curvature(
        self, tree: Octree, points: FloatArray, reach: FloatArray, request: Request
    ) -> FloatArray:
        """Return the curvature at points next to the boundary, 0 at corners."""
        smallest = _SMALLEST_SHARE * tree.diagonal
        if request.hmin is not None:
            smallest = min(request.hmin, smallest)
        kappa = largest_curvature(
            self.function, points, _LONGEST_STEP * reach, least_step=_SHORTEST_STEP * smallest
        )
        kappa[kappa * smallest > np.radians(request.crease_angle)] = 0.0
        return kappa

    def _beside(
        self,
        tree: Octree,
        inner: InnerCells,
        feet: FloatArray,
        curvature: FloatArray,
        request: Request,
    ) -> Beside:
        """Return how far large curvatures extend from one closest point towards the next.

        Where the curvature jumps, as at the ends of rounded edges, the size is controlled from the
        place of the jump.  It is found by bisection.
        """
        edges, lengths = inner.mesh.edges, inner.mesh.edge_lengths
        ends = curvature[edges]
        jumps = ends.min(axis=1) < _AT_JUMP * ends.max(axis=1)  # False with nan
        edges, lengths, ends = edges[jumps], lengths[jumps], ends[jumps]
        order = np.argsort(ends, axis=1)
        low, high = np.take_along_axis(edges, order, axis=1).T
        largest = ends.max(axis=1)
        kappa, share, step = largest.copy(), np.zeros(len(low)), 0.5
        for _ in range(_HALVINGS):
            at = (1.0 - share - step)[:, None] * feet[high] + (share + step)[:, None] * feet[low]
            there = self._curvature(tree, at, step * lengths, request)
            goes_on = there >= _AT_JUMP * largest
            kappa[goes_on], share[goes_on] = there[goes_on], share[goes_on] + step
            step *= 0.5
        away = (1.0 - share) * np.linalg.norm(feet[low] - feet[high], axis=1)
        ends = (1.0 - share)[:, None] * feet[high] + share[:, None] * feet[low]
        return Beside(low, kappa, away, ends)


def _warn_of_leaves(tree: Octree, wanted: Octree) -> None:
    warnings.warn(
        f"the background has {tree.n_leaves} leaves, and {wanted.n_leaves} would be more than the "
        f"{MAX_LEAVES[tree.dim]} allowed: between its nodes, sizes may be off by more than 5 %; "
        "raise hmin, or give a background",
        ResolutionWarning,
        stacklevel=5,
    )


def _diagonal(shape: Shape) -> float:
    """Return the diagonal of the domain."""
    tree, inner = shape.tree, shape.inner
    near = inner.nodes[np.isfinite(shape.curvature)]
    feet = shape.nodes.feet(tree.points)[near]
    places = np.concatenate([tree.points[inner.nodes[inner.inside]], feet])
    return float(np.linalg.norm(np.ptp(np.clip(places, tree.lower, tree.upper), axis=0)))


def _check_signs(values: FloatArray, tree: Octree) -> None:
    if not (values < 0.0).any():
        raise ValueError(
            f"domain must be negative at a node of the background, got none of {tree!r}"
        )
    if not (values > 0.0).any():
        raise ValueError(
            f"domain must have its boundary in the background, got all of {tree!r} inside"
        )
