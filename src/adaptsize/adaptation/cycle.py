"""`adapt`: one adaptation cycle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias, cast, overload

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import (
    as_plain_array,
    as_values,
    check_type,
    describe,
    one_of,
    refusal,
    refuse_where,
)
from adaptsize._messages import Message
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation._fields import Arrays, as_fields, methods_of
from adaptsize.adaptation.between_meshes import refuse_surfaces
from adaptsize.adaptation.bisected import BISECTION, divide_cells
from adaptsize.adaptation.boundary_maps import (
    BoundaryMapLike,
    BoundaryMaps,
    as_boundary_maps,
)
from adaptsize.adaptation.boundary_moves import move_to_boundary
from adaptsize.adaptation.boundary_need import refuse_too_few
from adaptsize.adaptation.element_fields import (
    CheckedFields,
    as_nodal_fields,
    methods_of_arrays,
)
from adaptsize.adaptation.need import Requested, smallest
from adaptsize.adaptation.new_mesh import NewMesh, make_mesh
from adaptsize.adaptation.next_fields import NextFields, kept_fields, moved_fields
from adaptsize.adaptation.next_metric import as_anisotropic, metric_request
from adaptsize.adaptation.next_sizes import (
    BoundLike,
    CycleRequest,
    Decision,
    NextSizes,
    SizeRequest,
    as_bound,
    decide,
    size_request,
)
from adaptsize.adaptation.patch import remade_alone
from adaptsize.adaptation.report import (
    AdaptReport,
    AdaptResult,
    numbers_of,
    tags_of,
    total_measure,
    wide_parts,
)
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh, interpolate
from adaptsize.background.migration import whole_boundary
from adaptsize.background.simplex import as_mesh
from adaptsize.errors import OptionError
from adaptsize.limiting.periodic import Periodicity, as_periodicity
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import AdaptOptions, checked, options_of, with_options
from adaptsize.quality.conformity import Conformity, nodal_metric, size_conformity
from adaptsize.quality.elements import refuse_folded
from adaptsize.remeshing.protocol import TASKS, Task
from adaptsize.remeshing.registry import available_backends, choose_backend
from adaptsize.sizes.budget import calibration, elements_with_nodes
from adaptsize.sizes.error import as_indicator
from adaptsize.sizes.made import triangles_by_mmg
from adaptsize.typing import FloatArray, ProgressCallback, Unpack

Fields: TypeAlias = Mapping[str, Any]
_Qualities: TypeAlias = tuple[Conformity, Conformity]
#: The result for a mesh, which is whole or in parts.
AnyResult: TypeAlias = "AdaptResult[AnyMesh, SizeFunction | FloatArray]"


_OF_WHOLE_MESHES = ("corner_angle", "keep_integral", "anisotropic", "norm", "max_aspect", "local")


@overload
def adapt(
    mesh: SimplexMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    h0: BoundLike | Metric | MetricFunction | None = None,
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    project: BoundaryMapLike | None = None,
    original: SimplexMesh | None = None,
    periodic: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[AdaptOptions],
) -> AdaptResult[SimplexMesh, SizeFunction]: ...


@overload
def adapt(
    mesh: PartitionedMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    h0: BoundLike | None = None,
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    project: None = None,
    original: SimplexMesh | None = None,
    periodic: None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[AdaptOptions],
) -> AdaptResult[PartitionedMesh, FloatArray]: ...


@recorded("adapt", "mesh", "size", "metric", "fields.*", "cell_fields.*")
@with_options(AdaptOptions)
def adapt(
    mesh: AnyMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    h0: BoundLike | Metric | MetricFunction | None = None,
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    project: BoundaryMapLike | None = None,
    original: SimplexMesh | None = None,
    periodic: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[AdaptOptions],
) -> AnyResult:
    """Return the next mesh of an adaptive loop, with the fields of the present mesh on it.

    Sizes come from error indicators, upper bounds, or both, and are limited.  Tags are kept.  The
    mesh is the best of three by the number of elements, or the given one if it has the sizes.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles in the plane, tetrahedra, or triangles in space.
    indicator : array_like of float, shape (n_cells,) or (n, n_cells), optional
        Error of each cell, >= 0, or of n states: sizes are the smallest that any of them requests.
        Requires ``tolerance``, ``elements`` or ``nodes``.
    h0 : SizeFunction, callable, array_like of float, shape (n_points,), or float, optional
        Bounds on the size; without ``indicator``, the sizes.  Or a metric: also of a callable.
    fields, cell_fields : mapping of str, optional
        Fields at nodes or of elements, see `transfer_fields`, and those of cells.
    project : callable, or mapping of int or str to callable, optional
        Takes points of the boundary, float64[n, dim], and returns their places on the true one; a
        mapping has one for each facet tag or its name.  Corners, ridges and nodes between two stay.
    original : SimplexMesh, optional
        The first mesh of the loop, or its boundary: in space, ``boundary_tolerance`` bounds sizes
        by its curvature.  By default known of meshes of `adapt`.
    periodic : array_like of float, shape (k, dim) or (k, dim, dim + 1), optional
        See `remesh` and `limit_gradient`: opposite sides match, and have the same sizes.
    progress : callable, bool or None
        Called with a text and the fraction completed or None.  True shows a progress bar.
    **options

    Returns
    -------
    AdaptResult
        The mesh, the sizes, the fields, whether it was remeshed or is converged, why, and a report.

    Raises
    ------
    ValueError, TooManyElementsError, BackendUnavailableError, BackendError, BackendTimeoutError
        If an argument is invalid (checked first); if sizes are inf after limiting; if more elements
        are required than requested or allowed; if no generator is installed, or it failed.

    Warns
    -----
    ResolutionWarning
        If a tag is lost, or the boundary moves beyond ``boundary_tolerance`` without ``project``.

    Examples
    --------
    >>> import numpy as np
    >>> from adaptsize import CartesianGrid
    >>> mesh = CartesianGrid([0, 0], 0.125, (9, 9)).mesh
    >>> eta = np.exp(-9.0 * np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1))
    >>> result = adapt(mesh, eta, elements=500, fields={"x": mesh.points[:, 0]})
    >>> result.remeshed, bool(result.report.budget_met)
    (True, True)
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    ranks = mesh.ranks
    cycle = ranks.agree(
        lambda: _checked(mesh, indicator, h0, (fields, cell_fields), project, periodic, options)
    )
    first = ranks.agree(lambda: _original(mesh, original, project is None))
    request = cycle.request
    given = request.options
    ranks.require_equal(indicator=request.n_states, h0=h0 is None, **given)
    if isinstance(mesh, PartitionedMesh) and cycle.bound is not None:
        mesh.require_equal_values("h0", cycle.bound)
    if given["nodes"] is not None:
        given = {**given, "elements": elements_with_nodes(mesh, given["nodes"])}
        request = replace(request, options=given)
    tolerance = given["boundary_tolerance"]
    with reporting(progress if ranks.rank == 0 else None) as report:
        report("sizes", None)
        # Parts of facets are as far from a curved boundary as the facets, unless they are moved.
        is_faceted = cycle.generator == BISECTION and cycle.project is None
        request = request.within(mesh, math.inf if is_faceted else tolerance, first)
        factor = calibration(cycle.generator, mesh.cell_dim)
        sizes = request.next(mesh, factor, _count_of(mesh, request, cycle.generator))
        refuse_too_few(mesh, sizes, request, first)
        decision = decide(mesh, sizes, request)
        made = NewMesh(mesh, sizes, cycle.generator)
        if decision.remesh and cycle.generator == BISECTION and isinstance(mesh, SimplexMesh):
            made = divide_cells(mesh, made, request)
            if made.divided is None:  # no cell is too large
                decision = decision.without_division()
        elif decision.remesh:
            made = make_mesh(mesh, made, request, report, first)
        if (
            cycle.project is not None
            and made.mesh is not mesh
            and isinstance(made.mesh, SimplexMesh)
        ):
            moved, moves = move_to_boundary(made.mesh, cycle.project, given["corner_angle"])
            # Functions on parts of cells change with the nodes: they are transferred.
            made = replace(made, mesh=moved, moves=moves, divided=None)
        result = _result(mesh, request, decision, made, cycle, report)
    result = _with_original(result, mesh, first)
    allowed = tolerance * mesh.diagonal if project is None else math.inf
    if ranks.rank == 0:
        result.report.warn(allowed)
    return result


def _count_of(
    mesh: AnyMesh, request: CycleRequest, generator: str
) -> Callable[[Requested], float] | None:
    """Return the number of cells that a generator makes of a mesh with sizes, if it is known."""
    is_known = generator == "mmg" and mesh.dim == 2 and request.cell is None
    if not is_known or not isinstance(request, SizeRequest):
        return None

    def made(sizes: Requested) -> float:
        gone = None
        if request.options["local"] and isinstance(mesh, SimplexMesh):
            gone = remade_alone(mesh, sizes)
        return triangles_by_mmg(mesh, smallest(sizes), None if gone is None else ~gone)

    return made


def _original(mesh: AnyMesh, original: SimplexMesh | None, is_faceted: bool) -> SimplexMesh | None:
    """Return the first mesh of the loop, if it is not this one; of parts, its boundary.

    If nodes are moved to the true boundary, the domain is not the one with the first facets.
    """
    if original is None:
        return mesh.original if is_faceted else None
    check_type("original", original, SimplexMesh)
    in_parts = isinstance(mesh, PartitionedMesh)
    kinds = {(mesh.cell_dim, 3), (2, 3)} if in_parts else {(mesh.cell_dim, 3)}
    if mesh.dim < 3 or (original.cell_dim, original.dim) not in kinds:
        raise ValueError(
            f"original must be a mesh in space of the same kind of cells as mesh, a SimplexMesh, "
            f"got {original!r} for {mesh!r}"
        )
    return original.boundary().mesh if in_parts and original.cell_dim == 3 else original


def _with_original(result: AnyResult, mesh: AnyMesh, first: SimplexMesh | None) -> AnyResult:
    """Return a result of which the mesh keeps the first mesh of its loop, in space; collective.

    A mesh in parts keeps the boundary of the first one, the same on all ranks.  Projected nodes
    would be put back on the first boundary: with them, a loop begins anew.
    """
    if mesh.dim < 3:
        return result
    if result.report.moves is not None and isinstance(result.mesh, SimplexMesh):
        bare = result.mesh.with_original(None)
        return replace(result, mesh=bare, original=bare)
    if first is None:
        first = whole_boundary(mesh).mesh if isinstance(mesh, PartitionedMesh) else mesh
    if first.original is not None:  # otherwise each mesh would keep all before it in memory
        first = first.with_original(None)
    if result.mesh is not mesh and result.mesh is not first:  # the caller's mesh is not changed
        result = replace(result, mesh=result.mesh.with_original(first))
    return replace(result, original=first)


class _Checked(NamedTuple):
    """The checked arguments of `adapt`."""

    request: CycleRequest
    bound: FloatArray | None
    generator: str
    nodal: CheckedFields
    by_cell: Arrays
    project: BoundaryMaps | None


def _checked(
    mesh: AnyMesh,
    indicator: npt.ArrayLike | None,
    h0: BoundLike | Metric | MetricFunction | None,
    fields: tuple[Fields | None, Fields | None],
    project: BoundaryMapLike | None,
    periodic: npt.ArrayLike | None,
    options: AdaptOptions,
) -> _Checked:
    """Return the checked arguments of this rank."""
    task = _task(mesh)
    given = checked(AdaptOptions, options)
    nodal = as_nodal_fields(fields[0], mesh)
    by_cell = as_fields("cell_fields", fields[1], mesh.n_cells)
    if isinstance(given["g"], str):
        one_of("g", given["g"], ("auto",))
    given["method"] = methods_of_arrays(given["method"], nodal)
    methods_of(given["method"], nodal.arrays, mesh)
    is_metric = as_anisotropic(given["anisotropic"]) is not False
    bound, backend, projections = None, given["backend"], None
    if isinstance(mesh, PartitionedMesh):
        _refuse_in_parts(project, h0, periodic, given)
        backend = "mmg"
    else:
        if mesh.dim == 2:
            refuse_folded(mesh)
        is_metric = is_metric or nodal_metric(mesh, h0, finite=False) is not None
        projections = as_boundary_maps(project, mesh)
        if by_cell and given["conservative"] and (backend != BISECTION or project is not None):
            refuse_surfaces(mesh)
    if given["elements"] is not None and given["nodes"] is not None:
        raise OptionError(Message("{elements} and {nodes} exclude each other: omit one"))
    if periodic is not None:
        _refuse_unperiodic(project, backend, is_metric=is_metric)
    request: CycleRequest
    if is_metric and isinstance(mesh, SimplexMesh):
        if indicator is not None:
            raise ValueError("indicator must be None with a metric: its sizes have no direction")
        request = metric_request(mesh, h0, nodal.arrays, given)
    else:
        eta = None if indicator is None else _states(indicator, mesh)
        bound = None if h0 is None else as_bound(cast("BoundLike", h0), mesh)
        request = size_request(given, eta, bound, _cell_of(mesh, periodic))
    generator = _generator(backend, task, is_metric=is_metric)
    if given["local"] and (mesh.dim != 2 or generator != "mmg" or periodic is not None):
        raise refusal("local", "needs a mesh in the plane that is not periodic, and Mmg")
    return _Checked(request, bound, generator, nodal, by_cell, projections)


def _refuse_unperiodic(project: BoundaryMapLike | None, backend: str, *, is_metric: bool) -> None:
    """Raise a ValueError for what cannot be combined with ``periodic``."""
    if is_metric:
        raise refusal("periodic", "cannot be combined with a metric")
    if project is not None:
        raise refusal("periodic", "cannot be combined with project, which moves nodes of the sides")
    if backend == BISECTION:
        raise refusal("periodic", "cannot be combined with bisection, which divides sides alone")


def _cell_of(mesh: AnyMesh, periodic: npt.ArrayLike | None) -> Periodicity | None:
    """Return how a mesh is repeated, if it is."""
    if periodic is None or not isinstance(mesh, SimplexMesh):
        return None
    return as_periodicity(mesh, periodic)


def _generator(backend: str, task: Task, *, is_metric: bool) -> str:
    """Return the name of what makes the new mesh."""
    one_of("backend", backend, ("auto", *available_backends(), BISECTION))
    if backend != BISECTION:
        return choose_backend(backend, task, keep_facets=False, metric=is_metric).name
    if is_metric:
        raise refusal("backend", "'bisection' cannot follow a metric; use 'mmg'")
    return BISECTION


def _refuse_in_parts(
    project: BoundaryMapLike | None,
    h0: BoundLike | Metric | MetricFunction | None,
    periodic: npt.ArrayLike | None,
    given: AdaptOptions,
) -> None:
    """Raise a ValueError for what is not available for meshes in parts."""
    for name in _OF_WHOLE_MESHES:
        if given[name] != options_of(AdaptOptions)[name].default:  # type: ignore[literal-required]
            raise ValueError(f"{name} is not available for meshes in parts")
    if project is not None:
        raise ValueError("project is not available for meshes in parts")
    if periodic is not None:
        raise ValueError("periodic is not available for meshes in parts")
    if isinstance(h0, Metric | MetricFunction):
        raise ValueError("h0 must be sizes on several ranks, got a metric")
    one_of("backend", given["backend"], ("auto", "mmg"))


def _states(indicator: npt.ArrayLike, mesh: AnyMesh) -> FloatArray:
    """Return the checked indicators of the states in a window, float64[n, n_cells]."""
    states = as_plain_array("indicator", indicator)
    if states.ndim != 2:
        return as_indicator(indicator, mesh)[None]
    if states.shape[0] == 0 or states.shape[1] != mesh.n_cells:
        raise ValueError(
            f"indicator must have shape ({mesh.n_cells},), or (n, {mesh.n_cells}) for n states in "
            f"a window of time, got {states.shape}"
        )
    by_state = as_values("indicator", indicator)
    refuse_where("indicator", by_state < 0.0, by_state, "must be finite and >= 0")
    return by_state


def _task(mesh: AnyMesh) -> Task:
    """Return the meshing task."""
    kind = "tetrahedra" if mesh.cell_dim == 3 else "triangles"
    task = TASKS.get((mesh.cell_dim, mesh.dim, kind))
    if task is None or (task == "surface" and not isinstance(mesh, SimplexMesh)):
        raise ValueError(
            f"mesh must be a SimplexMesh of triangles or tetrahedra, got {describe(mesh)}"
        )
    return task


def _result(
    old: AnyMesh,
    request: CycleRequest,
    decision: Decision,
    made: NewMesh,
    fields: _Checked,
    progress: ProgressCallback,
) -> AnyResult:
    """Return fields on the new mesh, and the report; collective."""
    sizes, new = made.sizes, made.mesh
    if decision.remesh:
        moved = moved_fields(
            old, new, fields.nodal, fields.by_cell, request.options, progress, made.divided
        )
    else:
        moved = kept_fields(fields.nodal, fields.by_cell)
    if decision.remesh and isinstance(new, SimplexMesh):
        arrays = {name: moved.nodal[name] for name in fields.nodal.arrays}
        new = new.with_data(point_data=arrays, cell_data=moved.by_cell)
    h, requested = smallest(sizes.at_nodes), sizes.requested(old)
    return AdaptResult(
        new, SizeFunction(old, h) if isinstance(old, SimplexMesh) else h,
        moved.nodal, moved.by_cell,
        decision.remesh, decision.converged, decision.reason,
        _report(old, request, decision, replace(made, mesh=new), moved),
        requested if isinstance(requested, MetricFunction) else None,
    )  # fmt: skip


def _report(
    old: AnyMesh, request: CycleRequest, decision: Decision, made: NewMesh, moved: NextFields
) -> AdaptReport:
    """Return the report; collective."""
    sizes, new = made.sizes, made.mesh
    qualities: Callable[[], _Qualities] = partial(_qualities, old, new, sizes)
    if isinstance(old, PartitionedMesh):  # collective, and the report stays without the meshes
        qualities = partial(_known, qualities())
    before_tags = tags_of(old)
    lost = sorted(before_tags - tags_of(new))
    dropped = sorted(wide_parts(old, smallest(sizes.at_nodes), lost))
    (n_points, n_cells), (new_points, new_cells) = numbers_of(old), numbers_of(new)
    return AdaptReport(
        cell_dim=old.cell_dim, n_points_before=n_points, n_points_after=new_points,
        n_cells_before=n_cells, n_cells_after=new_cells,
        backend=made.backend, n_meshes=made.n_meshes,
        elements=request.options["elements"], nodes=request.options["nodes"],
        tolerance=request.tolerance,
        predicted_elements=sizes.predicted, error=request.error,
        share_in_band=decision.in_band, share_too_long=decision.too_long,
        share_too_short=decision.too_short, qualities=qualities,
        measure_before=total_measure(old), measure_after=total_measure(new),
        boundary_distance=made.boundary_distance, moves=made.moves,
        lost_tags=tuple(f"{kind} tag {tag}" for kind, tag in lost),
        dropped_tags=tuple(f"{kind} tag {tag}" for kind, tag in dropped),
        kept_tags=bool(before_tags),
        transferred=moved.how, integrals=moved.integrals, magnitudes=moved.magnitudes,
    )  # fmt: skip


def _known(both: _Qualities) -> _Qualities:
    """Return what is known already."""
    return both


def _qualities(old: AnyMesh, new: AnyMesh, sizes: NextSizes) -> _Qualities:
    """Return how closely the old and the new mesh follow the sizes; collective."""
    before = size_conformity(old, sizes.at_nodes)
    if new is old:
        return before, before
    requested = sizes.requested(old)
    if isinstance(requested, np.ndarray):  # at the nodes of a mesh in parts
        requested = interpolate(old, requested, new.points)
    return before, size_conformity(new, requested)
