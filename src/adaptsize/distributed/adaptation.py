"""`adapt`: one cycle of an adaptive loop on a distributed mesh."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, as_number, as_tolerance, check_type, one_of
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize._progress import reporting
from adaptsize.adaptation._fields import as_fields
from adaptsize.adaptation.new_mesh import BestMesh, meet_target
from adaptsize.adaptation.next_sizes import (
    BoundLike,
    Decision,
    NextSizes,
    SizeRequest,
    as_bound,
    check_goal,
    decide,
    next_sizes,
    refuse_two_targets,
)
from adaptsize.adaptation.transfer import transfer_fields
from adaptsize.adaptation.transfer_in_parts import TransferredFields
from adaptsize.background import interpolate
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.report import AdaptedParts, PartsReport
from adaptsize.distributed.whole import (
    boundary_distance,
    compare_with,
    lost_tags,
    total_measure,
)
from adaptsize.errors import ResolutionWarning
from adaptsize.limiting.in_parts.limit import limit_gradient
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.remeshing.driver import remesh
from adaptsize.remeshing.in_parts import interface_quality
from adaptsize.sizes.budget import calibration, cells_for_nodes
from adaptsize.sizes.curvature import size_from_curvature, size_of_chords
from adaptsize.sizes.error import as_indicator
from adaptsize.typing import FloatArray, GradientLimit, ProgressCallback

Fields = Mapping[str, npt.ArrayLike]


def adapt(
    part: PartitionedMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    order: float = 1,
    h0: BoundLike | None = None,
    target_elements: float | None = None,
    target_nodes: float | None = None,
    tolerance: float | None = None,
    g: GradientLimit | Literal["auto"] | None = "auto",
    hmin: float | None = None,
    hmax: float | None = None,
    max_refine: float = 4.0,
    max_coarsen: float = 2.0,
    how: Literal["parts", "gather"] = "parts",
    rounds: int = 2,
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    conservative: bool = True,
    enough: float = 0.85,
    coarsen_converged: bool = False,
    boundary_tolerance: float = 1e-3,
    max_elements: float = 5_000_000,
    timeout: float | None = 3600.0,
    progress: ProgressCallback | bool | None = None,
) -> AdaptedParts:
    """Return the next mesh of an adaptive loop, with fields on it; collective.

    This is `adaptsize.adapt` for a distributed mesh of triangles in the plane or of tetrahedra.
    The sizes, and the decision whether to remesh, are those for the whole mesh, for any partition.

    Parameters
    ----------
    part : PartitionedMesh
    indicator : array_like of float, shape (n_cells,), optional
        Error of each cell of this rank.  The total error is the root of the sum of squares over
        all ranks.
    h0 : SizeFunction, callable, array_like of float, shape (n_local,), or float, optional
        Upper bounds at the nodes of this rank.  Ranks that share a node must give it the same
        bound.
    order, target_elements, target_nodes, tolerance, g, hmin, hmax, max_refine, max_coarsen
        As for `adaptsize.adapt`.  Elements, nodes and errors are those of the whole mesh.
    how, rounds
        As for `adaptsize.remesh`.
    fields, cell_fields : mapping of str to array_like, optional
        Fields at the local nodes and cells; of the same names on all ranks.
    conservative : bool, default True
        See `transfer_fields`.
    enough, coarsen_converged
        As for `adaptsize.adapt`.
    boundary_tolerance, max_elements, timeout
        As ``tolerance``, ``max_elements`` and ``timeout`` of `remesh`.
    progress : callable, bool or None
        Only that of rank 0 is used.

    Returns
    -------
    AdaptedParts
        ``part``, ``size``, ``fields``, ``cell_fields``, ``remeshed``, ``converged``, ``reason``
        and ``report``.

    Raises
    ------
    ValueError, BackendError, TooManyElementsError
        On all ranks alike, with the number of the first rank that failed.

    Warns
    -----
    ResolutionWarning
        On rank 0, if the new mesh has lost a tag, or if its boundary is farther from the old one
        than ``boundary_tolerance``.

    See Also
    --------
    size_from_error, limit_gradient, remesh, transfer_fields : the steps.

    Notes
    -----
    Up to three meshes are made to meet the number of elements or nodes within 15 %, as in one
    process.  Metrics, ``project`` and ``keep_integral`` are available in one process only, and so
    is the bound of sizes by ``boundary_tolerance`` at curved interfaces inside the mesh.

    Examples
    --------
    >>> from adaptsize import CartesianGrid
    >>> part = PartitionedMesh.from_serial(CartesianGrid((0.0, 0.0), 0.125, (9, 9)).mesh)
    >>> eta = np.exp(-9.0 * np.linalg.norm(part.points[part.cells].mean(axis=1), axis=1))
    >>> result = adapt(part, eta, target_elements=500, fields={"x": part.points[:, 0]})
    >>> result.remeshed, bool(result.report.budget_met)
    (True, True)
    """
    check_type("part", part, PartitionedMesh)
    comm = part.ranks

    def check() -> tuple[SizeRequest, TransferredFields, float, float]:
        if isinstance(h0, Metric | MetricFunction):
            raise ValueError("h0 must be sizes on several ranks, got a metric")
        nodes: Any = part
        request = SizeRequest(
            indicator=None if indicator is None else as_indicator(indicator, nodes),
            h0=as_bound(h0 if part.n_points or not callable(h0) else np.empty(0), nodes),
            g=GRADIENT_LIMIT if isinstance(g, str) and one_of("g", g, ("auto",)) else g,
            order=order, tolerance=tolerance, target_elements=target_elements, hmin=hmin,
            hmax=hmax, max_refine=max_refine, max_coarsen=max_coarsen, error=None,
            target_nodes=target_nodes,
        )  # fmt: skip
        if target_nodes is not None:
            refuse_two_targets(target_elements)
            number = as_number("target_nodes", target_nodes, lower=1.0)
            request = replace(request, target_elements=number)  # the expected one follows
        check_goal(request)
        as_flag("coarsen_converged", coarsen_converged)
        as_flag("conservative", conservative)
        old_fields = TransferredFields(
            as_fields("fields", fields, part.n_points),
            as_fields("cell_fields", cell_fields, part.n_cells),
        )
        allowed = as_tolerance("boundary_tolerance", boundary_tolerance)
        return request, old_fields, as_number("enough", enough, lower=0.0), allowed

    request, old_fields, enough, allowed = comm.agree(check)
    comm.require_equal(
        indicator=_given(indicator), h0=_given(h0), g=_given(g), order=order, tolerance=tolerance,
        target_elements=target_elements, target_nodes=target_nodes, hmin=hmin, hmax=hmax,
        max_refine=max_refine, max_coarsen=max_coarsen, enough=enough,
        coarsen_converged=coarsen_converged, boundary_tolerance=allowed,
    )  # fmt: skip
    if request.target_nodes is not None:
        request = replace(request, target_elements=_expected(part, request.target_nodes))
    if request.indicator is not None:
        squares = comm.allreduce(float(request.indicator @ request.indicator), "sum")
        request = replace(request, error=math.sqrt(squares))

    def next_for(factor: float) -> NextSizes:
        limit = partial(limit_gradient, part)
        return next_sizes(part, request, factor, limit)

    def make(sizes: NextSizes) -> PartitionedMesh:
        return remesh(
            part, _finite(sizes), how=how, rounds=rounds, tolerance=allowed,
            max_elements=max_elements, timeout=timeout, progress=report,
        )  # fmt: skip

    def count(made: PartitionedMesh) -> int:
        return made.n_global_cells if target_nodes is None else made.n_global_points

    with reporting(progress if comm.rank == 0 else None) as report:
        report("sizes", None)
        extent = part.diagonal
        if part.dim == 3:
            radius = size_from_curvature(part, elements_per_radian=1.0)
            request = replace(request, chords=size_of_chords(radius, allowed * extent))
        sizes = next_for(calibration("mmg", part.cell_dim))
        decision = decide(compare_with(part, sizes), sizes, request, enough, coarsen_converged)
        if not decision.remesh:
            return _result(part, request, decision, BestMesh(sizes, part, 0), old_fields)
        best = meet_target(request, sizes, make, count, next_for)
        report("fields", None)
        new_fields = transfer_fields(
            part, best.mesh, fields=old_fields.fields, cell_fields=old_fields.cell_fields,
            conservative=conservative,
        )  # fmt: skip
        result = _result(part, request, decision, best, new_fields)
    if comm.rank == 0:
        _warn(result.report, allowed * extent)
    return result


def _given(value: object) -> str:
    """Return whether an argument that may differ between ranks is given."""
    return "None" if value is None else "a value"


def _expected(part: PartitionedMesh, nodes: float) -> float:
    """Return the number of elements of the next mesh with so many nodes; collective."""
    n_facets = part.ranks.allreduce(len(boundary_facets(part)), "sum")
    return cells_for_nodes(nodes, part.cell_dim, part.n_global_cells, n_facets)


def _finite(sizes: NextSizes) -> FloatArray:
    """Return the sizes with some number at nodes in no cell, which may have none."""
    return np.where(np.isinf(sizes.h), 1.0, sizes.h)


def _result(
    old: PartitionedMesh,
    request: SizeRequest,
    decision: Decision,
    best: BestMesh[PartitionedMesh],
    new_fields: TransferredFields,
) -> AdaptedParts:
    """Return the mesh, the fields on it and the report; collective."""
    new, sizes = best.mesh, best.sizes
    before = interface_quality(old, sizes.h)
    after = before
    if new is not old:
        after = interface_quality(new, interpolate(old, _finite(sizes), new.points))
    report = PartsReport(
        n_points_before=old.n_global_points, n_points_after=new.n_global_points,
        n_cells_before=old.n_global_cells, n_cells_after=new.n_global_cells,
        n_meshes=best.n_meshes, target_elements=request.target_elements,
        target_nodes=request.target_nodes, tolerance=request.tolerance,
        predicted_elements=sizes.predicted, error=request.error,
        share_in_band=decision.in_band, share_too_long=decision.too_long,
        share_too_short=decision.too_short,
        before=before.everywhere, after=after,
        measure_before=total_measure(old), measure_after=total_measure(new),
        boundary_distance=boundary_distance(old, new), lost_tags=lost_tags(old, new),
    )  # fmt: skip
    return AdaptedParts(
        new, sizes.h, new_fields.fields, new_fields.cell_fields, decision.remesh,
        decision.converged, decision.reason, report,
    )  # fmt: skip


def _warn(report: PartsReport, allowed: float) -> None:
    """Warn of lost tags, and of a boundary that has moved too far."""
    if report.lost_tags:
        warnings.warn(
            f"the new mesh has lost {', '.join(report.lost_tags)}: parts smaller than the sizes "
            "vanish",
            ResolutionWarning,
            stacklevel=3,
        )
    if report.boundary_distance > allowed:
        warnings.warn(
            "the boundary of the new mesh is farther from the old one than boundary_tolerance "
            "(see report.boundary_distance), which adds up in a loop; lower boundary_tolerance",
            ResolutionWarning,
            stacklevel=3,
        )
