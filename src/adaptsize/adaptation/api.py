"""`adapt`: one adaptation cycle."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_aspect,
    as_flag,
    as_number,
    as_tolerance,
    check_type,
    describe,
    one_of,
)
from adaptsize._defaults import GRADIENT_LIMIT, METRIC_GRADIENT_LIMIT
from adaptsize._progress import reporting
from adaptsize.adaptation._fields import as_fields
from adaptsize.adaptation.boundary_moves import ProjectionLike, check_projection
from adaptsize.adaptation.new_mesh import NewMesh, make_mesh
from adaptsize.adaptation.next_metric import as_anisotropic, as_metric_bound, metric_request
from adaptsize.adaptation.next_sizes import (
    BoundLike,
    Request,
    SizeRequest,
    as_bound,
    check_factors,
    check_goal,
    decide_remeshing,
    refuse_two_targets,
)
from adaptsize.adaptation.result import AdaptResult, FieldsToTransfer, result_of
from adaptsize.adaptation.transfer import FieldTransfer
from adaptsize.background import SimplexMesh
from adaptsize.errors import ResolutionWarning
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.remeshing.registry import choose_backend
from adaptsize.sizes.budget import calibration, elements_with_nodes
from adaptsize.sizes.error import as_indicator
from adaptsize.typing import GradientLimit, ProgressCallback

Fields: TypeAlias = Mapping[str, npt.ArrayLike]
_Task: TypeAlias = Literal["tetrahedra", "plane triangles", "surface"]


def adapt(
    mesh: SimplexMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    order: float = 1,
    h0: BoundLike | Metric | MetricFunction | None = None,
    target_elements: float | None = None,
    target_nodes: float | None = None,
    tolerance: float | None = None,
    g: GradientLimit | Literal["auto"] | None = "auto",
    hmin: float | None = None,
    hmax: float | None = None,
    max_refine: float = 4.0,
    max_coarsen: float = 2.0,
    backend: str = "auto",
    fields: Fields | None = None,
    cell_fields: Fields | None = None,
    conservative: bool = True,
    keep_integral: bool = False,
    project: ProjectionLike | None = None,
    corner_angle: float = 30.0,
    anisotropic: bool | str | Sequence[str] = False,
    norm: float = 2.0,
    max_aspect: float = 1000.0,
    enough: float = 0.85,
    coarsen_converged: bool = False,
    boundary_tolerance: float = 1e-3,
    max_elements: float = 5_000_000,
    timeout: float | None = 3600.0,
    progress: ProgressCallback | bool | None = None,
) -> AdaptResult:
    """Return the next mesh of an adaptive loop, with the fields of the present mesh on it.

    This is one adaptation cycle.  Sizes come from error indicators, upper bounds on the size, or
    both, and their gradient is limited.  The domain is remeshed with these sizes.  Fields are
    transferred and tags are kept.  A mesh that already has the sizes is returned unchanged.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane, tetrahedra, or triangles in space.
    indicator : array_like of float, shape (n_cells,), optional
        Error of each cell, >= 0.  The total error is ``sqrt(sum(indicator**2))``.  Requires
        ``tolerance``, ``target_elements`` (or ``target_nodes``) or both.
    order : float, default 1
        Order of convergence: the error is proportional to this power of the size, see
        `size_from_error`.
    h0 : SizeFunction, callable, array_like of float, shape (n_points,), or float, optional
        Upper bounds on the size, evaluated at the nodes of ``mesh``; inf where there is none.
        With ``indicator`` they are additional bounds.  Without it they are the requested sizes.
        A `Metric` at the nodes, a `MetricFunction` or a callable that returns a Metric gives bounds
        that depend on the direction (Mmg only).
    target_elements : float, optional
        Number of cells of the next mesh, >= 1, after all limits.  With ``h0`` alone, the bounds
        are scaled to meet it.  With ``tolerance`` it is an upper limit.
    target_nodes : float, optional
        Number of nodes instead of ``target_elements``.
    tolerance : float, optional
        Target for the total error, > 0.  The sizes are computed for 0.95 of it.
    g : float, array_like, callable, tuple, "auto" or None
        Gradient limit, as in `limit_gradient`.  None disables gradient limiting.  "auto" is 0.25,
        and 1 for metrics: `limit_metric` limits all sizes at a node by the smallest ones nearby,
        and 0.25 needed 1.6 to 2 times as many elements for the same error of interpolation.
    hmin, hmax : float, optional
        Limits of the size.
    max_refine, max_coarsen : float, default 4 and 2
        Limits on the change of the size by ``indicator``, see `size_from_error`.
    backend : str, default "auto"
        Mesh generator, see `remesh`.
    fields : mapping of str to array_like, optional
        Nodal fields, shape (n_points, ...), interpolated; see `FieldTransfer.nodal`.
    cell_fields : mapping of str to array_like, optional
        Cell fields, shape (n_cells, ...); see `FieldTransfer.cells`.
    conservative, keep_integral : bool
        How cell fields are transferred, see `FieldTransfer.cells`.  For triangles in space
        ``conservative`` must be False.
    project : callable, or mapping of int to callable, optional
        Takes nodes near the boundary, float64[n, dim], and returns their projections onto the true
        boundary.  A mapping has one callable for the facets of each tag, including tagged
        facets inside.  It is called with the new boundary nodes except corners, ridges and nodes
        between two projections.  Moves that would degrade a cell are shortened.
    corner_angle : float, default 30
        Angle in degrees between two boundary facets from which on their common nodes are corners.
    anisotropic : bool, str or sequence of str, default False
        Whether sizes depend on the direction, such that linear elements interpolate these nodal
        ``fields`` best: all with one float per node, or those named (see `metric_from_hessian`;
        Mmg only).  The metrics of several fields are intersected.  Requires ``target_elements``,
        or ``tolerance`` for the error of interpolation.
    norm, max_aspect : float, default 2 and 1000
        Norm of that error and limit of the aspect ratio, see `metric_from_hessian`.
    enough : float, default 0.85
        The mesh is not remeshed if all of these hold: it already has this share of the next mesh
        (edges within sqrt 2 of the new sizes, each weighted by the cells that replace it), no edge
        is 3 times too long, the number of cells would change by less than 15 %, and the
        tolerance does not need more cells.  A value above 1 always makes a new mesh.
    coarsen_converged : bool, default False
        Whether to remesh, and coarsen where possible, if the error is within the tolerance.
    boundary_tolerance : float
        Allowed distance of the new boundary from the old one, over the diagonal; see
        `remesh`.  In space, unless Gmsh makes the mesh, it bounds the sizes at curved boundaries as
        in `size_function`, since the generators refine there: large sizes need a larger tolerance.
    max_elements : float
        If the sizes require more elements than this, no generator is started.
    timeout : float or None
        Seconds after which a generator is stopped.  None disables the limit.
    progress : callable, bool or None
        Called with a text and the fraction completed or None.  True shows a progress bar.  An
        exception in it, or Ctrl-C, stops the work.

    Returns
    -------
    AdaptResult
        ``mesh``, ``size``, ``fields``, ``cell_fields``, ``remeshed``, ``converged``, ``reason``
        and ``report``.

    Raises
    ------
    ValueError
        If an argument is invalid (checked first), or sizes are inf after limiting.
    TooManyElementsError
        If the sizes require more than ``max_elements`` elements.
    BackendUnavailableError
        If no generator for this mesh is installed.  Triangles need Mmg.
    BackendError
        If the generator failed.  BackendTimeoutError if it was stopped.

    Warns
    -----
    ResolutionWarning
        If the new mesh has lost a tag, or if, without ``project``, the new boundary is farther
        from the old one than ``boundary_tolerance``.

    See Also
    --------
    size_from_error, size_from_hessian, limit_gradient, remesh, transfer_fields : the steps.
    metric_from_hessian, limit_metric : the steps for anisotropic sizes.

    Notes
    -----
    The number of cells (or nodes) is predicted from measurements with the generator.  If the mesh
    misses the number by more than 15 % although the limits allow it, the prediction is corrected
    and another mesh is made.  Of up to three meshes the closest is returned.

    Boundary nodes stay on the boundary of the old mesh: on straight boundaries to rounding
    (fTetWild: within ``boundary_tolerance``).  On curved boundaries Mmg rounds coarse facets off,
    and up to 3.4 times that tolerance was measured.  The report has the distance.

    Mmg keeps tags of cells and facets exactly.  For fTetWild they are looked up in the old mesh.

    Examples
    --------
    A mesh that is refined at the origin (with Mmg installed):

    >>> import numpy as np
    >>> x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    >>> from scipy.spatial import Delaunay
    >>> points = np.column_stack([x.ravel(), y.ravel()])
    >>> mesh = SimplexMesh(points, Delaunay(points).simplices)
    >>> eta = np.exp(-9.0 * np.linalg.norm(points[mesh.cells].mean(axis=1), axis=1))
    >>> result = adapt(mesh, eta, target_elements=500, fields={"x": points[:, 0]})
    >>> result.remeshed, bool(result.report.budget_met)
    (True, True)
    >>> bool(np.abs(result.fields["x"] - result.mesh.points[:, 0]).max() < 1e-12)
    True

    An adaptive loop with a tolerance::

        for cycle in range(20):
            u, eta = solve(mesh)
            result = ads.adapt(mesh, eta, tolerance=1e-3, fields={"u": u})
            print(result)
            if not result.remeshed:
                break
            mesh = result.mesh
    """
    task = _task(mesh)
    enough = as_number("enough", enough, lower=0.0)
    corner_angle = as_number("corner_angle", corner_angle, lower=0.0)
    _check_numbers(order, max_refine, max_coarsen, norm, max_aspect)
    check_projection(project)
    to_transfer = FieldsToTransfer(
        as_fields("fields", fields, mesh.n_points),
        as_fields("cell_fields", cell_fields, mesh.n_cells),
        as_flag("conservative", conservative),
        as_flag("keep_integral", keep_integral),
    )
    of_fields = as_anisotropic(anisotropic)
    is_metric = of_fields is not False or as_metric_bound(h0, mesh) is not None
    if isinstance(g, str):
        one_of("g", g, ("auto",))
        g = METRIC_GRADIENT_LIMIT if is_metric else GRADIENT_LIMIT
    # As floats: numbers of numpy would make the search for the factor less accurate.
    if target_elements is not None:
        target_elements = as_number("target_elements", target_elements, lower=1.0)
    if tolerance is not None:
        tolerance = as_number("tolerance", tolerance, lower=0.0, strict=True)
    if target_nodes is not None:
        target_nodes = as_number("target_nodes", target_nodes, lower=1.0)
        refuse_two_targets(target_elements)
        target_elements = elements_with_nodes(mesh, target_nodes, "target_nodes")
    limits: dict[str, Any] = {
        "g": g,
        "hmin": hmin,
        "hmax": hmax,
        "target_elements": target_elements,
        "target_nodes": target_nodes,
    }
    request: Request
    if is_metric:
        if indicator is not None:
            raise ValueError("indicator must be None with a metric: its sizes have no direction")
        request = metric_request(
            mesh, of_fields, h0, to_transfer.fields, norm=norm, max_aspect=max_aspect,
            interpolation_error=tolerance, **limits,
        )  # fmt: skip
    else:
        eta = None if indicator is None else as_indicator(indicator, mesh)
        request = SizeRequest(
            indicator=eta, h0=as_bound(cast("BoundLike | None", h0), mesh),
            error=None if eta is None else float(np.linalg.norm(eta)),
            order=order, tolerance=tolerance, max_refine=max_refine, max_coarsen=max_coarsen,
            **limits,
        )  # fmt: skip
        check_goal(request)
    coarsen_converged = as_flag("coarsen_converged", coarsen_converged)
    if to_transfer.cell_fields and conservative:
        FieldTransfer(mesh, mesh).refuse_surfaces()
    generator = choose_backend(backend, task, keep_facets=False, metric=is_metric).name
    options: dict[str, Any] = {
        "backend": generator,
        "target": "triangles" if task == "surface" else "auto",
        "tolerance": as_tolerance("boundary_tolerance", boundary_tolerance),
        "max_elements": as_number("max_elements", max_elements, lower=1.0, allow_inf=True),
        "timeout": None
        if timeout is None
        else as_number("timeout", timeout, lower=0.0, strict=True),
    }
    with reporting(progress) as report:
        report("sizes", None)
        if generator != "gmsh":  # it has no tolerance
            request = request.within(mesh, options["tolerance"])
        sizes = request.next(mesh, calibration(generator, mesh.cell_dim))
        decision = decide_remeshing(mesh, sizes, request, enough, coarsen_converged)
        if not decision.remesh:
            made = NewMesh(mesh)
        else:
            options["progress"] = report
            sizes, made = make_mesh(mesh, sizes, request, options)
            if project is None and made.boundary_distance > options["tolerance"] * mesh.diagonal:
                # The text is constant, so that Python shows the warning once.
                warnings.warn(
                    "the boundary of the new mesh is farther from the old one than "
                    "boundary_tolerance (see report.boundary_distance), which adds "
                    "up in a loop; pass project= for a curved boundary, or lower "
                    "boundary_tolerance",
                    ResolutionWarning,
                    stacklevel=2,
                )
            if project is not None:
                made = made.projected(project, corner_angle)
        return result_of(mesh, sizes, request, decision, made, to_transfer, generator, report)


def _check_numbers(
    order: float, max_refine: float, max_coarsen: float, norm: float, max_aspect: float
) -> None:
    """Check numbers of which requests of sizes and of a metric each use some only."""
    check_factors(order, max_refine, max_coarsen)
    as_number("norm", norm, lower=1.0, allow_inf=True)
    as_aspect("max_aspect", max_aspect)


def _task(mesh: SimplexMesh) -> _Task:
    """Return the meshing task."""
    check_type("mesh", mesh, SimplexMesh)
    kind = (mesh.cell_dim, mesh.dim)
    if kind == (3, 3):
        return "tetrahedra"
    if kind == (2, 2):
        return "plane triangles"
    if kind == (2, 3):
        return "surface"
    raise ValueError(f"mesh must be a SimplexMesh of triangles or tetrahedra, got {describe(mesh)}")
