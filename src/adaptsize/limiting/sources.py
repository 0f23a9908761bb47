"""Where limited sizes come from, and sizes between the nodes straight from there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_points
from adaptsize._kernels.evaluate import evaluate_sources
from adaptsize.background import CartesianGrid
from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background import Octree, SimplexMesh
    from adaptsize.limiting.gradient_limit import SizeTransform

# Points that are worked on between two chances for Ctrl-C.
_AT_ONCE = 500_000


@dataclass(frozen=True, eq=False, repr=False)
class SizeSources:
    """The source of each nodal size: the node, edge or face whose bound it grew from.

    What source tracking knows, told by ``limit_gradient(..., full_output=True)`` as
    ``info.sources``.  With the sources a size function needs no interpolation: see
    `evaluate`, and `SizeFunction`.
    """

    background: SimplexMesh | CartesianGrid | Octree
    nodes: IntArray
    """int32[n_points, k]: numbers of the nodes of each source, -1 where there are fewer than
    k.  A node that keeps its bound is its own source; a node that no bound reaches has none.
    Where the way to the bound bends, the source is the last bend."""
    sizes: FloatArray
    """float64[n_points, k]: sizes at these nodes, inf where there are fewer; transformed if
    g depends on h."""
    bound: FloatArray
    """float64[n_points]: h0, transformed like ``sizes``."""
    limited: FloatArray
    """float64[n_points]: the limited sizes, transformed like ``sizes``."""
    g: float
    """Gradient limit (1 if it depends on h)."""
    convex: bool
    """Whether every straight line between nodes lies in the domain."""
    transform: SizeTransform | None = None
    bent: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    """float64[n_points, 4], or no rows: where in space a path bends on a reflex edge, which is
    then the source, a point and the size there from which it comes over that edge; else nan.
    With several bends the point is turned about the edges before into the line to the last."""

    def __post_init__(self) -> None:
        unreached = np.isinf(self.limited)  # where each node counts as its own source so far
        if unreached.any():
            nodes = np.where(unreached[:, None], np.int32(-1), self.nodes)
            object.__setattr__(self, "nodes", nodes)  # the way in for a frozen dataclass

    def __repr__(self) -> str:
        """Say how many sources feed how many nodes."""
        used = self.nodes[self.nodes[:, 0] >= 0]
        n_sources = len(np.unique(used, axis=0))
        return f"SizeSources({n_sources} sources of {len(self.nodes)} nodal sizes)"

    def roots(self) -> IntArray:
        """Return for each node the node whose bound its size goes back to.

        Bends are followed to their own source, and of a source of several nodes the one
        of the smallest size is taken.

        Returns
        -------
        ndarray of int32, shape (n_points,)
            -1 where no bound reaches.
        """
        least = np.argmin(np.where(self.nodes >= 0, self.sizes, np.inf), axis=1)
        root = np.take_along_axis(self.nodes, least[:, None], axis=1)[:, 0]
        while True:  # each round doubles the length of the way back
            further = np.where(root >= 0, root[root], -1)
            if np.array_equal(further, root):
                return np.asarray(root, dtype=np.int32)
            root = further

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return the limited size at points of the domain, straight from the sources.

        The least of what the sources of the nodes around a point allow there, and of the
        interpolated bound.  Where the sizes come from points and the domain is convex this is
        the limited size itself, to rounding, except beside nodes whose own source is not the
        best.  In a domain that is not convex it is so away from shadow lines: where the nodes
        around a point have different sources the nodal sizes are interpolated.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)

        Returns
        -------
        ndarray of float64, shape (n,)
        """
        where = as_points("points", points, self.background.dim)
        parts = [where[i : i + _AT_ONCE] for i in range(0, max(len(where), 1), _AT_ONCE)]
        values = np.concatenate([self._evaluate(part) for part in parts])
        return values if self.transform is None else self.transform.backward(values)

    def _evaluate(self, points: FloatArray) -> FloatArray:
        around, weights, _ = self.background.locator.weights(points)
        used = weights > 0.0
        nodes, sizes = self.nodes[around], self.sizes[around]
        bent = self.bent[around] if len(self.bent) else self.bent
        width = nodes.shape[-1]
        # Only the nodes that are sources here, and a row that the kernel works in.
        needed, number = np.unique(nodes, return_inverse=True)
        number = np.where(nodes >= 0, number.reshape(nodes.shape), -1).astype(np.int32)
        places = np.concatenate(
            [self._places(np.maximum(needed, 0)), np.empty((1, points.shape[1]))]
        )
        carriers = np.where(used, np.arange(used.size).reshape(used.shape), -1).astype(np.int32)
        value = np.empty(len(points))
        evaluate_sources(
            places,
            (0,) * points.shape[1],
            points,
            carriers,
            number.reshape(-1, width),
            sizes.reshape(-1, width),
            bent.reshape(-1, 4),
            self.g,
            not self.convex,
            value,
        )
        mixed = np.isnan(value)
        value = np.minimum(value, _interpolate(self.bound, around, weights))
        value[mixed] = _interpolate(self.limited, around[mixed], weights[mixed])
        return value

    def _places(self, nodes: IntArray) -> FloatArray:
        """Return the coordinates of nodes, without those of a whole grid."""
        if isinstance(self.background, CartesianGrid):
            index = np.stack(np.unravel_index(nodes, self.background.shape), axis=1)
            return self.background.origin + self.background.spacing * index
        return self.background.points[nodes]


def _interpolate(values: FloatArray, around: IntArray, weights: FloatArray) -> FloatArray:
    """Return interpolated nodal values, inf beside inf; nodes of weight 0 do not count."""
    nodal = np.where(weights > 0.0, values[around], 0.0)
    infinite = np.isinf(nodal).any(axis=1)
    nodal[infinite] = 0.0
    return np.where(infinite, np.inf, np.einsum("ij,ij->i", weights, nodal))
