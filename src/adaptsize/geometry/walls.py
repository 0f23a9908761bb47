"""The facets of a boundary as walls for rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize._kernels import rays as kernels
from adaptsize.background._curve import tree_over
from adaptsize.geometry.faces import Faces
from adaptsize.typing import FloatArray, LongArray

#: Distances below this, in units of the longest side of the boundary's box, are rounding.
SLACK = 1e-9


class WallTree(NamedTuple):
    """The facets of a boundary in a tree.

    Parameters
    ----------
    order : LongArray
        Number of the facet in each row.
    tree : kernels.FacetTree
    """

    order: LongArray
    tree: kernels.FacetTree

    @classmethod
    def of(cls, faces: Faces) -> WallTree:
        """Return the walls of a boundary in its frame."""
        tree, order = tree_over(faces.frame.of(faces.mesh.points), faces.mesh.cells)
        facets = _facets(faces.corners[order], faces.normals[order])
        return cls(order, kernels.FacetTree(facets, tree.boxes, SLACK))


def _facets(corners: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the rows of facets, see rays.py in _kernels.

    The normals are of unit length, or zero for facets without area, which nothing hits.
    """
    p, q = corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]
    a, b = p, np.zeros_like(p)
    if corners.shape[1] == 3:
        a, b = np.cross(normals, q), np.cross(normals, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        a = a / _products(a, p)
        if corners.shape[1] == 3:
            b = b / _products(b, q)
    beside = [SLACK * np.sqrt(_products(v, v)) for v in (a, b, a + b)]
    return np.hstack([corners[:, 0], normals, a, b, *beside])


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the scalar products of rows as a column."""
    return np.asarray(a[:, :1] * b[:, :1] + a[:, 1:2] * b[:, 1:2] + a[:, 2:] * b[:, 2:])
