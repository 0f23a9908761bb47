"""``remesh``: a new mesh from a mesh and a size function."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeVar, cast

import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import refusal, warn_caller
from adaptsize._progress import reporting
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.errors import (
    BackendError,
    BackendTimeoutError,
    ConnectionWarning,
    MeshingError,
    ResolutionWarning,
)
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import RemeshOptions, checked, with_options
from adaptsize.quality.by_place import RequestedElements
from adaptsize.remeshing.attempts import (
    Attempts,
    Best,
    Budget,
    worst_places,
)
from adaptsize.remeshing.delivery import warn_of_lacks, warn_of_metric, without_fields
from adaptsize.remeshing.in_parts import remesh_parts
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.job import Job, prepared, task_of
from adaptsize.remeshing.periodic import refuse_unperiodic, remesh_periodic
from adaptsize.remeshing.protocol import Task
from adaptsize.remeshing.registry import choose_backend
from adaptsize.remeshing.sizing import Size, SizeLike
from adaptsize.typing import FloatArray, IntArray, ProgressCallback, Unpack

M = TypeVar("M", SimplexMesh, PartitionedMesh, SimplexMesh | PartitionedMesh)


@recorded("remesh")
@with_options(RemeshOptions)
def remesh(
    mesh: M,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
    *,
    required_facets: npt.ArrayLike | None = None,
    periodic: npt.ArrayLike | None = None,
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
    periodic : array_like of float, shape (k, dim) or (k, dim, dim + 1), optional
        Translations or rotations [R | t] by which the domain is repeated, as in `limit_gradient`.
        Nodes and facets on opposite sides match in the result, as they must in ``mesh`` (Mmg only).
    progress : callable, bool or None
        Called with a text and None while generators work.  True shows a progress bar.
    **options

    Returns
    -------
    SimplexMesh or PartitionedMesh
        Cells of full dimension are positively oriented, and each node is used.  ``cell_tags``
        and the names of tags are kept.  If ``mesh`` has ``tagged_facets``, the result has them
        for the same parts of the boundary and interfaces.  Point and cell data are left out:
        `transfer_fields` returns them on the new mesh.

    Raises
    ------
    ValueError
        If an argument is invalid, or a size is not finite and positive.
    TooManyElementsError
        If the estimated number of elements is above ``max_elements``.
    BackendUnavailableError
        If no installed generator can do this.  The message says how to install one.
    BackendError
        If no generator made a mesh.  The message lists what was tried, with the last lines of
        output.  BackendTimeoutError if they were stopped at their limits of time, MeshingError if
        ``strict`` and no mesh meets the requirements.

    Warns
    -----
    InputWarning
        If points of a surface were merged or triangles dropped.  If the mesh has fields other than
        the sizes h, h0 and metric, which the new one lacks.  If cells side by side are not
        connected: parts whose nodes at one place are not joined, or nodes in the middle of an edge
        (hanging nodes).  Slits are none of these.
    OpenSurfaceWarning
        If a surface to be filled is open, or has bodies that overlap or are closer to each other
        than the tolerance: what it encloses is then decided by the generator.  See `close_holes`.
        Bodies that overlap become their union.  Also if facets are inside of the solid, as between
        bodies that share them: no interface is kept there.
    BoundaryWarning
        If the boundary of the mesh is farther from the given one than 4 times the tolerance, or
        has another topology: thin parts may be lost.  If cells overlap.
    ResolutionWarning
        If less than 80 % of the elements that a source, a curved face, a narrow region or a metric
        requests were made, because the cells there are too large.  If the first layer on a wall
        has not the height that a metric requests.  If edges of a plane boundary are shorter than an
        eighth of their size, because it has smaller details.
        If ``strict`` and the first mesh did not meet the requirements, with what was tried.  If Mmg
        fails or takes too long inside a surface: the tetrahedra are then those that Netgen fills it
        with.  If ``timeout`` was reached: the mesh is the best one so far.

    Notes
    -----
    Guaranteed are the checks above, positive cells, and regions and tags.  Mmg keeps regions and
    tags exactly.  For fTetWild they are looked up in the old mesh, within the tolerance.

    No generator guarantees the tolerance, or that the edges have the requested lengths, which
    `size_conformity` measures.  Mmg gives the same mesh for the same input, fTetWild another one in
    each run.  To fill a surface, Mmg starts from a first mesh by Netgen or fTetWild.

    Several routes are planned from what is known of the input.  They are tried until a mesh has no
    fault that another generator may cure: cells that overlap, nodes or few facets off the boundary,
    another topology, or dihedral angles below 2 degrees.  The best mesh is returned.  A failure of
    a generator is one attempt.

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
    adaptsize.errors.TooManyElementsError: the sizes require about 23000000000 elements, ...
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    if isinstance(mesh, PartitionedMesh):
        given = mesh.ranks.agree(lambda: checked(RemeshOptions, options))
        if required_facets is not None or periodic is not None:
            raise ValueError("required_facets and periodic must be None for meshes in parts")
        with reporting(progress if mesh.ranks.rank == 0 else None) as report:
            of_mmg: RemeshOptions = {**given, "backend": "mmg"}

            def one(
                whole: SimplexMesh,
                sizes: FloatArray,
                required_facets: IntArray | None = None,
                **changed: Unpack[RemeshOptions],
            ) -> SimplexMesh:
                own: RemeshOptions = {**of_mmg, **changed}
                return remeshed(whole, sizes, required_facets, progress=report, **own).mesh

            return remesh_parts(mesh, cast(npt.ArrayLike, size), one, given)
    return remeshed(mesh, size, required_facets, periodic, progress=progress, **options).mesh


class Remeshed(NamedTuple):
    """A new mesh, and how it was made."""

    mesh: SimplexMesh
    attempts: Attempts
    job: Job | None = None
    """The request; None if nothing is to be warned of."""
    elements: RequestedElements | None = None
    """The requested elements at the places of the mesh, if they were found for the warnings."""

    def warned(self) -> Remeshed:
        """Warn of what the mesh lacks; return it with what was found."""
        self.warn_of_domain()
        return self._replace(elements=self.warn_of_sizes())

    def completed(self) -> Remeshed:
        """Return the mesh improved, judged and with warnings, if that was postponed."""
        if self.attempts.later is None or self.job is None:
            return self
        found = self.attempts.later()
        best = _accepted(found, self.job.requests.task, self.job.given)
        return Remeshed(best.mesh, found, self.job).warned()

    def warn_of_domain(self) -> None:
        """Warn of what the mesh has lost of the domain."""
        if self.job is not None:
            self.job.warn_of(self.mesh)

    def warn_of_sizes(self, whole: SimplexMesh | None = None) -> RequestedElements | None:
        """Warn of what the mesh, or the whole of which it is a part, lacks of the sizes."""
        if self.job is None or (whole is None and self.job.requests.required is not None):
            return None  # beside facets that stay, no sizes can be followed
        mesh, requests = self.mesh if whole is None else whole, self.job.requests
        sizes = requests.sizes
        if sizes.metric is None:
            return warn_of_lacks(mesh, sizes.given, sizes.at, sizes.on)
        warn_of_metric(mesh, sizes.metric, sizes.metric_on, requests.served_by(mesh))
        return None


def remeshed(
    mesh: SimplexMesh,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
    required_facets: npt.ArrayLike | None = None,
    periodic: npt.ArrayLike | None = None,
    *,
    progress: ProgressCallback | bool | None = None,
    most: float = math.inf,
    **options: Unpack[RemeshOptions],
) -> Remeshed:
    """Return what `remesh` returns of a mesh in one part, and what was tried.

    If the mesh has more than ``most`` cells, improvement, judgement and warnings are postponed: see
    `Remeshed.completed`.
    """
    made = trial(mesh, size, required_facets, periodic, progress=progress, most=most, **options)
    return made if made.attempts.later is not None else made.warned()


def trial(
    mesh: SimplexMesh,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
    required_facets: npt.ArrayLike | None = None,
    periodic: npt.ArrayLike | None = None,
    *,
    progress: ProgressCallback | bool | None = None,
    most: float = math.inf,
    **options: Unpack[RemeshOptions],
) -> Remeshed:
    """Return the same for a mesh that may be thrown away: it is not compared with the request."""
    given = checked(RemeshOptions, options)
    if periodic is not None:
        refuse_unperiodic(task_of(mesh, given["target"]), required_facets, given)
    job = prepared(without_fields(as_mesh("mesh", mesh)), size, required_facets, given)
    job = replace(job, most=most)
    with reporting(progress) as report:
        if periodic is not None:
            found = _periodic(job, periodic, given, report)
        else:
            found = job.attempts(IsolatedRunner(job.chosen.name, None, None, report))
    if found.later is not None and found.best is not None:
        return Remeshed(found.best.mesh, found, job)
    best = _accepted(found, job.requests.task, given)
    return Remeshed(best.mesh, found, job)


def _periodic(
    job: Job, motions: npt.ArrayLike, given: RemeshOptions, report: ProgressCallback
) -> Attempts:
    """Return the attempts at the last of the meshes that `remesh_periodic` makes."""
    if job.requests.sizes.metric is not None:
        raise refusal("periodic", "cannot be combined with a Metric")
    budget, last = Budget(given["timeout"]), [Attempts((), None, is_cut_short=False)]

    def one(mesh: SimplexMesh, size: Size, required: IntArray) -> SimplexMesh:
        left = None if given["timeout"] is None else max(budget.left, 1e-3)
        own: RemeshOptions = {**given, "backend": "mmg", "hmax": math.inf, "timeout": left}
        with warnings.catch_warnings():  # the caller has been warned of the given mesh
            warnings.simplefilter("ignore", ConnectionWarning)
            step = prepared(mesh, size, required, own)
        last[0] = step.attempts(IsolatedRunner(step.chosen.name, None, None, report))
        try:
            return _accepted(last[0], job.requests.task, given).mesh
        except BackendError as error:
            raise _of_periodic(error, last[0], given["timeout"]) from error

    new = remesh_periodic(job.requests.mesh, motions, job.requests.sizes.at, one)
    best = last[0].best
    return last[0] if best is None else replace(last[0], best=best._replace(mesh=new))


def _of_periodic(error: BackendError, found: Attempts, timeout: float | None) -> BackendError:
    """Return the error for a mesh that the caller has not seen: cells that were moved."""
    if isinstance(error, BackendTimeoutError) and timeout is not None:
        return BackendTimeoutError(f"no periodic mesh within the time limit of {timeout:g} s")
    why = found.tried[0].text if found.tried else str(error)
    return BackendError(
        f"mmg made no periodic mesh of the cells, which were moved so that sides are inside: {why}."
        "  Smaller cells at the sides of the given mesh may help"
    )


def _accepted(found: Attempts, task: Task, given: RemeshOptions) -> Best:
    """Return the best mesh, with warnings on how it was made; raise if it must not be returned.

    Raises
    ------
    BackendError
        If there is no mesh, or cells of one that fills a surface overlap.
        BackendTimeoutError if the time was over before there was one.
    MeshingError
        If ``strict`` and the mesh does not meet all requirements.
    """
    best, timeout = found.best, given["timeout"]
    if best is None:
        kind = BackendTimeoutError if found.is_stopped else BackendError
        if len(found.tried) == 1:
            raise kind(found.tried[0].text)
        limit = f" within the time limit of {timeout:g} s" if found.is_cut_short else ""
        advice = "; a timeout gives more time" if timeout is None and found.is_stopped else ""
        raise kind(f"no generator made a mesh{limit}; tried {found.failures()}{advice}")
    verdict = best.verdict
    if given["strict"]:
        assert verdict is not None
        if not verdict.check.is_met:
            text = f"no mesh meets the requirements; tried {found.failures()}"
            places = worst_places(verdict)
            if places:
                text += f"; worst places of the best: {places}"
            raise MeshingError(text, verdict.check)
        others = found.failures(but=best.route)
        if others:
            warn_caller(f"made by {best.route} after {others}", ResolutionWarning)
    elif task == "surface to tetrahedra" and verdict is not None and not verdict.is_sound:
        raise BackendError(f"no generator made a sound mesh; tried {found.failures()}")
    if best.note:
        warn_caller(best.note, ResolutionWarning)
    if found.is_cut_short:
        text = "" if verdict is None or not verdict.text else f"; not reached: {verdict.text}"
        warn_caller(
            f"stopped at the time limit of {timeout:g} s with the mesh by {best.route}{text}",
            ResolutionWarning,
        )
    return best


def check_backend(mesh: SimplexMesh, target: str = "auto", backend: str = "auto") -> None:
    """Raise at once what `remesh` would raise for a target or a backend that cannot be used.

    For callers that spend time on the sizes first.
    """
    choose_backend(backend, task_of(mesh, target), keep_facets=False)
