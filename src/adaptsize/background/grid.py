"""Cartesian grids in one, two and three dimensions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import permutations, product

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    FARTHEST,
    NEAREST,
    as_float_array,
    as_nodes,
    as_number,
    as_plain_array,
    check_function,
    check_range,
    describe,
    holds_whole_numbers,
    refusal,
    refuse_where,
)
from adaptsize._pickling import ReadOnlyState
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.grid_location import GridLocator
from adaptsize.background.simplex import SimplexMesh
from adaptsize.errors import OptionError
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

# Nodes are numbered with 32 bits.
_MOST_NODES = 2**31 - 1
# Number of points per call of a function.
_POINTS_AT_ONCE = 1_000_000


@dataclass(init=False, frozen=True, eq=False, repr=False)
class CartesianGrid(ReadOnlyState):
    """A grid of equidistant nodes along each axis; the spacing may differ between axes.

    Nodal arrays have the shape of the grid: ``values[i, j]`` belongs to the node
    ``origin + spacing * (i, j)``.  Axis 0 is x.

    Parameters
    ----------
    origin : array_like of float, shape (dim,)
        Node with the lowest coordinates; ``dim`` is 1 to 3.
    spacing : float or array_like of float, shape (dim,)
        Distance between neighbouring nodes, 1e-60 to 1e60: one number for all axes, or one
        for each.
    shape : sequence of int
        Number of nodes along each axis, at least 2.
    active : array_like of bool, of shape ``shape``, optional
        Nodes inside the domain; all nodes by default.  The other nodes are ignored: sizes do
        not propagate through them, and they are not used in interpolation.  The array is
        copied.

    Raises
    ------
    ValueError
        If a shape is wrong, a coordinate or spacing is out of range, a spacing is lost in
        the rounding of the coordinates, no node is active, or there are more than
        2**31 - 1 nodes.

    Examples
    --------
    >>> grid = CartesianGrid(origin=[0.0, 0.0], spacing=[0.5, 1.0], shape=(3, 2))
    >>> grid
    CartesianGrid(3 x 2 nodes, (0, 0) to (1, 1))
    >>> grid.points.tolist()
    [[0.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.5, 1.0], [1.0, 0.0], [1.0, 1.0]]
    >>> x, y = grid.axes
    >>> x
    array([0. , 0.5, 1. ])
    >>> grid.sample(lambda points: points[:, 0] + points[:, 1])
    array([[0. , 1. ],
           [0.5, 1.5],
           [1. , 2. ]])
    """

    origin: FloatArray
    spacing: FloatArray
    shape: tuple[int, ...]
    _: KW_ONLY
    active: BoolArray | None = None

    def __init__(
        self,
        origin: npt.ArrayLike,
        spacing: npt.ArrayLike,
        shape: Sequence[int],
        *,
        active: npt.ArrayLike | None = None,
    ) -> None:
        own_shape = _as_shape(shape)
        dim = len(own_shape)
        own_origin = as_float_array("origin", origin, (dim,)).copy()
        refuse_where("origin", ~np.isfinite(own_origin), own_origin, "must be finite")
        own_spacing = as_spacing(spacing, dim)
        upper = own_origin + own_spacing * (np.array(own_shape) - 1)
        check_range("grid", np.stack([own_origin, upper]))
        farthest = np.maximum(np.abs(own_origin), np.abs(upper))
        lost = own_spacing < 1e3 * np.finfo(float).eps * farthest
        wanted = "must be well above the rounding of the coordinates"
        refuse_where("spacing", lost, own_spacing, wanted)
        own_active = None if active is None else read_only(_as_active(active, own_shape))
        for name, value in (
            ("origin", read_only(own_origin)),
            ("spacing", read_only(own_spacing)),
            ("shape", own_shape),
            ("active", own_active),
        ):
            object.__setattr__(self, name, value)  # needed for a frozen dataclass

    @classmethod
    def around(
        cls, points: npt.ArrayLike, spacing: npt.ArrayLike, margin: float = 0.0
    ) -> CartesianGrid:
        """Return the smallest grid of a spacing that covers points, and a margin around them.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
            At least one; ``mesh.points`` for a mesh.
        spacing : float or array_like of float, shape (dim,)
            Positive, kept as given.
        margin : float, default 0
            Length by which the grid reaches beyond the points on every side, >= 0.

        Returns
        -------
        CartesianGrid
            If the box of the points is not a multiple of the spacing, the excess is equal on
            both sides.

        Raises
        ------
        ValueError
            If there is no point, a number is not finite, a spacing is not positive, the
            margin is negative, or there would be more than 2**31 - 1 nodes.

        Examples
        --------
        >>> CartesianGrid.around([[0.0, 0.0], [2.0, 1.2]], spacing=0.5, margin=1.0)
        CartesianGrid(9 x 8 nodes, (-1, -1.15) to (3, 2.35))
        """
        inside = as_nodes("points", points)
        if len(inside) == 0:
            raise ValueError("points must hold at least one point, got an empty array")
        steps = as_spacing(spacing, inside.shape[1])
        beyond = as_number("margin", margin, lower=0.0)
        lower, upper = inside.min(axis=0) - beyond, inside.max(axis=0) + beyond
        extent = upper - lower
        # No cell is added for an excess length below this share of a cell.
        n_boxes = np.maximum(np.ceil(extent / steps - 1e-9), 1.0)
        if not (n_boxes < _MOST_NODES).all():
            raise ValueError(
                f"spacing must leave at most {_MOST_NODES} nodes, got {steps} for a box of {extent}"
            )
        excess = n_boxes * steps - extent
        return cls(lower - 0.5 * excess, steps, [int(n) + 1 for n in n_boxes])

    def __repr__(self) -> str:
        """Return the number of nodes along each axis and the extent of the grid."""
        nodes = " x ".join(str(n) for n in self.shape)
        first, last = (
            ", ".join(f"{float(x):.4g}" for x in corner) for corner in (self.lower, self.upper)
        )
        some = ""
        if self.active is not None:
            some = f", {np.count_nonzero(self.active)} active"
        return f"CartesianGrid({nodes} nodes{some}, ({first}) to ({last}))"

    @property
    def dim(self) -> int:
        """Number of coordinates of a point, 1 to 3."""
        return len(self.shape)

    @property
    def n_points(self) -> int:
        """Number of nodes, active or not."""
        return math.prod(self.shape)

    @cached_property
    def n_cells(self) -> int:
        """Number of boxes; with ``active``, of those whose nodes are all active."""
        if self.active is None:
            return math.prod(n - 1 for n in self.shape)
        return int(np.count_nonzero(whole_boxes(self.active)))

    @property
    def nodal_shape(self) -> tuple[int, ...]:
        """Shape of an array of nodal values: ``shape``."""
        return self.shape

    @property
    def lower(self) -> FloatArray:
        """Lowest coordinates of the box, float64[dim]: ``origin``."""
        return self.origin

    @cached_property
    def upper(self) -> FloatArray:
        """Highest coordinates of the box, float64[dim]."""
        return read_only(self.origin + self.spacing * (np.array(self.shape) - 1))

    @cached_property
    def diagonal(self) -> float:
        """Length of the diagonal of the box."""
        return float(np.linalg.norm(self.upper - self.lower))

    @cached_property
    def axes(self) -> tuple[FloatArray, ...]:
        """Coordinates of the nodes along each axis, a tuple of ``dim`` arrays."""
        return tuple(
            read_only(start + step * np.arange(n))
            for start, step, n in zip(self.origin, self.spacing, self.shape, strict=True)
        )

    @property
    def points(self) -> FloatArray:
        """Nodes, float64[n_points, dim], in the order of ``values.ravel()``.

        The array is not cached: for a grid of 256**3 nodes it takes 400 MB.
        """
        return _points_of(*self.axes)

    @cached_property
    def locator(self) -> GridLocator:
        """Interpolation between the nodes; see `GridLocator.interpolate`."""
        return GridLocator(self)

    @cached_property
    def mesh(self) -> SimplexMesh:
        """A conforming mesh of simplices on the same nodes, numbered as in ``points``.

        Boxes are split into 2 triangles or 6 tetrahedra (Kuhn simplices), mirrored from box to
        box and positively oriented.  With ``active``, only boxes whose nodes are all active are
        split.  The mesh is cached; it takes 100 bytes per node in 3-D.

        Raises
        ------
        ValueError
            If there is no box whose nodes are all active.
        """
        cells = simplices_of_boxes(self.shape)
        if self.active is not None:
            cells = cells[whole_boxes(self.active)]
        if cells.size == 0:
            raise ValueError("active must leave at least one box with all its nodes, got none")
        return SimplexMesh(self.points, cells.reshape(-1, self.dim + 1))

    def with_active(self, active: npt.ArrayLike | None) -> CartesianGrid:
        """Return the same grid with other active nodes; None makes all nodes active."""
        return CartesianGrid(self.origin, self.spacing, self.shape, active=active)

    def sample(self, function: Callable[[FloatArray], npt.ArrayLike]) -> FloatArray:
        """Return the values of a function at the nodes, active or not.

        Parameters
        ----------
        function : callable
            Takes points, float64[n, dim], and returns n numbers.  To limit memory, it is called
            for up to a million nodes at a time.

        Returns
        -------
        ndarray of float64, of the grid's shape

        Raises
        ------
        ValueError
            If the function returns a wrong number of values.
        """
        check_function("function", function, "points")
        values = np.empty(self.shape)
        for slab, points in self.slabs():
            part = values[slab]
            given = as_float_array("function(points)", function(points), (part.size,))
            part[...] = given.reshape(part.shape)
        return values

    def slabs(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the nodes in slabs along the first axis, about a million at a time.

        Yields
        ------
        slab : slice
            ``values[slab]`` are the nodal values of the slab.
        points : ndarray of float64, shape (n, dim)
            Nodes of the slab, in the order of ``values[slab].ravel()``.
        """
        per_slab = max(1, _POINTS_AT_ONCE // math.prod(self.shape[1:]))
        for first in range(0, self.shape[0], per_slab):
            slab = slice(first, min(first + per_slab, self.shape[0]))
            yield slab, _points_of(self.axes[0][slab], *self.axes[1:])


def _points_of(*axes: FloatArray) -> FloatArray:
    """Return all combinations of coordinates, float64[n, dim], the last axis fastest."""
    mesh = np.meshgrid(*axes, indexing="ij", copy=False)
    return np.stack(mesh, axis=-1).reshape(-1, len(axes))


def _as_shape(value: Sequence[int]) -> tuple[int, ...]:
    raw = as_plain_array("shape", value)
    if raw.ndim != 1 or not 1 <= len(raw) <= 3 or not holds_whole_numbers(raw):
        raise ValueError(f"shape must be 1, 2 or 3 integers, got {describe(value)}")
    shape = tuple(int(n) for n in raw)
    refuse_where("shape", raw < 2, raw, "must be at least 2")
    if math.prod(shape) > _MOST_NODES:
        raise ValueError(f"shape must give at most {_MOST_NODES} nodes, got {shape}")
    return shape


def as_spacing(value: npt.ArrayLike, dim: int) -> FloatArray:
    """Return the checked distance of neighbouring nodes along each axis, a copy."""
    spacing = as_float_array("spacing", value)
    if spacing.ndim == 0:
        spacing = np.full(dim, spacing)
    if spacing.shape != (dim,):
        raise refusal("spacing", f"must be a number or have shape {(dim,)}, got {spacing.shape}")
    good = (spacing >= NEAREST) & (spacing <= FARTHEST)
    wanted = f"must be from {NEAREST:g} to {FARTHEST:g}"
    refuse_where("spacing", ~good, spacing, wanted, OptionError)
    return spacing.copy()


def _as_active(value: npt.ArrayLike, shape: tuple[int, ...]) -> BoolArray:
    active = np.array(as_plain_array("active", value), order="C")
    if active.dtype != np.bool_ or active.shape != shape:
        raise ValueError(
            f"active must be booleans of shape {shape}, got {active.dtype} of {active.shape}"
        )
    if not active.any():
        raise ValueError("active must mark at least one node, got none")
    return active


def simplices_of_boxes(shape: tuple[int, ...]) -> IntArray:
    """Return the Kuhn simplices of each box of a grid, mirrored from box to box.

    A Kuhn simplex follows the axes, in one of the ``dim!`` orders, from one corner of the
    box to the opposite one.  The first corner is the one with even indices.  Neighbouring boxes
    are therefore mirror images and split the face between them in the same way.

    Parameters
    ----------
    shape : tuple of int
        Nodes per axis, the last axis fastest.

    Returns
    -------
    int32[n_boxes along each axis ..., dim!, dim + 1]
        Nodes of the simplices, all of positive orientation.
    """
    dim = len(shape)
    strides = strides_of(shape)
    number = np.arange(np.prod(shape, dtype=np.int64), dtype=np.int32).reshape(shape)
    first = number[(slice(-1),) * dim]
    orders = list(permutations(range(dim)))
    cells = np.empty((*first.shape, len(orders), dim + 1), np.int32)
    for odd in product((0, 1), repeat=dim):
        boxes = tuple(slice(is_odd, None, 2) for is_odd in odd)
        start = sum(stride for stride, is_odd in zip(strides, odd, strict=True) if is_odd)
        for m, order in enumerate(orders):
            steps = [strides[d] * (1 - 2 * odd[d]) for d in order]
            path = start + np.concatenate([[0], np.cumsum(steps)]).astype(np.int32)
            is_odd_order = round(np.linalg.det(np.eye(dim)[list(order)])) < 0
            if (is_odd_order + sum(odd)) % 2 == 1:
                path[[-2, -1]] = path[[-1, -2]]
            cells[..., m, :][boxes] = first[boxes][..., None] + path
    return cells


def both_ways(finite: BoolArray, active: BoolArray | None) -> IntArray:
    """Return the triangles into which both diagonals split the whole boxes of a plane grid.

    If data are finite at exactly three corners, only the triangles of the diagonal to the fourth
    corner are returned.  The other diagonal would be a short cut for data along a line that
    turns a corner there.

    Parameters
    ----------
    finite : bool[shape]
        Nodes with data.
    active : bool[shape], optional
        Active nodes; all by default.

    Returns
    -------
    int32[m, 3]
    """
    number = np.arange(finite.size, dtype=np.int32).reshape(finite.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]]
    whole = np.ones(corners[0].shape, np.bool_) if active is None else whole_boxes(active)
    a, b, c, d = (x[whole] for x in corners)
    has = finite.ravel()
    of_three = has[a].astype(np.int8) + has[b] + has[c] + has[d] == 3
    falling = np.where(of_three, ~(has[b] & has[c]), True)
    rising = np.where(of_three, ~(has[a] & has[d]), True)
    pieces = [np.stack(t, axis=1)[falling] for t in ((a, b, c), (b, d, c))]
    pieces += [np.stack(t, axis=1)[rising] for t in ((a, b, d), (a, d, c))]
    return np.concatenate(pieces)


def span_of(marked: BoolArray) -> IndexArray:
    """Return the first and the last index with any mark along each axis, intp[dim, 2]."""
    axes = range(marked.ndim)
    along = [marked.any(axis=tuple(e for e in axes if e != d)) for d in axes]
    return np.array([np.flatnonzero(found)[[0, -1]] for found in along])


def strides_of(shape: Sequence[int]) -> tuple[int, ...]:
    """Return the difference of flat indices between neighbours along each axis."""
    return tuple(math.prod(shape[d + 1 :]) for d in range(len(shape)))


def whole_boxes(active: BoolArray) -> BoolArray:
    """Return which boxes of a grid have active corners only."""
    whole = np.ones([n - 1 for n in active.shape], np.bool_)
    for corner in product((slice(None, -1), slice(1, None)), repeat=active.ndim):
        whole &= active[corner]
    return whole
