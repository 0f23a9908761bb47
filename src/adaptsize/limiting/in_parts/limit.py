"""`limit_gradient` on meshes in parts."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import STEEPEST, as_float_array, as_plain_array, one_of, warn_caller
from adaptsize.background import SimplexMesh
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.errors import ConvergenceWarning
from adaptsize.limiting.exact.scheme import UNFINISHED, Exact
from adaptsize.limiting.fast_marching import FastMarching
from adaptsize.limiting.gradient_limit import SizeTransform, Slope, resolve
from adaptsize.limiting.in_parts.exact import Settings, solve_exact
from adaptsize.limiting.in_parts.info import (
    PartsLimitingInfo,
    info_from,
    info_of,
)
from adaptsize.limiting.in_parts.marching import solve_fast_marching
from adaptsize.limiting.info import LimitingInfo
from adaptsize.limiting.problem import PointBounds, Scheme, TooManyCorners
from adaptsize.ranks import Communicator
from adaptsize.typing import FloatArray, GradientOfSize, ProgressCallback

#: `limit_gradient.with_info`.
LimitWhole = Callable[..., tuple[FloatArray, LimitingInfo]]

# Sizes at which the functions g(h) of the ranks are compared.
_PROBES = 9


class Request(NamedTuple):
    """The arguments of `limit_gradient` on one rank, checked except for g."""

    scheme: Scheme | None
    """None for "auto"."""
    h0: FloatArray
    g: Any
    point_sources: PointBounds | None


class _Summary(NamedTuple):
    """The request of one rank in a few numbers, to be compared with those of other ranks."""

    least: float
    largest: float
    varies: bool
    in_cells: bool
    """Whether g is surely an array of the cells; on some parts, nodes are as many."""
    g: float | None
    method: str
    point_sources: str
    with_info: bool
    depends_on_size: bool


class _Limit(NamedTuple):
    """The gradient limit: of the cells, and as a function of the size."""

    slope: Slope
    of_size: GradientOfSize | None
    in_space: npt.ArrayLike


def limit_in_parts(
    part: PartitionedMesh,
    check: Callable[[], Request],
    limit_whole: LimitWhole,
    report: ProgressCallback,
    wants_info: bool,
) -> tuple[FloatArray, PartsLimitingInfo | None]:
    """Return the sizes of `limit_gradient`, and the info if it is wanted; collective.

    ``check`` returns the request of this rank.  ``limit_whole`` solves meshes that are collected.
    """
    comm = part.ranks
    request, limit, own = comm.agree(lambda: _summarized(part, check(), wants_info))
    every: list[_Summary] = comm.allgather(own)
    least = min(summary.least for summary in every)
    _refuse_differing(part, request, every)
    if any(summary.in_cells for summary in every) and np.shape(limit.in_space) == (part.n_cells,):
        values = as_float_array("g", limit.in_space)
        limit = limit._replace(slope=Slope(np.where(values < 1.0 / STEEPEST, 0.0, values)))
    varies, is_flat = any(summary.varies for summary in every), part.cell_dim == part.dim
    scheme = request.scheme
    if scheme is None:
        scheme = Exact() if is_flat and not varies else FastMarching()
    bound, extra = request.h0, request.point_sources
    if extra is not None and not isinstance(scheme, Exact):
        raise ValueError(f"point_sources is for method='exact', got method={scheme.name!r}")
    if isinstance(scheme, Exact) and (varies or not is_flat):
        raise ValueError("method='exact' needs a flat domain of full dimension and one number g")
    g = next((summary.g for summary in every if summary.g is not None), 0.0)
    transform, of_size = None, limit.of_size
    if of_size is not None:
        ends = least, max(summary.largest for summary in every)
        _refuse_other_functions(comm, of_size, ends)
        transform = comm.agree(lambda: SizeTransform(of_size, *ends))
    u0, at_points = bound, extra
    if transform is not None:
        u0 = transform.forward(bound)
        if extra is not None:
            at_points = extra._replace(sizes=transform.forward(extra.sizes))
    if isinstance(scheme, Exact):
        threads = 1 if scheme.threads is None and comm.size > 1 else scheme.threads
        price = request.scheme is not None or extra is not None
        settings = Settings(g, scheme.face_sources, threads, report, at_points, price)
        try:
            solved = solve_exact(part, u0, settings)
        except TooManyCorners:  # on all ranks
            scheme = FastMarching()
    if isinstance(scheme, FastMarching):
        solved = solve_fast_marching(part, u0, limit.slope, report, residual=wants_info)
    if solved is None:
        per_cell = np.broadcast_to(limit.slope.values, part.n_cells) if varies else None
        in_space = g if per_cell is None else part.gather_cells(per_cell)
        given = request._replace(g=in_space if of_size is None else (in_space, of_size))
        return _collected(part, given, limit_whole, wants_info)
    if not comm.allreduce(int(solved.finished), "min") and comm.rank == 0:
        warn_caller(UNFINISHED, ConvergenceWarning)
    u = solved.h
    h = u if transform is None else comm.agree(lambda: transform.backward(u))
    info = info_of(part, scheme.name, u0, solved, limit.slope) if wants_info else None
    return np.minimum(h, bound), info


def _refuse_differing(part: PartitionedMesh, request: Request, every: list[_Summary]) -> None:
    """Raise a ValueError on all ranks if the requests do not fit together; collective."""
    if min(summary.least for summary in every) == np.inf:
        raise ValueError("h0 must be finite at one node at least, got inf at all of them")
    names = {"g": "g", "depends_on_size": "g"}
    names |= {name: name for name in ("method", "point_sources", "with_info")}
    for attribute, name in names.items():
        if len({getattr(summary, attribute) for summary in every} - {None}) > 1:
            raise ValueError(f"{name} must be the same on all ranks")
    part.require_equal_values("h0", request.h0)


def _refuse_other_functions(
    comm: Communicator, of_size: GradientOfSize, ends: tuple[float, float]
) -> None:
    """Raise a ValueError on all ranks if the functions g(h) differ between the given sizes."""
    sizes = np.geomspace(*ends, _PROBES)
    found = comm.agree(lambda: np.broadcast_to(np.asarray(of_size(sizes)), sizes.shape))
    comm.require_equal(**{"g(h)": [f"{value:.12g}" for value in found]})


def _summarized(
    part: PartitionedMesh, request: Request, wants_info: bool
) -> tuple[Request, _Limit, _Summary]:
    """Return the request, its gradient limit, and the summary."""
    scheme, g, extra = request.scheme, request.g, request.point_sources
    if isinstance(scheme, FastMarching) and scheme.order != 1:
        raise ValueError(f"method='fast-marching' must have order=1 in parts, got {scheme.order}")
    if scheme is not None and not isinstance(scheme, Exact | FastMarching):
        one_of("method", scheme.name, ("auto", "exact", "fast-marching"))
    in_space, of_size = g, None
    if isinstance(g, tuple | list) and len(g) == 2 and callable(g[1]):
        in_space, of_size = g
    elif callable(g):
        in_space, of_size = 1.0, g
    slope = Slope(np.array([1.0]))
    is_array = as_plain_array("g", in_space).ndim > 0
    if part.mesh is not None:
        slope = resolve(part.mesh, in_space, request.h0)[0]
    number = float(slope.values[0]) if part.mesh is not None and not is_array else None
    finite, words = request.h0, b""
    if extra is not None:
        finite = np.concatenate([finite, extra.sizes])
        words = extra.points.tobytes() + extra.sizes.tobytes()
    finite = finite[np.isfinite(finite)]
    summary = _Summary(
        float(finite.min(initial=np.inf)),
        float(finite.max(initial=0.0)),
        is_array,
        np.shape(in_space) == (part.n_cells,) and part.n_cells != part.n_points,
        number,
        repr(scheme),
        sha256(words).hexdigest(),
        wants_info,
        of_size is not None,
    )
    return request, _Limit(slope, of_size, in_space), summary


def _collected(
    part: PartitionedMesh, request: Request, limit_whole: LimitWhole, wants_info: bool
) -> tuple[FloatArray, PartsLimitingInfo | None]:
    """Return the sizes, and the info if it is wanted, that rank 0 computes on the whole mesh."""
    bounds, made = part.gather_nodal(request.h0), []

    def solve(whole: SimplexMesh) -> FloatArray:
        method = "auto" if request.scheme is None else request.scheme
        extra = request.point_sources
        h, info = limit_whole(whole, bounds, request.g, method=method, point_sources=extra)
        made.append(info_from(info, part.n_global_points) if wants_info else None)
        return h

    own = part.on_whole(solve)
    return own, part.ranks.bcast(made[0] if made else None)
