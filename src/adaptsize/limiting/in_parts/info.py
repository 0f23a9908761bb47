"""Diagnostics of a limited size field on a mesh in parts."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.info import QUANTILES, LimitingInfo, slopes_on_mesh
from adaptsize.ranks import Communicator
from adaptsize.typing import FloatArray


@dataclass(frozen=True)
class PartsLimitingInfo:
    """Diagnostics of a limited size field on a distributed mesh.

    They are the same on all ranks.

    The attributes are those of `LimitingInfo` for the whole mesh, and equal
    those of one process, except ``iterations`` and, with fast marching, rounding.
    """

    method: str
    """The scheme that was used."""
    iterations: int
    """Number of accepted nodes (marching) or sources (exact method), summed over the ranks.

    Ranks repeat work of others, so that it depends on the partition."""
    converged: bool
    """Whether the scheme converged."""
    n_points: int
    """Number of nodes of the whole mesh."""
    n_changed: int
    """Number of nodes whose size is now below ``h0``."""
    n_free: int
    """Number of nodes whose size is inf because there is no bound in their component."""
    residual: float
    """Residual of the discrete equations, relative to the largest size; 0 for the exact method."""
    largest_edge_slope: float
    """Largest ``(h_i - h_j) / (g |x_i - x_j|)`` over all edges."""
    cell_gradient_quantiles: dict[float, float]
    """Quantiles (0.5, 0.9, 0.99, 1) of ``|grad h| / g`` over all cells with a measure."""
    n_proved: int | None
    """Number of nodes whose size is proved exact; None for other methods than ``"exact"``."""
    largest_gap: float | None
    """Largest difference between a size that is not proved exact and its lower bound.

    0 if all sizes are proved exact; None for other methods than ``"exact"``."""

    def __str__(self) -> str:
        """Say which method was used and how many sizes are below their bounds."""
        return f"{self.method}: {self.n_changed} of {self.n_points} sizes are below h0"


class Solved(NamedTuple):
    """What a method has found on one rank."""

    h: FloatArray
    iterations: int
    finished: bool = True
    n_hidden: int | None = None
    """Number of nodes of this rank, without those of other owners, that are not proved exact; None
    for other methods than the exact one."""
    largest_gap: float = 0.0
    excess: float = 0.0
    """Largest excess of a size over its update."""


def info_of(
    part: PartitionedMesh, method: str, h0: FloatArray, solved: Solved, slope: Slope
) -> PartsLimitingInfo:
    """Return the diagnostics; collective."""
    comm, own = part.ranks, part.is_owned
    h, n_hidden = solved.h, solved.n_hidden
    steepest, ratio = 0.0, np.empty(0)
    if part.mesh is not None:
        steepest, ratio = slopes_on_mesh(part.mesh, h, slope)
    counts = [
        np.count_nonzero(own & (h < h0)),
        np.count_nonzero(own & np.isinf(h)),
        solved.iterations,
        n_hidden or 0,
        len(ratio),
    ]
    n_changed, n_free, iterations, hidden, n_cells = comm.allreduce(
        np.array(counts, np.int64), "sum"
    ).tolist()
    largest = h[np.isfinite(h)].max(initial=0.0)
    figures = np.array([solved.excess, largest, steepest, solved.largest_gap, not solved.finished])
    excess, largest, steepest, gap, unfinished = comm.allreduce(figures, "max").tolist()
    levels = [0.0] * len(QUANTILES)
    if n_cells:
        levels = _order_statistics(comm, ratio, [math.ceil((n_cells - 1) * q) for q in QUANTILES])
    return PartsLimitingInfo(
        method,
        iterations,
        not unfinished,
        part.n_global_points,
        n_changed,
        n_free,
        excess / largest if excess > 0.0 else 0.0,
        steepest,
        dict(zip(QUANTILES, levels, strict=True)),
        None if n_hidden is None else part.n_global_points - hidden,
        None if n_hidden is None else gap,
    )


def info_from(info: LimitingInfo, n_points: int) -> PartsLimitingInfo:
    """Return the diagnostics of one process."""
    names = {entry.name for entry in fields(PartsLimitingInfo)} - {"n_points"}
    figures: dict[str, Any] = {name: getattr(info, name) for name in names}
    return PartsLimitingInfo(n_points=n_points, **figures)


def _order_statistics(comm: Communicator, values: FloatArray, places: list[int]) -> list[float]:
    """Return the values at places of the sorted values of all ranks; eight reductions.

    Numbers >= 0 are ordered like their bits, of which each reduction finds eight.
    """
    bits = np.sort(values).view(np.int64)
    found = np.zeros(len(places), np.int64)
    place = np.array(places)[:, None]
    for shift in range(56, -8, -8):
        digits = np.arange(1, 256 if shift < 56 else 128, dtype=np.int64) << shift
        below = comm.allreduce(np.searchsorted(bits, found[:, None] + digits), "sum")
        found += np.count_nonzero(below <= place, axis=1).astype(np.int64) << shift
    levels: list[float] = found.view(np.float64).tolist()
    return levels
