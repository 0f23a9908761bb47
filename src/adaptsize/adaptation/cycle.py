"""`adapt`: one adaptation cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe, one_of
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation._fields import Arrays, as_fields, methods_of
from adaptsize.adaptation.boundary_moves import ProjectionLike, check_projection
from adaptsize.adaptation.in_parts import adapt_in_parts
from adaptsize.adaptation.new_mesh import NewMesh, make_mesh
from adaptsize.adaptation.next_metric import as_anisotropic, as_metric_bound, metric_request
from adaptsize.adaptation.next_sizes import (
    BoundLike,
    Decision,
    Request,
    SizeRequest,
    as_bound,
    check_goal,
    decide,
    refuse_two_numbers,
)
from adaptsize.adaptation.report import AdaptReport, AdaptResult, lost_tags, total_measure
from adaptsize.adaptation.transfer import FieldTransfer, transferred
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.simplex import as_mesh, as_own
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import AdaptOptions, checked, with_options
from adaptsize.quality import size_conformity
from adaptsize.remeshing.protocol import Task
from adaptsize.remeshing.registry import choose_backend
from adaptsize.sizes.budget import calibration, elements_with_nodes
from adaptsize.sizes.error import as_indicator
from adaptsize.typing import ProgressCallback, Unpack

Fields: TypeAlias = Mapping[str, npt.ArrayLike]


_HOW = {"interpolate": "interpolated", "project": "projected", "bounded": "projected in bounds"}


@with_options(AdaptOptions)
def adapt(
    mesh: AnyMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    h0: BoundLike | Metric | MetricFunction | None = None,
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    project: ProjectionLike | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[AdaptOptions],
) -> AdaptResult:
    """Return the next mesh of an adaptive loop, with the fields of the present mesh on it.

    Sizes come from error indicators, upper bounds, or both, and their gradient is limited.  The
    domain is remeshed, fields are transferred and tags are kept.  The result is the best of three
    meshes by the number of elements, or the given one if it already has the sizes.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles in the plane, tetrahedra, or triangles in space.
    indicator : array_like of float, shape (n_cells,), optional
        Error of each cell, >= 0.  Requires ``tolerance``, ``elements`` or ``nodes``.
    h0 : SizeFunction, callable, array_like of float, shape (n_points,), or float, optional
        Upper bounds on the size at the nodes; without ``indicator``, the requested sizes.  Those of
        a `Metric`, `MetricFunction` or callable that returns a Metric have directions (Mmg only).
    fields, cell_fields : mapping of str to array_like, optional
        Nodal fields, shape (n_points, ...), and cell fields, shape (n_cells, ...).
    project : callable, or mapping of int to callable, optional
        Takes new nodes of the boundary, float64[n, dim], and returns their places on the true one;
        a mapping has one for each facet tag.  Corners, ridges and nodes between two of them stay.
    progress : callable, bool or None
        Called with a text and the fraction completed or None.  True shows a progress bar.
    **options

    Returns
    -------
    AdaptResult
        ``mesh``, ``size``, ``fields``, ``cell_fields``, ``remeshed``, ``converged``, ``reason``
        and ``report``.

    Raises
    ------
    ValueError, TooManyElementsError, BackendUnavailableError, BackendError, BackendTimeoutError
        If an argument is invalid (checked first); if sizes are inf after limiting, or require more
        than ``max_elements``; if no generator for this mesh is installed, it failed or was stopped.

    Warns
    -----
    ResolutionWarning
        If a tag is lost, or the boundary moves beyond ``boundary_tolerance`` without ``project``.

    Examples
    --------
    A mesh that is refined at the origin (with Mmg installed):

    >>> import numpy as np
    >>> from adaptsize import CartesianGrid
    >>> mesh = CartesianGrid([0, 0], 0.125, (9, 9)).mesh
    >>> eta = np.exp(-9.0 * np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1))
    >>> result = adapt(mesh, eta, elements=500, fields={"x": mesh.points[:, 0]})
    >>> result.remeshed, bool(result.report.budget_met)
    (True, True)
    """
    if isinstance(mesh, PartitionedMesh):
        if project is not None:
            raise ValueError("project is not available for meshes in parts")
        return adapt_in_parts(
            mesh, indicator, h0=cast("BoundLike | None", h0), fields=fields,
            cell_fields=cell_fields, progress=progress, **options,
        )  # fmt: skip
    mesh = as_own(mesh)
    task = _task(mesh)
    given = checked(AdaptOptions, options)
    check_projection(project)
    nodal = as_fields("fields", fields, mesh.n_points)
    by_cell = as_fields("cell_fields", cell_fields, mesh.n_cells)
    if isinstance(given["g"], str):
        one_of("g", given["g"], ("auto",))
    methods_of(given["method"], nodal, mesh)
    is_metric = as_anisotropic(given["anisotropic"]) is not False
    is_metric = is_metric or as_metric_bound(h0, mesh) is not None
    refuse_two_numbers(given)
    if given["nodes"] is not None:
        given = {**given, "elements": elements_with_nodes(mesh, given["nodes"])}
    request: Request
    if is_metric:
        if indicator is not None:
            raise ValueError("indicator must be None with a metric: its sizes have no direction")
        request = metric_request(mesh, h0, nodal, given)
    else:
        eta = None if indicator is None else as_indicator(indicator, mesh)
        error = None if eta is None else float(np.linalg.norm(eta))
        request = SizeRequest(given, eta, as_bound(cast("BoundLike | None", h0), mesh), error)
        check_goal(request)
    if by_cell and given["conservative"]:
        FieldTransfer(mesh, mesh).refuse_surfaces()
    generator = choose_backend(given["backend"], task, keep_facets=False, metric=is_metric).name
    tolerance = given["boundary_tolerance"]
    with reporting(progress) as report:
        report("sizes", None)
        request = request.within(mesh, tolerance)
        sizes = request.next(mesh, calibration(generator, mesh.cell_dim))
        decision = decide(mesh, sizes, request)
        made = NewMesh(mesh, sizes, generator)
        if decision.remesh:
            made = make_mesh(mesh, made, request, report)
            if project is not None:
                made = made.projected(project, given["corner_angle"])
        result = _result(mesh, request, decision, made, (nodal, by_cell), report)
    result.report.warn(tolerance * mesh.diagonal if project is None else math.inf)
    return result


def _task(mesh: SimplexMesh) -> Task:
    """Return the meshing task."""
    mesh = as_mesh("mesh", mesh)
    tasks: dict[tuple[int, int], Task] = {
        (3, 3): "tetrahedra", (2, 2): "plane triangles", (2, 3): "surface"
    }  # fmt: skip
    kind = (mesh.cell_dim, mesh.dim)
    if kind not in tasks:
        raise ValueError(
            f"mesh must be a SimplexMesh of triangles or tetrahedra, got {describe(mesh)}"
        )
    return tasks[kind]


def _result(
    old: SimplexMesh,
    request: Request,
    decision: Decision,
    made: NewMesh,
    fields: tuple[Arrays, Arrays],
    progress: ProgressCallback,
) -> AdaptResult:
    """Return fields on the new mesh, and the report."""
    sizes, new, (nodal, by_cell) = made.sizes, made.mesh, fields
    requested = sizes.requested(old)
    before = after = size_conformity(old, sizes.at_nodes)
    how: dict[str, str] = {}
    integrals: dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]] = {}
    if decision.remesh:
        transfer = FieldTransfer(old, new, progress=progress)
        moved, moved_by_cell = transferred(transfer, nodal, by_cell, request.options)
        methods = methods_of(request.options["method"], nodal, old)
        for name, values in nodal.items():
            how[name] = "nearest node"
            if values.dtype.kind not in "biu":
                how[name] = _HOW[methods[name]]
                integrals[name] = transfer.integrals(values, moved[name], nodal=True)
        for name, values in by_cell.items():
            how[name] = "value at the centroid"
            if values.dtype.kind not in "biu":
                how[name] = "conservative" if request.options["conservative"] else how[name]
                integrals[name] = transfer.integrals(values, moved_by_cell[name])
        nodal, by_cell = moved, moved_by_cell
        new = new.with_data(point_data=nodal, cell_data=by_cell)
        after = size_conformity(new, requested)
    report = AdaptReport(
        n_points_before=old.n_points, n_points_after=new.n_points,
        n_cells_before=old.n_cells, n_cells_after=new.n_cells,
        backend=made.backend, n_meshes=made.n_meshes,
        elements=request.options["elements"], nodes=request.options["nodes"],
        tolerance=request.tolerance,
        predicted_elements=sizes.predicted, error=request.error,
        share_in_band=decision.in_band, share_too_long=decision.too_long,
        share_too_short=decision.too_short, before=before, after=after,
        measure_before=total_measure(old), measure_after=total_measure(new),
        boundary_distance=made.boundary_distance, moves=made.moves,
        lost_tags=lost_tags(old, new),
        kept_tags=old.cell_tags is not None or old.facet_tags is not None,
        transferred=how, integrals=integrals,
    )  # fmt: skip
    return AdaptResult(
        new, SizeFunction(old, sizes.h), nodal, by_cell, decision.remesh, decision.converged,
        decision.reason, report, requested if isinstance(requested, MetricFunction) else None,
    )  # fmt: skip
