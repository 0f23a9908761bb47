"""The size function of an implicit domain, on an octree that is refined by it."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from adaptsize._checks import describe, warn_caller
from adaptsize._messages import Message
from adaptsize._size_function import SizeFunction
from adaptsize.background import Octree
from adaptsize.background.enclosing import enclosing_diameter
from adaptsize.domain_size.by_domain import check_signs
from adaptsize.domain_size.on_octree import (
    Shape,
    adapted,
    inner_cells,
    limited_on_octree,
    size_on_octree,
)
from adaptsize.domain_size.request import Request
from adaptsize.errors import ResolutionWarning
from adaptsize.geometry.distance.closest_points import (
    Boundary,
    Depths,
    FunctionBoundary,
    ZeroLevelBoundary,
    is_distance,
)
from adaptsize.geometry.implicit_surface import Implicit, largest_curvature
from adaptsize.geometry.width_of_functions import width_within
from adaptsize.sizes.budget import calibration
from adaptsize.typing import BoolArray, FloatArray

#: Most leaves of the background, in the plane and in space.
MAX_LEAVES = {2: 100_000, 3: 400_000}


@dataclass
class ImplicitDomain:
    """The region where a function is negative."""

    function: Implicit
    tree: Octree
    is_fixed: bool = False
    """Whether the octree is used as it is."""
    _first_shape: Shape | None = None

    def size_for(self, request: Request) -> SizeFunction:
        """Return the limited sizes, with a report on which cause controls them where.

        If the request would be relaxed because of the number of elements, the octree is not
        refined further.
        """
        if not (self.is_fixed or request.h0 is None or callable(request.h0)):
            raise ValueError(
                "h0 must be a function for a domain whose background is chosen, "
                f"got {describe(request.h0)}"
            )
        if self._first_shape is None:  # relaxed requests see the same
            self._first_shape = self._shape(self.tree, request)
        shape = self._first_shape
        limits, dim = request.limits(_diameter(shape)), self.tree.dim
        for _ in range(10):
            h, report = limited_on_octree(shape, limits, request)
            n_elements = calibration("mmg", dim) * report.n_elements
            most = min(request.max_elements, 1e7)  # octrees for more are larger than any memory
            too_many = n_elements > most and not request.is_fixed
            if self.is_fixed or too_many:
                break
            tree = adapted(shape, h, limits[0], request)
            if tree is None:
                break
            if tree.n_leaves > MAX_LEAVES[dim]:
                warn_caller(
                    Message(
                        "the background has {} leaves, and {} would be more than the {} allowed: "
                        "between its nodes, sizes may be off by more than 5 %; raise {hmin}, or "
                        "give a background",
                        *(shape.tree.n_leaves, tree.n_leaves, MAX_LEAVES[dim]),
                    ),
                    ResolutionWarning,
                )
                break
            shape = self._shape(tree, request)
        return size_on_octree(shape, h, report)

    @cached_property
    def _is_distance(self) -> bool:
        values = self.function(self.tree.points)
        return is_distance(self.function, self.tree.points[values < 0.0], self.tree.diagonal)

    def _shape(self, tree: Octree, request: Request) -> Shape:
        """Return the domain as seen on an octree."""
        values = self.function(tree.points)
        check_signs(values < 0.0, values, tree)
        boundary: Boundary = (
            FunctionBoundary(self.function, tree.diagonal)
            if self._is_distance
            else ZeroLevelBoundary(self.function, tree, values)
        )
        nodes = boundary.seen_from(tree.points, request.progress)
        # Nodes as deep as rounding are on the boundary.
        inner = inner_cells(tree.mesh, nodes.depth >= -1e-12 * tree.mesh.diagonal)
        edges = tree.mesh.edges
        near = np.unique(edges[-nodes.depth[edges].sum(axis=1) <= tree.mesh.edge_lengths])
        width = np.full(tree.n_points, np.inf)
        seen = Depths(nodes.depth[near], nodes.outward[near])
        width[near] = width_within(
            boundary, tree.points[near], seen, tree.diagonal, request.progress
        )
        reach = np.zeros(inner.mesh.n_points)  # the longest edge at each node
        np.maximum.at(reach, inner.mesh.edges, inner.mesh.edge_lengths[:, None])
        close = nodes.depth[inner.nodes] <= reach
        closest = nodes.closest_points(tree.points)[inner.nodes[close]]
        curvature = np.full(len(close), np.nan)
        curvature[close] = self._curvature(tree, closest, reach[close], request)
        return Shape(tree, nodes, inner, width, curvature)

    def _curvature(
        self, tree: Octree, points: FloatArray, reach: FloatArray, request: Request
    ) -> FloatArray:
        """Return the curvature at points next to the boundary, 0 at corners.

        At a corner, the boundary turns by more than the crease angle within 1/1000 of the diagonal,
        or within the given hmin if that is smaller.
        """
        smallest, hmin = 1e-3 * tree.diagonal, request.options["hmin"]
        if hmin is not None:
            smallest = min(hmin, smallest)
        kappa = largest_curvature(self.function, points, 0.1 * reach, least_step=0.1 * smallest)
        kappa[kappa * smallest > np.radians(request.crease_angle)] = 0.0
        return kappa


def _diameter(shape: Shape) -> float:
    """Return the diameter of the smallest ball around the domain."""
    tree, inner = shape.tree, shape.inner
    near = inner.nodes[np.isfinite(shape.curvature)]
    closest = shape.nodes.closest_points(tree.points)[near]
    places = np.concatenate([tree.points[inner.nodes[inner.inside]], closest])
    return enclosing_diameter(np.clip(places, tree.lower, tree.upper))


def octree_around(function: Implicit, lower: FloatArray, upper: FloatArray) -> Octree:
    """Return an octree that shows all parts of the zero level of a function.

    Cells through which the zero level may pass are refined while the function is not nearly
    linear in them: at bends and corners, and where two parts are close to each other.

    The box from ``lower`` to ``upper`` has at least 32 cells along its longest side (16 in space),
    and at most 512 (128).
    """
    extent, dim = float((upper - lower).max()), len(lower)
    coarsest = extent / {2: 32, 3: 16}[dim]
    n_finest = {2: 512, 3: 128}[dim]
    finest = extent / n_finest

    def needs_refinement(centres: FloatArray, sizes: FloatArray) -> BoolArray:
        edge = float(sizes.max())
        if edge > coarsest:
            return np.ones(len(centres), np.bool_)
        if edge <= finest:
            return np.zeros(len(centres), np.bool_)
        return _is_bent(function, centres, 0.5 * sizes)

    return Octree.build(lower, upper, needs_refinement, max_level=math.ceil(math.log2(n_finest)))


def _is_bent(function: Implicit, centres: FloatArray, half: FloatArray) -> BoolArray:
    """Return in which cells the zero level may be, and the function is not nearly linear.

    It is nearly linear if it is, at the corners, up to a tenth of its change from the centre to
    them.  The zero level may pass if the value at the centre is below 1.2 times that change.
    """
    at_centre = function(centres)
    dim = centres.shape[1]
    rise, change = np.zeros(centres.shape), np.zeros(centres.shape)
    for axis in range(dim):
        step = np.zeros(centres.shape)
        step[:, axis] = half[:, axis]
        above, below = function(centres + step), function(centres - step)
        rise[:, axis] = 0.5 * (above - below)
        change[:, axis] = np.maximum(np.abs(above - at_centre), np.abs(below - at_centre))
    reach = change.sum(axis=1)
    off = np.zeros(len(centres))
    for corner in product((-1.0, 1.0), repeat=dim):
        linear = at_centre + rise @ np.array(corner)
        off = np.maximum(off, np.abs(function(centres + corner * half) - linear))
    return np.asarray((np.abs(at_centre) <= 1.2 * reach) & (off > 0.1 * reach))
