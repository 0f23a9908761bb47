"""``remesh``: a new mesh from a mesh and a size function."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_index_array
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.errors import InputWarning, TooManyElementsError
from adaptsize.geometry.solid import Solid
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import RemeshOptions, checked, with_options
from adaptsize.remeshing.acceptance import (
    remesh_strictly,
    routes,
    warn_of_deviation,
    warn_of_lost_tags,
)
from adaptsize.remeshing.delivery import delivered
from adaptsize.remeshing.filling import filled
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.in_parts import remesh_parts
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.preparation import (
    Frame,
    RepairedMesh,
    repair_mesh,
    restore,
    surface_to_fill,
)
from adaptsize.remeshing.protocol import Backend, Problem, Task
from adaptsize.remeshing.registry import choose_backend
from adaptsize.remeshing.resolution import RequestedSizes, as_request
from adaptsize.remeshing.sizing import (
    MetricAt,
    SizeLike,
    as_metric_at,
    as_size,
    mean_size,
)
from adaptsize.remeshing.surface_checks import warn_of_surface
from adaptsize.sizes import Enclosed, predict
from adaptsize.typing import IntArray, ProgressCallback, Unpack

M = TypeVar("M", SimplexMesh, PartitionedMesh)

#: Processor time, in all and per cell, after which the generator is stopped: two hundred times what
#: is usual.  It hardly ends where the tolerance is far too small for the sizes.
_LONGEST = 60.0
_LONGEST_PER_CELL = 0.02


@with_options(RemeshOptions)
def remesh(
    mesh: M,
    size: SizeLike | Metric | MetricFunction,
    *,
    required_facets: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[RemeshOptions],
) -> M:
    """Return a new mesh of the same domain with the requested edge lengths.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Tetrahedra, triangles in the plane, or triangles in space; in parts only the former two,
        by Mmg and with sizes at the nodes, of functions or a number.  A surface
        to be filled with tetrahedra may have defects: it may be open, self-intersecting
        or non-manifold, and have several components.
    size : SizeFunction, callable, array_like of float, shape (n_points,), or float
        Requested edge length, finite and positive, in the unit of the coordinates.
        A callable takes float64[n, dim] points and returns n sizes.  Its gradient is
        not limited here: apply `limit_gradient` first.

        Or sizes that depend on the direction (Mmg only): a `Metric` at the nodes of ``mesh``, a
        `MetricFunction`, or a callable that returns a Metric.  Apply `limit_metric` first.
    required_facets : array_like of int, shape (n, cell_dim), optional
        Facets of ``mesh`` that must not change (Mmg only).
    progress : callable, bool or None
        Called with a text and None while generators work.  True shows a progress bar.
    **options

    Returns
    -------
    SimplexMesh or PartitionedMesh
        Cells of full dimension are positively oriented, and each node is used.  ``cell_tags``
        and the names of tags are kept.  If ``mesh`` has ``tagged_facets``, the result has them
        for the same parts of the boundary and interfaces.  Point and cell data are not
        transferred.

    Raises
    ------
    ValueError
        If an argument is invalid, or a size is not finite and positive.
    TooManyElementsError
        If the estimated number of elements is above ``max_elements``.
    BackendUnavailableError
        If no installed generator can do this.  The message says how to install one.
    BackendError
        If the generator failed.  The message has its last lines of output.
        BackendTimeoutError if it was stopped at ``timeout``, MeshingError if ``strict`` and no
        mesh meets the demands.

    Warns
    -----
    InputWarning
        If points of a surface were merged or triangles dropped.
    OpenSurfaceWarning
        If a surface to be filled is open, or has bodies that overlap or are closer to each other
        than the tolerance: what it encloses is then decided by the generator.  See `close_holes`.
        Bodies that overlap become their union.  Also if facets are inside of the solid, as between
        bodies that share them: no interface is kept there.
    BoundaryWarning
        If the boundary of the mesh is farther from the given one than 4 times the tolerance, or
        has another topology: thin parts may be lost.  If cells overlap.
    ResolutionWarning
        If less than 80 % of the elements that a source, a curved face or a narrow region requests
        were made, because the cells there are too large.
        If ``strict`` and the first mesh did not meet the demands, with what was tried.  If
        fTetWild failed and was run again with a quarter of the tolerance.  Also if Mmg fails or
        takes too long inside a surface: the tetrahedra are then those that Netgen fills it with.

    Notes
    -----
    Guaranteed are the checks above, positive cells, and regions and tags.  Mmg keeps regions and
    tags exactly.  For fTetWild they are looked up in the old mesh, within the tolerance.

    No generator guarantees the tolerance, or that the edges have the requested lengths, which
    `size_conformity` measures.  Mmg gives the same mesh for the same input, fTetWild another one in
    each run.  To fill a surface, Mmg starts from a first mesh by Netgen or fTetWild.

    Generators run in child processes in a temporary directory.  Their crashes, output
    and files do not affect the caller, and Ctrl-C stops them.

    References
    ----------
    .. [1] Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast tetrahedral
       meshing in the wild", ACM Trans. Graph. 39 (2020) 117.
    .. [2] C. Dapogny, C. Dobrzynski, P. Frey, "Three-dimensional adaptive domain
       remeshing, implicit domain meshing, and applications to free and moving
       boundary problems", J. Comput. Phys. 262 (2014) 358-378.

    Examples
    --------
    The unit square with a size of 0.1 (with Mmg installed):

    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> fine = remesh(square, 0.1)
    >>> bool((fine.signed_measures > 0).all()), float(fine.measures.sum().round(9))
    (True, 1.0)

    A size that requires too many elements is refused before any generator starts:

    >>> remesh(square, 1e-5)
    Traceback (most recent call last):
    ...
    adaptsize.errors.TooManyElementsError: the sizes require about 2.31e+10 elements, ...
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    given = mesh.ranks.agree(lambda: checked(RemeshOptions, options))
    if isinstance(mesh, PartitionedMesh):
        if required_facets is not None:
            raise ValueError("required_facets must be None for meshes in parts")
        with reporting(progress if mesh.ranks.rank == 0 else None) as report:
            one: Any = partial(remesh, **(given | RemeshOptions(backend="mmg")), progress=report)
            return remesh_parts(mesh, cast(npt.ArrayLike, size), one, given)  # type: ignore
    task, tolerance = _task(mesh, given["target"]), given["tolerance"]
    metric = as_metric_at(size, mesh, given["hmax"])
    _check_metric(metric, task, strict=given["strict"])
    chosen = choose_backend(
        given["backend"], task, keep_facets=required_facets is not None, metric=metric is not None
    )
    sizes = cast(SizeLike, size) if metric is None else mean_size(metric, mesh.cell_dim)
    wanted = as_size(sizes, mesh, g=given["g"], hmax=given["hmax"])
    repaired = repair_mesh(mesh)
    if repaired.repairs:
        warnings.warn(repaired.repairs, InputWarning, stacklevel=3)
    if given["strict"]:
        attempt: Callable[..., SimplexMesh] = partial(
            remesh, mesh, sizes, required_facets=required_facets, progress=progress,
            **(given | RemeshOptions(strict=False)),
        )  # fmt: skip
        ways = routes(task, given["backend"], chosen.name, keep_facets=required_facets is not None)
        strict = remesh_strictly(attempt, repaired.mesh, wanted, tolerance, ways, given["timeout"])
        return delivered(strict, sizes, wanted, mesh, metric)
    allowed = tolerance * repaired.mesh.diagonal
    frame, solid, may_be_joined = Frame.around(repaired.mesh), None, False
    if task == "surface to tetrahedra":
        solid = Solid(repaired.mesh)
        may_be_joined = warn_of_surface(repaired.mesh, allowed, solid)
        repaired = surface_to_fill(repaired, solid)
    required = _required(required_facets, mesh, repaired)
    wanted_sizes = RequestedSizes(wanted, sizes, mesh, given["g"], given["hmax"], metric)
    problem = as_request(
        task, repaired.mesh, frame, wanted_sizes, tolerance, required,
        is_by_mmg=chosen.name == "mmg",
    )  # fmt: skip
    n_cells = _number_of_cells(mesh, size, problem)
    if n_cells > given["max_elements"]:
        raise TooManyElementsError(
            f"the sizes require about {n_cells:.3g} elements, more than max_elements = "
            f"{given['max_elements']:.3g}; increase the sizes or raise max_elements"
        )
    problem = replace(problem, seconds=_LONGEST + _LONGEST_PER_CELL * n_cells)
    with reporting(progress) as report:
        timeout = given["timeout"]
        deadline = None if timeout is None else time.monotonic() + timeout
        run = IsolatedRunner(chosen.name, timeout, deadline, report)
        new = _solved(problem, chosen, run, n_cells, given["max_elements"], _union(solid, frame))
    made = frame.restored(new, repaired.mesh)
    warn_of_deviation(made, repaired.mesh, allowed, solid, may_be_joined=may_be_joined)
    warn_of_lost_tags(made, repaired.mesh, chosen.name)
    if required is not None:  # beside facets that must not change, no sizes can be followed
        return made
    return delivered(made, sizes, wanted, mesh, metric)


def _solved(
    problem: Problem,
    chosen: Backend,
    run: IsolatedRunner,
    n_cells: float,
    max_elements: float,
    union: SimplexMesh | None,
) -> SimplexMesh:
    """Return the mesh of a generator, improved unless it is anisotropic or has required facets."""
    if problem.task == "surface to tetrahedra" and chosen.needs_volume:
        return filled(problem, chosen, run, n_cells, max_elements, union)
    new = restore(chosen.solve(problem, run), problem, chosen.name)
    if problem.metric is not None or problem.facets.required.any():
        return new
    return improved(new, problem.mesh, problem.tolerance, problem.size)


def _union(solid: Solid | None, frame: Frame) -> SimplexMesh | None:
    """Return the boundary of a solid if its bodies overlap, in the coordinates of the part."""
    return None if solid is None or not solid.is_divided else frame.mesh(solid.skin)


def _required(
    value: npt.ArrayLike | None, mesh: SimplexMesh, repaired: RepairedMesh
) -> IntArray | None:
    """Return the facets to keep as node numbers of the repaired mesh."""
    if value is None:
        return None
    facets = as_index_array("required_facets", value, mesh.n_points, width=mesh.cell_dim)
    return repaired.node_map[facets] if len(facets) else None


def check_backend(mesh: SimplexMesh, target: str = "auto", backend: str = "auto") -> None:
    """Raise at once what `remesh` would raise for a target or a backend that cannot be used.

    For callers that spend time on the sizes first.
    """
    choose_backend(backend, _task(mesh, target), keep_facets=False)


def _number_of_cells(mesh: SimplexMesh, size: object, problem: Problem) -> float:
    """Return the number of cells that the sizes predict."""
    assert problem.size is not None
    if problem.task != "surface to tetrahedra":
        return predict(problem.mesh, problem.size(problem.mesh.points)).cells
    if isinstance(size, SizeFunction) and size.report is not None:
        nodes = size.background.points[: mesh.n_points]  # of its refined copy, the given ones first
        if np.array_equal(nodes, mesh.points):
            return size.report.n_elements
    # So many points are enough to find out whether there are too many elements.
    return predict(Enclosed(problem.mesh, 1000), problem.size).cells


def _check_metric(metric: MetricAt | None, task: Task, *, strict: bool) -> None:
    """Raise a ValueError if a metric is given that cannot be used."""
    if metric is None:
        return
    if task == "surface to tetrahedra":
        raise ValueError(
            "size must not be a Metric for a surface to be filled: make tetrahedra first and "
            "remesh them, or pass target='triangles'"
        )
    if strict:
        raise ValueError("strict must be False with a Metric, whose cells are thin, got True")


def _task(mesh: SimplexMesh, target: str) -> Task:
    """Return the meshing task: from which cells to which cells."""
    mesh = as_mesh("mesh", mesh)
    given = (mesh.cell_dim, mesh.dim)
    if given == (3, 3) and target != "triangles":
        return "tetrahedra"
    if given == (2, 2) and target != "tetrahedra":
        return "plane triangles"
    if given == (2, 3):
        return "surface" if target == "triangles" else "surface to tetrahedra"
    if given[0] == 1:
        raise ValueError(
            f"mesh must consist of triangles or tetrahedra, got {mesh!r}; "
            "adaptsize.polygons returns the domain between closed lines in the plane"
        )
    raise ValueError(f"target {target!r} cannot be made from {mesh!r}")
