"""Octrees in space and quadtrees in the plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    NEAREST,
    as_flag,
    as_float_array,
    as_plain_array,
    as_points,
    as_whole_number,
    check_function,
    check_range,
    refuse_where,
)
from adaptsize._kernels.octree import Nodes
from adaptsize._kernels.octree_cells import cut_leaves
from adaptsize._pickling import ReadOnlyState
from adaptsize.background import _octree_growth as growth
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.location import OctreeLocator
from adaptsize.background.refinement import NeedsRefinement
from adaptsize.background.simplex import SimplexMesh
from adaptsize.typing import FloatArray, IntArray, LongArray


@dataclass(init=False, frozen=True, eq=False, repr=False)
class Octree(ReadOnlyState):
    """An octree (in 2-D a quadtree): a box divided into cells that are refined where needed.

    The nodes are the corners of the leaves, including hanging nodes, followed by the centres
    of some leaves and faces.  On these nodes, ``mesh`` is a conforming mesh of triangles or
    tetrahedra.  It exists for any difference of level between neighbouring leaves, so that the
    octree need not be balanced.  Sizes on the octree are sizes on that mesh, and
    `limit_gradient` works on it.

    Use `Octree.build` to refine a box by a criterion.  The constructor takes the levels of the
    leaves, one byte per leaf; together with their order these define the octree.

    Parameters
    ----------
    lower, upper : array_like of float, shape (dim,)
        Corners of the box, up to 1e60 in size, ``lower < upper``; dim is 2 or 3.
    root_shape : sequence of int, shape (dim,)
        Number of cells of level 0 along each axis.
    levels : array_like of int, shape (n_leaves,)
        Level of each leaf, in the order of the leaves: the cells of level 0 row by row, the
        last axis fastest, and the children of a refined cell in the same order.

    Raises
    ------
    ValueError
        If the box is empty, a number is out of range, the smallest cells would be too small
        for float64, or the leaves do not fill the box.

    Examples
    --------
    >>> tree = Octree([0, 0], [1, 1], (1, 1), [1, 1, 1, 2, 2, 2, 2])
    >>> tree
    Octree(7 leaves of level 1 to 2, 2-D)
    >>> tree.leaf_centres[:4].tolist()
    [[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.625, 0.625]]

    Two leaves have a hanging node; their centres are therefore nodes, too:

    >>> tree.n_points, tree.mesh
    (16, SimplexMesh(16 points in 2-D, 20 triangles))
    """

    lower: FloatArray
    upper: FloatArray
    root_shape: tuple[int, ...]
    levels: npt.NDArray[np.int8]

    def __init__(
        self,
        lower: npt.ArrayLike,
        upper: npt.ArrayLike,
        root_shape: npt.ArrayLike,
        levels: npt.ArrayLike,
    ) -> None:
        lower, upper = as_box(lower, upper)
        shape = _as_root_shape(root_shape, lower, upper)
        given = as_plain_array("levels", levels)
        if given.ndim != 1 or given.size == 0 or given.dtype.kind not in "iu":
            raise ValueError(
                f"levels must be integers of shape (n_leaves,), got {given.dtype} of shape "
                f"{given.shape}"
            )
        _refuse_level("levels", int(given.max()), lower, upper, shape)
        refuse_where("levels", given < 0, given, "must be at least 0")
        own = given.astype(np.int8)
        _refuse_gaps(own, shape)
        for name, value in (("lower", lower), ("upper", upper), ("levels", own)):
            object.__setattr__(self, name, read_only(value))  # needed for a frozen dataclass
        object.__setattr__(self, "root_shape", shape)

    @classmethod
    def build(
        cls,
        lower: npt.ArrayLike,
        upper: npt.ArrayLike,
        needs_refinement: NeedsRefinement,
        *,
        max_level: int,
        balanced: bool = False,
        root_shape: npt.ArrayLike | None = None,
        max_leaves: int = 20_000_000,
    ) -> Octree:
        """Return an octree that is refined wherever a criterion requires it.

        Parameters
        ----------
        lower, upper : array_like of float, shape (dim,)
            Corners of the box, finite, ``lower < upper``; dim is 2 or 3.
        needs_refinement : callable
            Takes the centres and the edge lengths of the m cells of one level, both
            float64[m, dim], and returns bool[m]: the cells to halve along each axis.
            `refine_at_boundary` and `refine_to_size` return such callables.  It is called
            once per level, with all cells of that level.
        max_level : int
            Largest level, >= 0; cells of this level are not refined.  It is at most 20 in 3-D
            and 31 in 2-D, less with many root cells.
        balanced : bool
            Whether to refine further until the levels of leaves that touch at a face, an edge
            or a corner differ by at most one.
        root_shape : sequence of int, shape (dim,), optional
            Number of cells of level 0 along each axis.  By default there is one along the
            shortest side; the others are chosen such that the cells are nearest to cubes.
        max_leaves : int
            Bound on the number of leaves.  It stops a criterion that refines everything
            before memory runs out.

        Returns
        -------
        Octree

        Raises
        ------
        ValueError
            If the box is empty, ``max_level`` is out of range or makes cells too small for
            float64, the criterion does not return bool[m], or there are more leaves than
            ``max_leaves``.

        Notes
        -----
        Time and memory are proportional to the number of leaves.  The criterion is evaluated
        for only slightly more cells than there are leaves.

        Examples
        --------
        A quadtree that is refined at a point:

        >>> import numpy as np
        >>> def near(centres, sizes):
        ...     return (np.abs(centres - 0.3) <= 0.5 * sizes).all(axis=1)
        >>> tree = Octree.build([0, 0], [2, 1], near, max_level=5)
        >>> tree
        Octree(17 leaves of level 0 to 5, 2-D)
        >>> Octree.build([0, 0], [2, 1], near, max_level=5, balanced=True)
        Octree(47 leaves of level 1 to 5, 2-D)
        """
        check_function("needs_refinement", needs_refinement, "centres and sizes")
        balanced = as_flag("balanced", balanced)
        lower, upper = as_box(lower, upper)
        if root_shape is None:
            lengths = upper - lower
            root_shape = np.maximum(np.rint(lengths / lengths.min()), 1.0)
        max_leaves = as_whole_number("max_leaves", max_leaves, lower=1, upper=2**53)
        shape = _as_root_shape(root_shape, lower, upper)
        growth.refuse_too_many(math.prod(shape), 0, max_leaves)
        max_level = as_whole_number("max_level", max_level, lower=0, upper=2**53)
        _refuse_level("max_level", max_level, lower, upper, shape)
        refined = growth.refine(lower, upper, shape, needs_refinement, max_level, max_leaves)
        if balanced:
            refined = growth.balance(refined, shape)
            n_leaves = math.prod(shape) + (2 ** len(shape) - 1) * sum(map(len, refined))
            growth.refuse_too_many(n_leaves, len(refined), max_leaves)
        return cls(lower, upper, shape, growth.leaf_levels(refined, shape))

    def __repr__(self) -> str:
        """Return the number of leaves and the range of their levels."""
        coarsest, finest = int(self.levels.min()), int(self.levels.max())
        return f"Octree({self.n_leaves} leaves of level {coarsest} to {finest}, {self.dim}-D)"

    @property
    def dim(self) -> int:
        """Number of coordinates of a point: 2 (a quadtree) or 3."""
        return len(self.root_shape)

    @property
    def n_leaves(self) -> int:
        """Number of leaves."""
        return len(self.levels)

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return self._numbered[1]

    @property
    def nodal_shape(self) -> tuple[int, ...]:
        """Shape of an array of nodal values, ``(n_points,)``."""
        return (self.n_points,)

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the box."""
        return math.dist(self.lower, self.upper)

    @cached_property
    def leaf_lower(self) -> FloatArray:
        """Lower corner of each leaf, float64[n_leaves, dim]."""
        return self._planes(self._lattice.indices)

    @cached_property
    def leaf_centres(self) -> FloatArray:
        """Centre of each leaf, float64[n_leaves, dim]."""
        edges = np.int64(1) << (self._lattice.depth - self.levels.astype(np.int64))
        return self._planes(self._lattice.indices + 0.5 * edges[:, None])

    @cached_property
    def leaf_sizes(self) -> FloatArray:
        """Edge lengths of each leaf, float64[n_leaves, dim]."""
        roots = (self.upper - self.lower) / np.array(self.root_shape)
        return read_only(np.ldexp(roots, -self.levels[:, None].astype(np.int32)))

    @cached_property
    def leaf_corners(self) -> IntArray:
        """Nodes at the corners of each leaf, int32[n_leaves, 2**dim].

        Corner j lies at the upper end of axis d if bit ``dim - 1 - d`` of j is 1.  The corners
        are thus ordered row by row, the last axis fastest.
        """
        return read_only(self._nodes.corners)

    @cached_property
    def points(self) -> FloatArray:
        """Nodes, float64[n_points, dim].

        Corners of leaves first, then the centres of leaves and faces that ``mesh`` needs.
        """
        points = np.empty((self.n_points, self.dim))
        rest = self._nodes.keys[: self.n_points]
        for d, stride in enumerate(self._lattice.strides):
            index, rest = np.divmod(rest, stride)
            points[:, d] = self._coordinates(index, d)
        return read_only(points)

    @cached_property
    def mesh(self) -> SimplexMesh:
        """A conforming mesh of triangles or tetrahedra on the same nodes in the same order.

        A leaf whose only nodes are its corners is split along diagonals into 2 triangles or 6
        tetrahedra.  The direction of the diagonals alternates from cell to cell.  Any other
        leaf is split into triangles or tetrahedra between its centre and the pieces of its
        boundary.  A face is split in the same manner by its own nodes only, so that the two
        leaves at the face agree.

        Cells are in the order of the leaves and positively oriented.  If the leaves are cubes
        and balanced, the angles of triangles are 45 and 90 degrees, and the dihedral angles of
        tetrahedra are 45 to 120 degrees.  If they are not balanced, there are flat cells at
        small pieces of the boundary of large leaves.
        """
        cells = np.empty((self._numbered[2], self.dim + 1), np.int32)
        cut_leaves(self._nodes, cells)
        return SimplexMesh(self.points, read_only(cells))

    @cached_property
    def locator(self) -> OctreeLocator:
        """Point location and interpolation in ``mesh``; see `OctreeLocator`."""
        return OctreeLocator(self)

    @cached_property
    def first_cells(self) -> LongArray:
        """First cell of ``mesh`` in each leaf, and their number, int64[n_leaves + 1]."""
        return read_only(self._nodes.first_cells)

    def find_leaves(self, points: npt.ArrayLike) -> IntArray:
        """Return the leaf that contains each point; outside, that of the closest point of the box.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)

        Returns
        -------
        ndarray of int32, shape (n,)
            Rows of ``leaf_centres``, ``leaf_sizes`` and ``levels``.
        """
        lattice = self._lattice
        where = np.clip(as_points("points", points, self.dim), self.lower, self.upper)
        places = (where - self.lower) / (self.upper - self.lower) * lattice.counts
        indices = np.minimum(places.astype(np.int64), lattice.counts - 1)
        codes = growth.codes_of(indices, lattice.depth, self.root_shape)
        return (np.searchsorted(lattice.starts, codes, side="right") - 1).astype(np.int32)

    @cached_property
    def _lattice(self) -> growth.Lattice:
        return growth.lattice_of(self.levels, self.root_shape)

    @cached_property
    def _numbered(self) -> tuple[Nodes, int, int]:
        return growth.number_nodes(self.levels, self._lattice)

    @property
    def _nodes(self) -> Nodes:
        return self._numbered[0]

    def _planes(self, indices: npt.NDArray[Any]) -> FloatArray:
        """Return the points with given coordinates on the lattice."""
        columns = [self._coordinates(indices[:, d], d) for d in range(self.dim)]
        return read_only(np.stack(columns, axis=1))

    def _coordinates(self, index: npt.NDArray[Any], d: int) -> FloatArray:
        """Return the coordinates of lattice planes, at the ends exactly those of the box."""
        share = index / self._lattice.counts[d]
        coordinates: FloatArray = self.lower[d] * (1.0 - share) + self.upper[d] * share
        return coordinates


def as_box(lower: npt.ArrayLike, upper: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return checked copies of the corners of a box."""
    low, high = as_float_array("lower", lower).copy(), as_float_array("upper", upper).copy()
    if low.shape not in {(2,), (3,)}:
        raise ValueError(f"lower must have shape (2,) or (3,), got {low.shape}")
    if high.shape != low.shape:
        raise ValueError(f"upper must have the shape of lower, {low.shape}, got {high.shape}")
    for name, corner in (("lower", low), ("upper", high)):
        refuse_where(name, ~np.isfinite(corner), corner, "must be finite")
    refuse_where("upper", high <= low, high, f"must be greater than lower = {low.tolist()}")
    check_range("box", np.stack([low, high]))
    refuse_where("upper - lower", high - low < NEAREST, high - low, f"must be at least {NEAREST:g}")
    return low, high


def _as_root_shape(value: npt.ArrayLike, lower: FloatArray, upper: FloatArray) -> tuple[int, ...]:
    """Return the checked number of root cells along each axis."""
    shape = as_float_array("root_shape", value, lower.shape)
    refuse_where(
        "root_shape", ~((shape >= 1.0) & (shape == np.floor(shape))), shape, "must be integers >= 1"
    )
    refuse_where("root_shape", shape > 2.0**31, shape, "must be at most 2**31")
    return tuple(int(n) for n in shape)


def _refuse_level(
    name: str, level: int, lower: FloatArray, upper: FloatArray, root_shape: tuple[int, ...]
) -> None:
    """Raise a ValueError if a level is too deep for 64-bit keys or for float64."""
    most = 0
    while math.prod((n << (most + 1)) + 1 for n in root_shape) < 2**63:
        most += 1
    if level > most:
        raise ValueError(
            f"{name} must be at most {most} for {root_shape} root cells, so that nodes can be "
            f"numbered in 64 bits, got {level}"
        )
    edges = (upper - lower) / np.array(root_shape) * 2.0**-level
    rounding = np.spacing(np.maximum(np.abs(lower), np.abs(upper)))
    # Smallest edge of a cell in spacings of float64.
    if (edges < 64 * rounding).any():
        raise ValueError(
            f"{name} = {level} makes cells with edges {edges.tolist()}, too small for float64 "
            f"in the box from {lower.tolist()} to {upper.tolist()}"
        )


def _refuse_gaps(levels: npt.NDArray[np.int8], root_shape: tuple[int, ...]) -> None:
    """Raise a ValueError if consecutive leaves of these levels do not fill the box."""
    dim, depth = len(root_shape), int(levels.max())
    sizes = np.int64(1) << (dim * (depth - levels.astype(np.int64)))
    ends = np.cumsum(sizes)
    # An overflow of the sum makes an end negative.
    astray = (((ends - sizes) & (sizes - 1)) != 0) | (ends < sizes)
    refuse_where("levels", astray, levels, "must be those of leaves along the Z curve")
    whole = math.prod(root_shape) << (dim * depth)
    if int(ends[-1]) != whole:
        raise ValueError(
            f"levels must be those of leaves that fill the box, got leaves that fill "
            f"{int(ends[-1]) / whole:.6g} of it"
        )
