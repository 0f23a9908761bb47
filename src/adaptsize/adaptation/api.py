"""`adapt`: one adaptation cycle."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy.typing as npt

from adaptsize._checks import as_flag, as_number, check_type, describe
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation._fields import as_fields
from adaptsize.adaptation.boundary_moves import (
    ProjectionLike,
    check_projection,
)
from adaptsize.adaptation.new_mesh import NewMesh, make_mesh
from adaptsize.adaptation.next_sizes import (
    BoundLike,
    Decision,
    NextSizes,
    SizeRequest,
    as_bound,
    as_indicator,
    check_goal,
    decide_remeshing,
    next_sizes,
)
from adaptsize.adaptation.report import (
    AdaptReport,
    lost_tags,
)
from adaptsize.adaptation.transfer import FieldTransfer
from adaptsize.background import SimplexMesh
from adaptsize.errors import ResolutionWarning
from adaptsize.quality import size_conformity
from adaptsize.remeshing.registry import choose_backend
from adaptsize.sizes.budget import calibration
from adaptsize.typing import GradientLimit, ProgressCallback

Fields: TypeAlias = Mapping[str, npt.ArrayLike]
Arrays: TypeAlias = dict[str, npt.NDArray[Any]]
_Task: TypeAlias = Literal["tetrahedra", "plane triangles", "surface"]


@dataclass(frozen=True)
class AdaptResult:
    """What `adapt` returns.

    Attributes
    ----------
    mesh : SimplexMesh
        The next mesh, with the transferred fields as its point and cell data.  It is the old
        mesh itself if ``remeshed`` is False.
    size : SizeFunction
        The requested sizes, on the old mesh.
    fields, cell_fields : dict of str to ndarray
        The fields on ``mesh``; unchanged if it is the old mesh.
    remeshed : bool
        Whether ``mesh`` is a new mesh.  False ends a loop.
    converged : bool
        Whether the old mesh meets the request: its error is within the tolerance, or its
        sizes and the number of its elements are as requested.
    reason : str
        Why the mesh was remeshed, or why not.
    report : AdaptReport
        ``print(result.report)`` prints a few lines.
    """

    mesh: SimplexMesh
    size: SizeFunction
    fields: Arrays
    cell_fields: Arrays
    remeshed: bool
    converged: bool
    reason: str
    report: AdaptReport

    def __str__(self) -> str:
        """Return the reason and the report."""
        return f"{self.reason}\n{self.report}"


def adapt(
    mesh: SimplexMesh,
    indicator: npt.ArrayLike | None = None,
    *,
    order: float = 1,
    h0: BoundLike | None = None,
    target_elements: float | None = None,
    tolerance: float | None = None,
    g: GradientLimit | None = 0.25,
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
        ``tolerance``, ``target_elements`` or both.
    order : float, default 1
        Order of convergence: the error is proportional to this power of the size, see
        `size_from_error`.
    h0 : SizeFunction, callable, array_like of float, shape (n_points,), or float, optional
        Upper bounds on the size, evaluated at the nodes of ``mesh``; inf where there is none.
        With ``indicator`` they are additional bounds.  Without it they are the requested sizes.
    target_elements : float, optional
        Number of cells of the next mesh, >= 1, after all limits.  With ``h0`` alone, the bounds
        are scaled to meet it.  With ``tolerance`` it is an upper limit.
    tolerance : float, optional
        Target for the total error, > 0.  The sizes are computed for 0.95 of it.
    g : float, array_like, callable, tuple or None, default 0.25
        Gradient limit, as in `limit_gradient`.  None disables gradient limiting.
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
    enough : float, default 0.85
        The mesh is not remeshed if all of these hold: it already has this share of the next mesh
        (edges within sqrt 2 of the new sizes, each weighted by the cells that replace it), no edge
        is 3 times too long, the number of cells would change by less than 15 %, and the
        tolerance does not need more cells.  A value above 1 always makes a new mesh.
    coarsen_converged : bool, default False
        Whether to remesh, and coarsen where possible, if the error is within the tolerance.
    boundary_tolerance : float
        Allowed distance of the new boundary from the old one, over the diagonal; see `remesh`.
    max_elements : float
        If the sizes require more elements than this, no generator is started.
    timeout : float or None
        Seconds after which a generator is stopped.  None disables the limit.
    progress : callable, bool or None
        Called with a text and the share done or None.  True shows a progress bar.  An exception
        in it, or Ctrl-C, stops the work.

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

    Notes
    -----
    The number of cells is predicted from measurements with the generator.  If the mesh misses the
    number by more than 15 % although the limits allow it, the prediction is corrected and another
    mesh is made.  Of up to three meshes the closest is returned.

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
    request = SizeRequest(
        indicator=as_indicator(indicator, mesh), h0=as_bound(h0, mesh), order=order,
        target_elements=target_elements, tolerance=tolerance, g=g, hmin=hmin, hmax=hmax,
        max_refine=max_refine, max_coarsen=max_coarsen,
    )  # fmt: skip
    check_goal(request)
    enough = as_number("enough", enough, lower=0.0)
    corner_angle = as_number("corner_angle", corner_angle, lower=0.0)
    if project is not None:
        check_projection(project)
    to_transfer = _FieldsToTransfer(
        as_fields("fields", fields, mesh.n_points),
        as_fields("cell_fields", cell_fields, mesh.n_cells),
        as_flag("conservative", conservative),
        as_flag("keep_integral", keep_integral),
    )
    coarsen_converged = as_flag("coarsen_converged", coarsen_converged)
    if to_transfer.cell_fields and conservative:
        FieldTransfer(mesh, mesh).refuse_surfaces()
    generator = choose_backend(backend, task, keep_facets=False).name
    options: dict[str, Any] = {
        "backend": generator,
        "target": "triangles" if task == "surface" else "auto",
        "tolerance": as_number("boundary_tolerance", boundary_tolerance, lower=0.0, strict=True),
        "max_elements": as_number("max_elements", max_elements, lower=1.0, allow_inf=True),
        "timeout": None
        if timeout is None
        else as_number("timeout", timeout, lower=0.0, strict=True),
    }
    with reporting(progress) as report:
        report("sizes", None)
        sizes = next_sizes(mesh, request, calibration(generator, mesh.cell_dim))
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
        return _result(mesh, sizes, request, decision, made, to_transfer, generator, report)


@dataclass(frozen=True)
class _FieldsToTransfer:
    """Fields to transfer, and how."""

    fields: Arrays
    cell_fields: Arrays
    conservative: bool
    keep_integral: bool


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


def _result(
    old: SimplexMesh,
    sizes: NextSizes,
    request: SizeRequest,
    decision: Decision,
    made: NewMesh,
    to_transfer: _FieldsToTransfer,
    generator: str,
    progress: ProgressCallback,
) -> AdaptResult:
    """Return fields on the new mesh, and the report."""
    size, new = SizeFunction(old, sizes.h), made.mesh
    fields, cell_fields = to_transfer.fields, to_transfer.cell_fields
    how: dict[str, str] = {}
    integrals: dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]] = {}
    if decision.remesh:
        transfer = FieldTransfer(old, new, progress=progress)
        fields = {name: transfer.nodal(values) for name, values in to_transfer.fields.items()}
        cell_fields = {
            name: transfer.cells(
                values,
                conservative=to_transfer.conservative,
                keep_integral=to_transfer.keep_integral,
            )
            for name, values in to_transfer.cell_fields.items()
        }
        how, integrals = _how_transferred(transfer, to_transfer, cell_fields)
        new = new.with_data(point_data=fields, cell_data=cell_fields)
    before = size_conformity(old, size)
    after = size_conformity(new, size) if decision.remesh else before
    lost = lost_tags(old, new)
    if lost:
        warnings.warn(
            f"the new mesh has lost {', '.join(lost)}: parts smaller than the sizes vanish",
            ResolutionWarning,
            stacklevel=3,
        )
    report = AdaptReport(
        n_points_before=old.n_points, n_points_after=new.n_points,
        n_cells_before=old.n_cells, n_cells_after=new.n_cells,
        backend=generator, n_meshes=made.n_meshes,
        target_elements=request.target_elements, tolerance=request.tolerance,
        predicted_elements=sizes.predicted, error=request.error,
        share_in_band=decision.in_band, share_too_long=decision.too_long,
        share_too_short=decision.too_short, before=before, after=after,
        measure_before=float(old.measures.sum()), measure_after=float(new.measures.sum()),
        boundary_distance=made.boundary_distance, moves=made.moves,
        lost_tags=lost, kept_tags=old.cell_tags is not None or old.facet_tags is not None,
        transferred=how, integrals=integrals,
    )  # fmt: skip
    return AdaptResult(
        new, size, fields, cell_fields, decision.remesh, decision.converged, decision.reason, report
    )


def _how_transferred(
    transfer: FieldTransfer, to_transfer: _FieldsToTransfer, cell_fields: Arrays
) -> tuple[dict[str, str], dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]]]:
    """Return how fields were transferred, and the integrals of cell fields."""
    how = {}
    integrals = {}
    for name, values in to_transfer.fields.items():
        how[name] = "nearest node" if values.dtype.kind in "biu" else "interpolated"
    for name, values in to_transfer.cell_fields.items():
        how[name] = "value at the centroid"
        if values.dtype.kind in "biu":
            continue
        if to_transfer.conservative:
            how[name] = "conservative"
        integrals[name] = transfer.integrals(values, cell_fields[name])
    return how, integrals
