"""`PartitionedMesh`: the part of a mesh on this rank, and how the parts fit together."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import KW_ONLY, dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_plain_array, check_type, of_type
from adaptsize._pickling import once
from adaptsize.background.partitioning import joined, parts_of
from adaptsize.background.simplex import SimplexMesh
from adaptsize.ranks import Communicator, Ids, SharedNodes, as_communicator, find_shared_nodes, kept
from adaptsize.typing import BoolArray, FloatArray, IntArray

T = TypeVar("T")

# Relative deviation of values at shared nodes from which on they are different.
_ROUNDING = 1e-9


@dataclass(init=False, frozen=True, eq=False, repr=False)
class PartitionedMesh:
    """A mesh whose cells are distributed over the ranks of a communicator.

    Each cell is on one rank.  Each rank also holds all nodes of its cells, so that nodes between
    parts are on several ranks.  One of them owns the node.  All methods and properties are local
    unless they are said to be collective; collective ones must be called on all ranks.

    Parameters
    ----------
    mesh : SimplexMesh or None
        The cells of this rank and their nodes; None on a rank without cells.
    global_ids : array_like of int, shape (n_local,)
        The number of each local node in the whole mesh.  All numbers from 0 to the number of
        nodes minus 1 must occur.
    owner : array_like of int, shape (n_local,)
        The rank that owns each local node.
    comm : communicator, optional
        A communicator of mpi4py, or a `Communicator`; None for a single process.
    cell_ids : array_like of int, shape (n_cells,), optional
        The number of each local cell in the whole mesh.  By default, cells are numbered rank by
        rank.

    Raises
    ------
    ValueError
        On all ranks, if arguments are inconsistent on any rank.  The message names the rank.

    Notes
    -----
    The constructor is collective.  Its three small reductions are the only communication.

    ``mesh`` is an ordinary mesh: functions that get it in place of the part treat it as a whole
    one, on this rank alone.  If the others call the same function with their parts, they wait for
    this rank without end.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> part = PartitionedMesh.from_serial(square)
    >>> part
    PartitionedMesh(rank 0 of 1: 2 of 2 cells, 4 of 4 points)
    """

    mesh: SimplexMesh | None
    global_ids: Ids
    owner: IntArray
    ranks: Communicator
    _: KW_ONLY
    cell_ids: Ids
    dim: int
    """Number of coordinates of a point."""
    cell_dim: int
    """Dimension of the cells."""
    n_global_points: int
    """Number of nodes of the whole mesh."""
    n_global_cells: int
    """Number of cells of the whole mesh."""
    original: SimplexMesh | None = None
    """The boundary of the first mesh of the adaptive loop that has made this one, in space."""

    def __init__(
        self,
        mesh: SimplexMesh | None,
        global_ids: npt.ArrayLike,
        owner: npt.ArrayLike,
        comm: object = None,
        *,
        cell_ids: npt.ArrayLike | None = None,
    ) -> None:
        ranks = as_communicator(comm)
        checked = ranks.agree(lambda: _checked(ranks, mesh, global_ids, owner, cell_ids))
        ids, owners, numbers = checked
        n_cells = 0 if mesh is None else mesh.n_cells
        kind = None if mesh is None else (mesh.dim, mesh.cell_dim)
        n_owned = int(np.count_nonzero(owners == ranks.rank))
        every = ranks.allgather((kind, n_cells, n_owned, int(ids.max(initial=-1))))
        kinds = {own[0] for own in every if own[0] is not None}
        n_points = sum(own[2] for own in every)
        if len(kinds) != 1:
            raise ValueError(f"the parts must have cells of one kind, got (dim, cell_dim) {kinds}")
        if n_points != max(own[3] for own in every) + 1:
            raise ValueError(
                "global_ids must be all numbers from 0 to the number of nodes minus 1, each "
                f"with one owner: {n_points} nodes have an owner, the largest number is "
                f"{max(own[3] for own in every)}"
            )
        dim, cell_dim = kinds.pop()
        if numbers is None:
            numbers = np.arange(n_cells) + sum(own[1] for own in every[: ranks.rank])
        values = {
            "mesh": mesh,
            "global_ids": ids,
            "owner": owners,
            "ranks": ranks,
            "cell_ids": numbers,
            "dim": dim,
            "cell_dim": cell_dim,
            "n_global_points": n_points,
            "n_global_cells": sum(own[1] for own in every),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)  # needed for a frozen dataclass

    def __repr__(self) -> str:
        """Return the rank and the numbers of cells and points."""
        return (
            f"PartitionedMesh(rank {self.ranks.rank} of {self.ranks.size}: {self.n_cells} of "
            f"{self.n_global_cells} cells, {self.n_points} of {self.n_global_points} points)"
        )

    @classmethod
    def from_serial(
        cls, mesh: SimplexMesh | None, parts: npt.ArrayLike | None = None, comm: object = None
    ) -> PartitionedMesh:
        """Distribute a mesh that is on rank 0; collective.

        Parameters
        ----------
        mesh : SimplexMesh
            The whole mesh.  Only that of rank 0 is used; other ranks may pass None.
        parts : int or array_like of int, shape (n_cells,), optional
            Number of parts, or the rank of each cell; by default one part per rank.  Only the
            value on rank 0 is used.
        comm : communicator, optional

        Returns
        -------
        PartitionedMesh
            Local nodes and cells are in the order of the whole mesh.  A node is owned by the
            lowest rank that holds it; nodes in no cell are on the first rank with cells.
        """
        ranks = as_communicator(comm)
        if ranks.size == 1 and parts is None:
            mesh = of_type("mesh", mesh, SimplexMesh)
            return cls(mesh, np.arange(mesh.n_points), np.zeros(mesh.n_points, np.int32), ranks)
        pieces: list[Any] = ranks.agree(
            lambda: [None] * ranks.size if ranks.rank else parts_of(mesh, parts, ranks.size)
        )
        own = ranks.alltoall(pieces)[0]
        return cls(own.mesh, own.global_ids, own.owner, ranks, cell_ids=own.cell_ids)

    @property
    def n_points(self) -> int:
        """Number of nodes on this rank."""
        return len(self.global_ids)

    @property
    def n_cells(self) -> int:
        """Number of cells on this rank."""
        return 0 if self.mesh is None else self.mesh.n_cells

    @property
    def nodal_shape(self) -> tuple[int, ...]:
        """Shape of an array of nodal values on this rank."""
        return (self.n_points,)

    @property
    def points(self) -> FloatArray:
        """Coordinates of the nodes on this rank."""
        return np.empty((0, self.dim)) if self.mesh is None else self.mesh.points

    @property
    def cells(self) -> IntArray:
        """Cells of this rank, as local nodes."""
        none = np.empty((0, self.cell_dim + 1), np.int32)
        return none if self.mesh is None else self.mesh.cells

    @property
    def in_a_cell(self) -> BoolArray:
        """Which nodes belong to a cell of this rank."""
        return np.empty(0, np.bool_) if self.mesh is None else self.mesh.in_a_cell

    @property
    def measures(self) -> FloatArray:
        """Length, area or volume of each cell of this rank."""
        return np.empty(0) if self.mesh is None else self.mesh.measures

    @kept
    def diagonal(self) -> float:
        """Diagonal of the box around all cells of the whole mesh; collective on first use."""
        used = self.points[np.unique(self.cells)]
        low, high = used.min(axis=0, initial=np.inf), used.max(axis=0, initial=-np.inf)
        ends = self.ranks.allreduce(np.concatenate([low, -high]), "min")
        return float(np.linalg.norm(ends[self.dim :] + ends[: self.dim]))

    @property
    def is_owned(self) -> BoolArray:
        """Whether this rank owns each of its nodes."""
        return np.asarray(self.owner == self.ranks.rank)

    @kept
    def shared(self) -> SharedNodes:
        """The nodes that other ranks hold too; collective on first use."""
        return find_shared_nodes(self.ranks, self.global_ids, self.owner)

    def with_original(self, original: SimplexMesh | None) -> PartitionedMesh:
        """Return the same part with another first boundary of its loop."""
        new = copy(self)
        object.__setattr__(new, "original", original)  # needed for a frozen dataclass
        return new

    def once(self, name: str, compute: Callable[[], T]) -> T:
        """Return a value that is computed on first use and kept; collective if ``compute`` is."""
        return once(self, name, compute)

    def exchange(self, values: npt.ArrayLike) -> FloatArray:
        """Return nodal values, those of shared nodes as on their owners; collective."""
        own = self._nodal(values)
        held = own.copy()
        held[~self.is_owned] = 0.0
        return self.shared.merge(held, np.add)

    def sum(self, values: npt.ArrayLike) -> FloatArray:
        """Return nodal values, summed over the ranks that hold the node; collective."""
        return self.shared.merge(self._nodal(values), np.add)

    def minimum(self, values: npt.ArrayLike) -> FloatArray:
        """Return the smallest of the values that ranks have at each node; collective."""
        return self.shared.merge(self._nodal(values), np.minimum)

    def maximum(self, values: npt.ArrayLike) -> FloatArray:
        """Return the largest of the values that ranks have at each node; collective."""
        return self.shared.merge(self._nodal(values), np.maximum)

    def gather(self) -> SimplexMesh | None:
        """Return the whole mesh on rank 0, None on other ranks; collective."""
        pieces = self._to_first((self.mesh, self.global_ids, self.cell_ids))
        return None if pieces is None else joined(pieces)

    def gather_nodal(self, values: npt.ArrayLike) -> FloatArray | None:
        """Return the nodal values of the whole mesh on rank 0, None elsewhere; collective.

        Values at shared nodes are those of the owner.  Complex ones stay complex.
        """
        own = self._nodal(values)
        owned = self.is_owned
        pieces = self._to_first((self.global_ids[owned], own[owned]))
        if pieces is None:
            return None
        whole = np.empty((self.n_global_points, *own.shape[1:]), own.dtype)
        for ids, part in pieces:
            whole[ids] = part
        return whole

    def gather_cells(self, values: npt.ArrayLike) -> FloatArray | None:
        """Return the values of all cells of the mesh on rank 0, None elsewhere; collective."""
        own = _rows("values", values, self.n_cells)
        pieces = self._to_first((self.cell_ids, own))
        if pieces is None:
            return None
        order = np.argsort(np.concatenate([ids for ids, _ in pieces]), kind="stable")
        whole: FloatArray = np.concatenate([part for _, part in pieces])[order]
        return whole

    def scatter_nodal(self, values: npt.ArrayLike | None) -> FloatArray:
        """Return the local part of nodal values of the whole mesh on rank 0; collective."""
        wanted = self._to_first(self.global_ids)
        pieces: list[Any] = [None] * self.ranks.size

        def split() -> list[Any]:
            if wanted is None:
                return pieces
            whole = _rows("values", values, self.n_global_points)  # type: ignore[arg-type]
            return [whole[ids] for ids in wanted]

        own: FloatArray = self.ranks.alltoall(self.ranks.agree(split))[0]
        return own

    def require_equal_values(self, name: str, values: FloatArray) -> None:
        """Raise a ValueError on all ranks if shared nodes have other values on other ranks.

        One reduction.  With weights that depend on the node, its owner adds the value as often as
        others subtract it.  Deviations below 1e-9 of the sum of all shared values are rounding.
        """
        nodes = self.shared.every
        if self.ranks.size == 1:
            return
        others = np.bincount(np.concatenate(self.shared.nodes), minlength=self.n_points)[nodes]
        count = np.where(self.is_owned[nodes], others, -1.0)
        mixed = self.global_ids[nodes].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        weights = 0.5 + (mixed >> np.uint64(11)) * 2.0**-53
        finite = np.isfinite(values[nodes])
        own = np.where(finite, values[nodes], 0.0)
        # Not ``weights @ ...``: for long vectors that wakes the threads of BLAS, which wait busily.
        terms = weights * np.array([count * own, count * ~finite, np.abs(count * own)])
        sums = terms.sum(axis=1)
        balance, of_inf, scale = self.ranks.allreduce(sums, "sum").tolist()
        if abs(balance) <= _ROUNDING * scale and abs(of_inf) < _ROUNDING * self.n_global_points:
            return
        low, high = (self.shared.merge(values, merge) for merge in (np.minimum, np.maximum))

        differ = np.flatnonzero(high > low)
        text = ""
        if len(differ):
            i = differ[0]
            text = f"{low[i]} and {high[i]} at global node {self.global_ids[i]}"
        found = next(filter(None, self.ranks.allgather(text)), "others")
        raise ValueError(f"{name} must be the same on all ranks that hold a node, got {found}")

    def on_whole(self, function: Callable[[SimplexMesh], FloatArray]) -> FloatArray:
        """Return nodal values that rank 0 computes on the whole mesh; collective."""
        whole = self.gather()
        return self.scatter_nodal(
            self.ranks.agree(lambda: None if whole is None else function(whole))
        )

    def _to_first(self, value: Any) -> list[Any] | None:
        """Return the values of all ranks on rank 0."""
        received = self.ranks.alltoall([value] + [None] * (self.ranks.size - 1))
        return received if self.ranks.rank == 0 else None

    def _nodal(self, values: npt.ArrayLike) -> FloatArray:
        """Return nodal values as an array with one row per local node."""
        return _rows("values", values, self.n_points)


#: A whole mesh, or the part of it on this rank.
AnyMesh: TypeAlias = SimplexMesh | PartitionedMesh


def local_mesh(mesh: AnyMesh) -> SimplexMesh | None:
    """Return the cells of this rank as a mesh: all of them on a single rank."""
    return mesh if isinstance(mesh, SimplexMesh) else mesh.mesh


def _checked(
    comm: Communicator,
    mesh: SimplexMesh | None,
    global_ids: npt.ArrayLike,
    owner: npt.ArrayLike,
    cell_ids: npt.ArrayLike | None,
) -> tuple[Ids, IntArray, Ids | None]:
    """Return checked local arrays."""
    if mesh is not None:
        check_type("mesh", mesh, SimplexMesh)
    n, m = (0, 0) if mesh is None else (mesh.n_points, mesh.n_cells)
    ids = _whole("global_ids", global_ids, n)
    if len(np.unique(ids)) != n:
        raise ValueError("global_ids must not repeat a number on one rank")
    owners = _whole("owner", owner, n).astype(np.int32)
    if n and owners.max() >= comm.size:
        raise ValueError(f"owner must be a rank from 0 to {comm.size - 1}, got {owners.max()}")
    return ids, owners, None if cell_ids is None else _whole("cell_ids", cell_ids, m)


def _rows(name: str, values: npt.ArrayLike, n: int) -> npt.NDArray[Any]:
    """Return n rows of numbers, float64 or complex128."""
    given = as_plain_array(name, values)
    own = given.astype(np.complex128) if given.dtype.kind == "c" else as_float_array(name, values)
    if own.ndim == 0 or len(own) != n:
        raise ValueError(f"{name} must have {n} rows, got shape {own.shape}")
    return own


def _whole(name: str, value: npt.ArrayLike, n: int) -> Ids:
    """Return n numbers >= 0, read-only."""
    given = np.asarray(value)
    if given.shape != (n,) or (n and given.dtype.kind not in "iu") or (n and given.min() < 0):
        raise ValueError(
            f"{name} must be {n} integers >= 0, got {given.dtype} of shape {given.shape}"
        )
    own = given.astype(np.int64)
    own.flags.writeable = False
    return own
