"""`SizeSources`: the controlling sources of limited sizes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_points
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.limiting.exact import ExactSolution
    from adaptsize.limiting.exact.solution import SolvedComponent
    from adaptsize.limiting.gradient_limit import SizeTransform

# Points per batch; Ctrl-C takes effect between batches.
_AT_ONCE = 500_000


@dataclass(frozen=True, eq=False, repr=False)
class SizeSources:
    """The controlling source of each nodal size: the node, edge or face whose bound it grew from.

    The exact method computes the sources; they are ``info.sources`` of
    ``limit_gradient.with_info(...)``.  With the sources, sizes between the nodes need
    no interpolation; see `evaluate` and `SizeFunction`.
    """

    background: SimplexMesh | CartesianGrid | Octree
    nodes: IntArray
    """int32[n_points, dim]: nodes of each source, padded with -1.  A node that keeps its bound is
    its own source.  A node that no bound reaches has no source.  If the path bends at a node, that
    node is the source.  ``n_points + k`` is the k-th of the point sources."""
    bends: FloatArray
    """float64[n_points, dim]: the last point where the path from the source bends, nan if the path
    is straight.  In a convex domain there are no rows.  Where sizes propagate along edges of the
    mesh, this is the neighbour."""
    bound: FloatArray
    """float64[n_points]: h0; transformed if g depends on h."""
    limited: FloatArray
    """float64[n_points]: the limited sizes; transformed if g depends on h."""
    parts: list[SolvedComponent] = field(default_factory=list)
    """The sources in each component of the domain."""
    transform: SizeTransform | None = None

    @classmethod
    def of(
        cls,
        background: SimplexMesh | CartesianGrid | Octree,
        solution: ExactSolution,
        bound: FloatArray,
        transform: SizeTransform | None,
    ) -> SizeSources:
        """Return the sources of a solution."""
        n, dim = solution.h.size, background.dim
        nodes = np.full((n, dim), -1, np.int32)
        nodes[:, 0] = np.arange(n)
        bend = [part.found.bends() for part in solution.parts]
        bends = np.full((n if any(map(len, bend)) else 0, dim), np.nan)
        for part, own_bends in zip(solution.parts, bend, strict=True):
            where, own = np.arange(n, dtype=np.int32)[part.nodes], part.found.named()
            k = len(where)
            inner = where[np.clip(own, 0, k - 1)]
            nodes[where] = np.where(own < 0, -1, np.where(own < k, inner, own - k + n))
            if len(own_bends):
                bends[where] = own_bends
        nodes[np.isinf(solution.h.ravel())] = -1
        limited = solution.h.ravel()
        return cls(background, nodes, bends, bound.ravel(), limited, solution.parts, transform)

    def __repr__(self) -> str:
        """Return the numbers of sources and of nodal sizes."""
        used = self.nodes[self.nodes[:, 0] >= 0]
        n_sources = len(np.unique(used, axis=0))
        return f"SizeSources({n_sources} sources of {len(self.nodes)} nodal sizes)"

    def roots(self) -> IntArray:
        """Return for each node the node whose bound its size goes back to.

        Where a path bends, it is followed further back to its source.  If a source has several
        nodes, the one with the smallest bound is returned.

        Returns
        -------
        ndarray of int32, shape (n_points,)
            -1 where no bound reaches, ``n_points + k`` for the k-th of the point sources.
        """
        n = len(self.bound)
        is_node = (self.nodes >= 0) & (self.nodes < n)
        bounds = np.where(is_node, self.bound[np.where(is_node, self.nodes, 0)], np.inf)
        several = (self.nodes[:, 1:] >= 0).any(axis=1)
        least = np.where(several, np.argmin(bounds, axis=1), 0)
        root = np.take_along_axis(self.nodes, least[:, None], axis=1)[:, 0]
        while True:  # each pass doubles the number of steps that are followed
            further = np.where(root < n, root[np.clip(root, 0, n - 1)], root)
            further = np.where(root >= 0, further, -1)
            if np.array_equal(further, root):
                return np.asarray(root, dtype=np.int32)
            root = further

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return the limited size at points of the domain, without interpolation.

        The size is the minimum of the interpolated bound and of the sizes that the visible
        sources and boundary corners allow.  In convex domains and in the plane this is the
        exact limited size, to rounding.  On surfaces, in solids that are not convex, and on grids
        with passages without a whole box, the nodal sizes are interpolated instead.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)

        Returns
        -------
        ndarray of float64, shape (n,)
        """
        where = as_points("points", points, self.background.dim)
        parts = [where[i : i + _AT_ONCE] for i in range(0, max(len(where), 1), _AT_ONCE)]
        locator = self.background.locator
        return np.concatenate([self.at(part, *locator.weights(part)[:2]) for part in parts])

    def at(self, points: FloatArray, around: IntArray, weights: FloatArray) -> FloatArray:
        """Return the limited size at points whose surrounding nodes and weights are known.

        Parameters
        ----------
        points : float64[n, dim]
        around, weights : int32[n, k], float64[n, k]
            As returned by ``background.locator.weights``.
        """
        values = self._transformed(points, around, weights)
        return values if self.transform is None else self.transform.backward(values)

    def _transformed(self, points: FloatArray, around: IntArray, weights: FloatArray) -> FloatArray:
        value = _interpolate(self.limited, around, weights)
        bound = _interpolate(self.bound, around, weights)
        heaviest = np.take_along_axis(around, np.argmax(weights, axis=1)[:, None], axis=1)[:, 0]
        for part in self.parts:
            member = np.zeros(len(self.limited), np.bool_)
            member[part.nodes] = True
            inside = member[heaviest]
            if part.found.proved is None:
                field = part.found.between
                places = points[inside]
                if field.sight is not None:
                    # Walls hide points that are outside by more than rounding.
                    domain = self.background
                    mesh = domain if isinstance(domain, SimplexMesh) else domain.mesh
                    corners = mesh.points[around[inside]]
                    places = np.einsum("ij,ijd->id", weights[inside], corners)
                start = value if part.found.interpolates else bound
                value[inside] = field.evaluate(places, start[inside])
        return value


def _interpolate(values: FloatArray, around: IntArray, weights: FloatArray) -> FloatArray:
    """Return interpolated nodal values, inf if a node of positive weight is inf."""
    nodal = np.where(weights > 0.0, values[around], 0.0)
    infinite = np.isinf(nodal).any(axis=1)
    nodal[infinite] = 0.0
    return np.where(infinite, np.inf, np.einsum("ij,ij->i", weights, nodal))


_SHAPES: dict[type, tuple[str, ...]] = {
    SimplexMesh: ("points", "cells"),
    Octree: ("root_shape", "lower", "upper", "levels"),
    CartesianGrid: ("shape", "origin", "spacing", "active"),
}


def is_same(a: object, b: object) -> bool:
    """Return whether two backgrounds have the same nodes and cells."""
    if a is b or type(a) is not type(b) or type(a) not in _SHAPES:
        return a is b
    return all(is_equal(getattr(a, name), getattr(b, name)) for name in _SHAPES[type(a)])


def is_equal(a: object, b: object) -> bool:
    """Return whether two arrays are the same or have the same entries."""
    return a is b or bool(np.array_equal(a, b))  # type: ignore[arg-type]
