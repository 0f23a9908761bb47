"""`limit_gradient` on distributed meshes."""

from __future__ import annotations

import warnings
from dataclasses import replace
from hashlib import sha256
from typing import Any, Literal, NamedTuple, overload

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, as_float_array, as_plain_array, as_sizes, check_type, one_of
from adaptsize._progress import reporting
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.errors import ConvergenceWarning
from adaptsize.limiting.exact.scheme import UNFINISHED, Exact
from adaptsize.limiting.fast_marching import FastMarching
from adaptsize.limiting.gradient_limit import SizeTransform, Slope, resolve
from adaptsize.limiting.in_parts.exact import Given, solve_exact
from adaptsize.limiting.in_parts.info import (
    PartsLimitingInfo,
    Solved,
    Traced,
    info_from,
    info_of,
    scattered,
    traced_from,
)
from adaptsize.limiting.in_parts.marching import solve_fast_marching
from adaptsize.limiting.limit import as_point_bounds, as_scheme
from adaptsize.limiting.problem import PointBounds, Scheme
from adaptsize.typing import FloatArray, GradientLimit, GradientOfSize, ProgressCallback

_NAMES = ("auto", "exact", "fast-marching")


class _Limit(NamedTuple):
    """Facts about the bounds and g on one rank, to be compared with those of other ranks."""

    least: float
    largest: float
    varies: bool
    number: float | None
    method: str
    point_sources: str
    full_output: bool


@overload
def limit_gradient(
    part: PartitionedMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: Scheme | str = ...,
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None = ...,
    full_output: Literal[False] = ...,
    progress: ProgressCallback | bool | None = ...,
) -> FloatArray: ...
@overload
def limit_gradient(
    part: PartitionedMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: Scheme | str = ...,
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None = ...,
    full_output: Literal[True],
    progress: ProgressCallback | bool | None = ...,
) -> tuple[FloatArray, PartsLimitingInfo]: ...
def limit_gradient(
    part: PartitionedMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: Scheme | str = "auto",
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    full_output: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray | tuple[FloatArray, PartsLimitingInfo]:
    """Return the largest sizes below ``h0`` whose gradient is at most ``g``; collective.

    The result is that of `adaptsize.limit_gradient` on the whole mesh, for any partition: equal
    bit by bit with the exact method, and to 1e-12 with fast marching.

    Parameters
    ----------
    part : PartitionedMesh
        Ranks without cells, and ranks without any finite bound, are allowed.
    h0 : float or array_like of float, shape (n_local,)
        Upper bounds at the nodes of this rank.  Ranks that share a node must give it the same
        bound; `PartitionedMesh.minimum` makes them agree.
    g : float, array_like, callable, or tuple (array_like, callable)
        As for `adaptsize.limit_gradient`.  Arrays have one entry per local node or cell.  A
        function must be the same on all ranks.
    method : {"auto", "exact", "fast-marching"} or scheme, optional
        Or `limiting.Exact`, `limiting.FastMarching`.  By name, each rank uses one thread.
    point_sources : tuple of (array_like, array_like), optional
        As for `adaptsize.limit_gradient`; the same on all ranks.
    full_output : bool, optional
        Whether to return a `PartsLimitingInfo` too, for ten more reductions.  The exact method
        then also exchanges the numbers of nodes, for ``info.sources``.
    progress : callable or bool, optional
        Progress of this rank.

    Returns
    -------
    h : ndarray of float64, shape (n_local,)
        Ranks that share a node get the same size.
    info : PartsLimitingInfo
        Returned only with ``full_output``; the same on all ranks, except ``sources``.

    Raises
    ------
    ValueError
        On all ranks, if the input of any rank is bad.  The message names the rank.

    Warns
    -----
    ConvergenceWarning
        On rank 0, as in one process.

    Notes
    -----
    In convex domains and in the plane, the exact method takes one exchange between the ranks,
    besides reductions of a few numbers, once the boundary of the mesh is known; the first call
    for a mesh finds it.  Each rank holds the whole boundary, which is small compared with the
    mesh.  In solids that are not convex, sizes are also exchanged in a few rounds.  Fast marching
    exchanges sizes between neighbours in rounds.  See docs/distributed.md.

    Meshes that have cells without measure, or cells that overlap, are collected on rank 0 by the
    exact method, and solved there.

    There is no warm start (``initial``), because a rank would have to keep two solutions: that of
    its own sources, which decides what it receives, and that of all.  What it receives depends on
    the sizes of all ranks, and each change of a bound may change it.  In one process, a warm start
    saves half to three quarters of the time.

    Examples
    --------
    >>> import numpy as np
    >>> from adaptsize import SimplexMesh
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> part = PartitionedMesh.from_serial(square)
    >>> limit_gradient(part, np.where(part.global_ids == 1, 0.1, np.inf), 0.3).round(3)
    array([0.4  , 0.1  , 0.4  , 0.524])
    """
    check_type("part", part, PartitionedMesh)
    comm = part.ranks
    given = (method, point_sources, full_output)
    bound, slope, limit, extra, facts = comm.agree(lambda: _checked(part, h0, g, *given))
    every: list[_Limit] = comm.allgather(facts)
    least = min(limit.least for limit in every)
    if least == np.inf:
        raise ValueError("h0 must be finite at one node at least, got inf at all of them")
    for name in ("number", "method", "point_sources", "full_output"):
        if len({getattr(limit, name) for limit in every} - {None}) > 1:
            what = "g" if name == "number" else name
            raise ValueError(f"{what} must be the same on all ranks")
    varies = any(limit.varies for limit in every)
    is_flat = part.cell_dim == part.dim
    if method == "auto":
        method = "exact" if is_flat and not varies else "fast-marching"
    scheme = Exact(threads=1) if method == "exact" else as_scheme(method)
    assert scheme is not None
    if extra is not None and not isinstance(scheme, Exact):
        raise ValueError(f"point_sources is for method='exact', got method={scheme.name!r}")
    if isinstance(scheme, Exact) and (varies or not is_flat):
        raise ValueError("method='exact' needs a flat domain of full dimension and one number g")
    number = next((own.number for own in every if own.number is not None), 0.0)
    transform = None
    if limit is not None:
        finite = np.array([least, max(limit.largest for limit in every)])
        transform = comm.agree(lambda: SizeTransform(limit, *finite.tolist()))
    u0, at_points = bound, extra
    if transform is not None:
        u0 = transform.forward(bound)
        if extra is not None:
            at_points = extra._replace(sizes=transform.forward(extra.sizes))
    with reporting(progress) as report:
        solved: Solved | None
        if isinstance(scheme, Exact):
            own = (scheme.face_sources, scheme.threads, report, at_points, full_output)
            solved = solve_exact(part, u0, Given(number, *own))
        else:
            solved = solve_fast_marching(part, u0, slope, report, residual=full_output)
        if solved is None:
            serial: dict[str, Any] = {"method": scheme}
            if isinstance(scheme, Exact):
                serial["point_sources"] = None if extra is None else tuple(extra)
            per_cell = np.broadcast_to(slope.values, part.n_cells) if varies else None
            return _collected(part, bound, (per_cell, limit, number), serial, full_output)
    if not comm.allreduce(int(solved.finished), "min") and comm.rank == 0:
        warnings.warn(UNFINISHED, ConvergenceWarning, stacklevel=2)
    u = solved.h
    h = u if transform is None else comm.agree(lambda: transform.backward(u))
    h = np.minimum(h, bound)
    return (h, info_of(part, scheme.name, u0, solved, slope)) if full_output else h


def _checked(
    part: PartitionedMesh,
    h0: npt.ArrayLike,
    g: Any,
    method: Scheme | str,
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    full_output: bool,
) -> tuple[FloatArray, Slope, GradientOfSize | None, PointBounds | None, _Limit]:
    """Return the checked bounds, slopes, g(h) and points if given, and facts about them."""
    if not isinstance(method, Exact | FastMarching) or getattr(method, "order", 1) == 2:
        one_of("method", method.name if isinstance(method, Scheme) else method, _NAMES)
    extra = None if point_sources is None else as_point_bounds(point_sources, part.dim)
    name = method.name if isinstance(method, Scheme) else method
    if extra is not None and name == "fast-marching":
        raise ValueError(f"point_sources is for method='exact', got method={name!r}")
    as_flag("full_output", full_output)
    given = as_float_array("h0", h0)
    if given.ndim == 0:
        given = np.full(part.n_points, float(given))
    bound = as_sizes("h0", given, part.nodal_shape)
    in_space, limit = g, None
    if isinstance(g, tuple | list) and len(g) == 2 and callable(g[1]):
        in_space, limit = g
    elif callable(g):
        in_space, limit = 1.0, g
    slope = Slope(np.array([1.0]))
    is_array = as_plain_array("g", in_space).ndim > 0
    if part.mesh is not None:
        slope = resolve(part.mesh, in_space, bound)[0]
    number = float(slope.values[0]) if part.mesh is not None and not is_array else None
    finite, words = bound, b""
    if extra is not None:
        finite = np.concatenate([bound, extra.sizes])
        words = extra.points.tobytes() + extra.sizes.tobytes()
    finite = finite[np.isfinite(finite)]
    facts = _Limit(
        float(finite.min(initial=np.inf)),
        float(finite.max(initial=0.0)),
        is_array,
        number,
        repr(method),
        sha256(words).hexdigest(),
        full_output,
    )
    return bound, slope, limit, extra, facts


def _collected(
    part: PartitionedMesh,
    h0: FloatArray,
    g: tuple[FloatArray | None, GradientOfSize | None, float],
    options: dict[str, Any],
    full_output: bool,
) -> FloatArray | tuple[FloatArray, PartsLimitingInfo]:
    """Return the sizes, and the info if asked for, that rank 0 computes on the whole mesh.

    ``g`` are the limits of the cells, a function of the size, and one number; the first two None
    if they are not given.
    """
    whole, bounds = part.gather(), part.gather_nodal(h0)
    per_cell, of_size, number = g
    in_space = number if per_cell is None else part.gather_cells(per_cell)

    def solve() -> tuple[FloatArray | None, PartsLimitingInfo | None, Traced | None]:
        if whole is None or bounds is None:
            return None, None, None
        limit: Any = in_space if of_size is None else (in_space, of_size)
        from adaptsize.limiting import limit_gradient as limit_whole

        h, info = limit_whole.with_info(whole, bounds, limit, **options)
        if not full_output:
            return h, None, None
        traced = None if info.sources is None else traced_from(info.sources)
        return h, info_from(info, part.n_global_points), traced

    sizes, info, traced = part.ranks.agree(solve)
    own = part.scatter_nodal(sizes)
    if not full_output:
        return own
    info, is_traced = part.ranks.bcast((info, traced is not None))
    assert info is not None  # that of rank 0
    return own, replace(info, sources=scattered(part, traced)) if is_traced else info
