"""`adapt` on a mesh in parts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type, one_of
from adaptsize._progress import reporting
from adaptsize.adaptation._fields import as_fields, methods_of
from adaptsize.adaptation.new_mesh import BestMesh, meet_target
from adaptsize.adaptation.next_sizes import (
    BoundLike,
    Decision,
    NextSizes,
    SizeRequest,
    as_bound,
    check_goal,
    decide,
    refuse_two_numbers,
)
from adaptsize.adaptation.report import AdaptResult, PartsReport, lost_tags, total_measure
from adaptsize.adaptation.transfer import transfer_fields
from adaptsize.adaptation.transfer_in_parts import TransferredFields
from adaptsize.background import SimplexMesh, interpolate
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.requests import ask_nearest, boxes_around
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import AdaptOptions, checked, options_of
from adaptsize.remeshing.driver import remesh
from adaptsize.remeshing.in_parts import interface_quality
from adaptsize.sizes.budget import calibration, cells_for_nodes
from adaptsize.sizes.curvature import size_from_curvature, size_of_chords
from adaptsize.sizes.error import as_indicator
from adaptsize.typing import FloatArray, ProgressCallback, Unpack

Fields = Mapping[str, npt.ArrayLike]

_OF_WHOLE_MESHES = {"corner_angle", "keep_integral", "anisotropic", "norm", "max_aspect"}


def adapt_in_parts(
    part: PartitionedMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    h0: BoundLike | None = None,
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[AdaptOptions],
) -> AdaptResult:
    """Return the next mesh, as `adaptsize.adapt` for the whole mesh; collective.

    Arguments are those of the cells and nodes of this rank.  On rank 0, a `ResolutionWarning` tells
    of lost tags, and of a boundary that is farther from the old one than ``boundary_tolerance``.
    Sizes at curved interfaces inside the mesh are not bounded by it.

    Examples
    --------
    >>> from adaptsize import CartesianGrid
    >>> part = PartitionedMesh.from_serial(CartesianGrid((0.0, 0.0), 0.125, (9, 9)).mesh)
    >>> eta = np.exp(-9.0 * np.linalg.norm(part.points[part.cells].mean(axis=1), axis=1))
    >>> result = adapt_in_parts(part, eta, elements=500, fields={"x": part.points[:, 0]})
    >>> result.remeshed, bool(result.report.budget_met)
    (True, True)
    """
    check_type("part", part, PartitionedMesh)
    comm = part.ranks

    def check() -> tuple[AdaptOptions, SizeRequest, TransferredFields]:
        given = checked(AdaptOptions, options)
        for name in _OF_WHOLE_MESHES & options.keys():
            if options[name] != options_of(AdaptOptions)[name].default:  # type: ignore[literal-required]
                raise ValueError(f"{name} is not available for meshes in parts")
        one_of("backend", given["backend"], ("auto", "mmg"))
        if isinstance(h0, Metric | MetricFunction):
            raise ValueError("h0 must be sizes on several ranks, got a metric")
        if isinstance(given["g"], str):
            one_of("g", given["g"], ("auto",))
        refuse_two_numbers(given)
        request = SizeRequest(
            given,
            indicator=None if indicator is None else as_indicator(indicator, part),
            h0=as_bound(h0 if part.n_points or not callable(h0) else np.empty(0), part),
            total_error=None,
        )
        check_goal(request)
        old_fields = TransferredFields(
            as_fields("fields", fields, part.n_points),
            as_fields("cell_fields", cell_fields, part.n_cells),
        )
        methods_of(given["method"], old_fields.fields, part)
        return given, request, old_fields

    given, request, old_fields = comm.agree(check)
    comm.require_equal(indicator=indicator is None, h0=h0 is None, **given)
    if request.h0 is not None:
        part.require_equal_values("h0", request.h0)
    allowed = given["boundary_tolerance"]
    if given["nodes"] is not None:
        given = {**given, "elements": _expected(part, given["nodes"])}
        request = replace(request, options=given)
    if request.indicator is not None:
        squares = comm.allreduce(float(request.indicator @ request.indicator), "sum")
        request = replace(request, total_error=math.sqrt(squares))

    def make(sizes: NextSizes) -> PartitionedMesh:
        return remesh(
            part, _finite(sizes), how=given["how"], rounds=given["rounds"], tolerance=allowed,
            max_elements=given["max_elements"], timeout=given["timeout"], progress=report,
        )  # fmt: skip

    def count(made: PartitionedMesh) -> int:
        return made.n_global_cells if given["nodes"] is None else made.n_global_points

    with reporting(progress if comm.rank == 0 else None) as report:
        report("sizes", None)
        extent = part.diagonal
        if part.dim == 3:
            radius = size_from_curvature(part, elements_per_radian=1.0)
            request = replace(request, chords=size_of_chords(radius, allowed * extent))
        sizes = request.next(part, calibration("mmg", part.cell_dim))
        decision = decide(part, sizes, request)
        if not decision.remesh:
            return _result(part, request, decision, BestMesh(sizes, part, 0), old_fields)
        best = meet_target(request, sizes, make, count, partial(request.next, part))
        report("fields", None)
        new_fields = transfer_fields(
            part, best.mesh, fields=old_fields.fields, cell_fields=old_fields.cell_fields,
            conservative=given["conservative"], method=given["method"],
        )  # fmt: skip
        result = _result(part, request, decision, best, new_fields)
    if comm.rank == 0:
        result.report.warn(allowed * extent)
    return result


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
) -> AdaptResult:
    """Return the mesh, the fields on it and the report; collective."""
    new, sizes = best.mesh, best.sizes
    before = interface_quality(old, sizes.h)
    after = before
    if new is not old:
        after = interface_quality(new, interpolate(old, _finite(sizes), new.points))
    report = PartsReport(
        n_points_before=old.n_global_points, n_points_after=new.n_global_points,
        n_cells_before=old.n_global_cells, n_cells_after=new.n_global_cells,
        n_meshes=best.n_meshes, elements=request.options["elements"],
        nodes=request.options["nodes"], tolerance=request.tolerance,
        predicted_elements=sizes.predicted, error=request.error,
        share_in_band=decision.in_band, share_too_long=decision.too_long,
        share_too_short=decision.too_short,
        before=before.everywhere, after=after,
        measure_before=total_measure(old), measure_after=total_measure(new),
        boundary_distance=boundary_distance(old, new), lost_tags=lost_tags(old, new),
    )  # fmt: skip
    return AdaptResult(
        new, sizes.h, new_fields.fields, new_fields.cell_fields, decision.remesh,
        decision.converged, decision.reason, report,
    )  # fmt: skip


def boundary_distance(old: PartitionedMesh, new: PartitionedMesh) -> float:
    """Return the largest distance of a boundary node of a mesh to the boundary of another one.

    Collective.  Nodes are sent to the ranks with the nearest facets.
    """
    facets = boundary_facets(old)
    nodes = np.unique(boundary_facets(new))
    skin = SimplexMesh(old.points, facets) if len(facets) else None

    def distances(points: FloatArray) -> FloatArray:
        assert skin is not None
        return skin.locator.nearest(points)[2][:, None]

    boxes = boxes_around(old.points[np.unique(facets)], old.ranks)
    found = ask_nearest(old, boxes, new.points[nodes], distances)
    return float(old.ranks.allreduce(float(found.max(initial=0.0)), "max"))
