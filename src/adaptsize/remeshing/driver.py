"""``remesh``: a new mesh from a mesh and a size function."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_index_array, refusal, warn_caller
from adaptsize._messages import Message
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.errors import (
    BackendError,
    BackendTimeoutError,
    InputWarning,
    MeshingError,
    ResolutionWarning,
    TooManyElementsError,
)
from adaptsize.geometry.planes import is_in_plane
from adaptsize.geometry.solid import Solid
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import RemeshOptions, checked, with_options
from adaptsize.quality.connections import refuse_repeated_cells
from adaptsize.remeshing import netgen
from adaptsize.remeshing.acceptance import (
    Judge,
    refuse_flat,
    warn_of_deviation,
    warn_of_lost_tags,
)
from adaptsize.remeshing.attempts import (
    Attempts,
    Best,
    Budget,
    Candidate,
    best_of,
    worst_places,
)
from adaptsize.remeshing.delivery import delivered, warn_of_unconnected, without_fields
from adaptsize.remeshing.filling import FILLS_MORE, MANY_MORE, Filling, improved_soundly
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.in_parts import remesh_parts
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.planning import Attempt, Known, plan
from adaptsize.remeshing.preparation import (
    Frame,
    RepairedMesh,
    repair_mesh,
    restore,
    surface_to_fill,
)
from adaptsize.remeshing.protocol import Backend, Problem, Task
from adaptsize.remeshing.registry import able_backends, available_backends, choose_backend
from adaptsize.remeshing.resolution import RequestedSizes, as_request
from adaptsize.remeshing.sizing import (
    MetricAt,
    SizeLike,
    as_metric_at,
    as_size,
    mean_size,
    metric_on,
)
from adaptsize.remeshing.surface_checks import warn_of_surface
from adaptsize.remeshing.through_surface import has_folded_cells, refilled
from adaptsize.sizes import Enclosed, predict
from adaptsize.typing import FloatArray, IntArray, ProgressCallback, Unpack

M = TypeVar("M", SimplexMesh, PartitionedMesh, SimplexMesh | PartitionedMesh)


@with_options(RemeshOptions)
def remesh(
    mesh: M,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
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
        ``strict`` and no mesh meets the demands.

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
        If ``strict`` and the first mesh did not meet the demands, with what was tried.  If Mmg
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
    fault that another generator may cure: cells that overlap, nodes that have left the boundary,
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
    adaptsize.errors.TooManyElementsError: the sizes require about 2.31e+10 elements, ...
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    if isinstance(mesh, PartitionedMesh):
        given = mesh.ranks.agree(lambda: checked(RemeshOptions, options))
        if required_facets is not None:
            raise ValueError("required_facets must be None for meshes in parts")
        with reporting(progress if mesh.ranks.rank == 0 else None) as report:
            one: Any = partial(remesh, **(given | RemeshOptions(backend="mmg")), progress=report)
            return remesh_parts(mesh, cast(npt.ArrayLike, size), one, given)  # type: ignore
    return remeshed(mesh, size, required_facets, progress=progress, **options).mesh


class Remeshed(NamedTuple):
    """A new mesh, and how it was made."""

    mesh: SimplexMesh
    attempts: Attempts


def remeshed(
    mesh: SimplexMesh,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
    required_facets: npt.ArrayLike | None = None,
    *,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[RemeshOptions],
) -> Remeshed:
    """Return what `remesh` returns of a mesh in one part, and what was tried."""
    given = checked(RemeshOptions, options)
    job = _prepared(without_fields(as_mesh("mesh", mesh)), size, required_facets, given)
    with reporting(progress) as report:
        found = job.attempts(IsolatedRunner(job.chosen.name, None, None, report))
    best = _accepted(found, job.task, given)
    job.warn_of(best.mesh)
    new = best.mesh
    if job.required is None:  # beside facets that must not change, no sizes can be followed
        asked = job.sizes
        new = delivered(new, asked.given, asked.at, asked.on, asked.metric, asked.metric_on)
    return Remeshed(new, found)


def _prepared(
    mesh: SimplexMesh,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
    required_facets: npt.ArrayLike | None,
    given: RemeshOptions,
) -> _Job:
    """Return the request after all checks and repairs, with warnings of what was repaired."""
    task = _task(mesh, given["target"])
    if mesh.cell_dim == mesh.dim:
        refuse_repeated_cells(mesh)
        warn_of_unconnected(mesh)
    metric = as_metric_at(size, mesh, given["hmax"])
    _check_metric(metric, task, strict=given["strict"])
    chosen = choose_backend(
        given["backend"], task, keep_facets=required_facets is not None, metric=metric is not None
    )
    sizes = cast(SizeLike, size) if metric is None else mean_size(metric, mesh.cell_dim)
    wanted = as_size(sizes, mesh, g=given["g"], hmax=given["hmax"])
    repaired = repair_mesh(mesh)
    if repaired.repairs:
        warn_caller(repaired.repairs, InputWarning)
    solid, may_be_joined, old = None, False, repaired.mesh
    if task == "surface to tetrahedra":
        solid = Solid(old)
        may_be_joined = warn_of_surface(old, given["tolerance"] * old.diagonal, solid)
        repaired = surface_to_fill(repaired, solid)
    job = _Job(
        task, chosen, repaired.mesh, old, solid,
        RequestedSizes(
            wanted, sizes, mesh, given["g"], given["hmax"], metric, metric_on(size, mesh)
        ),
        _required(required_facets, mesh, repaired), given, may_be_joined,
    )  # fmt: skip
    job.n_cells = _number_of_cells(mesh, size, job.problem(chosen.name, 1.0))
    job.refuse_too_many()
    return job


@dataclass
class _Job:
    """A request after checks and repairs, and how the routes of its attempts make meshes."""

    task: Task
    chosen: Backend
    """The first generator to be tried."""
    mesh: SimplexMesh
    """The repaired mesh; of a surface to be filled, the facets that bound the solid."""
    old: SimplexMesh
    """The repaired mesh with all facets, with which a new one is compared."""
    solid: Solid | None
    sizes: RequestedSizes
    required: IntArray | None
    given: RemeshOptions
    may_be_joined: bool = False
    """Whether bodies are closer to each other than the tolerance."""
    n_cells: float = 0.0

    def __post_init__(self) -> None:
        self._problems: dict[tuple[bool, float], Problem] = {}

    def problem(self, backend: str, factor: float) -> Problem:
        """Return the request to a generator, with a tolerance over the allowed one."""
        key = backend == "mmg", factor
        if key not in self._problems:
            self._problems[key] = as_request(
                self.task, self.mesh, self.frame, self.sizes, factor * self.given["tolerance"],
                self.required, is_by_mmg=backend == "mmg",
            )  # fmt: skip
        return self._problems[key]

    def refuse_too_many(self) -> None:
        """Raise a TooManyElementsError if too many elements are predicted."""
        most = self.given["max_elements"]
        if self.n_cells > most:
            raise TooManyElementsError(
                Message(
                    "the sizes require about {:.3g} elements, more than {max_elements} = {:.3g}; "
                    "increase the sizes or raise {max_elements}",
                    *(self.n_cells, most),
                )
            )

    @cached_property
    def frame(self) -> Frame:
        """The coordinates in which generators work."""
        return Frame.around(self.old)

    def attempts(self, run: IsolatedRunner) -> Attempts:
        """Return what was tried, and the best mesh."""
        given, strict = self.given, self.given["strict"]
        is_compared = self.sizes.metric is None and self.required is None
        compared = self.sizes.at if is_compared else None
        judge = Judge(self.old, self.solid, compared, given["tolerance"], strict)
        return best_of(
            plan(self.known(), strict=strict), self.solve, judge, Budget(given["timeout"]), run,
            strict=strict, always=self.solid is not None,
        )  # fmt: skip

    def warn_of(self, new: SimplexMesh) -> None:
        """Warn of what a mesh has lost, which is an error if ``strict``."""
        if self.given["strict"]:
            return
        allowed = self.given["tolerance"] * self.old.diagonal
        warn_of_deviation(new, self.mesh, allowed, self.solid, may_be_joined=self.may_be_joined)
        warn_of_lost_tags(new, self.mesh, self.chosen.name)

    def known(self) -> Known:
        """Return what decides the routes."""
        chosen, metric = self.chosen, self.sizes.metric is not None
        names = [chosen.name]
        if self.given["backend"] == "auto":
            keep = self.required is not None
            able = able_backends(self.task, keep_facets=keep, metric=metric)
            names += [one.name for one in able if one.installed and one.name != chosen.name]
        solid = self.solid
        return Known(
            self.task, tuple(names), chosen.needs_volume, self.n_cells, self.mesh.n_cells,
            self.given["tolerance"],
            can_fill=solid is not None and netgen.can_fill(self.mesh),
            is_closed=solid is not None and solid.is_closed,
            is_crossed=self.is_crossed,
            is_folded=self.task == "tetrahedra" and has_folded_cells(self.mesh),
        )  # fmt: skip

    @property
    def is_crossed(self) -> bool:
        """Whether facets of the surface to be filled cross others."""
        # The boundary of a union replaces bodies that overlap, if it could be made.
        solid = self.solid
        return solid is not None and solid.is_divided and self.mesh is not solid.skin

    @cached_property
    def filling(self) -> Filling:
        """The routes that begin with a first volume."""
        problem = self.problem("tetwild", 1.0)
        surface = problem.mesh
        if self.solid is not None and self.is_crossed:
            surface = self.frame.mesh(self.solid.skin)
        return Filling(problem, surface, self.n_cells, self.given["max_elements"])

    def solve(self, attempt: Attempt, run: IsolatedRunner) -> Iterator[Candidate]:
        """Yield the meshes of an attempt, in the given coordinates."""
        backend = available_backends()[attempt.backend]
        if attempt.first is None or self.task == "tetrahedra":
            found = self._alone(attempt, backend, run)
        else:
            found = self.filling.candidates(attempt, backend, run)
        for finish, note in found:
            yield Candidate(partial(self._restored, finish, attempt.backend), note)

    def _restored(self, finish: Callable[[], SimplexMesh], backend: str) -> SimplexMesh:
        made = self.frame.restored(finish(), self.mesh)
        refuse_flat(made, backend)
        return made

    def _alone(
        self, attempt: Attempt, backend: Backend, run: IsolatedRunner
    ) -> Iterator[Candidate]:
        """Yield the mesh of one generator, improved unless it has a metric or required facets."""
        problem = self.problem(attempt.backend, attempt.factor)
        if attempt.first is None:
            new = restore(backend.solve(problem, run), problem, backend.name)
        else:
            new = refilled(problem, run)

        def finish() -> SimplexMesh:
            if problem.metric is not None or problem.facets.required.any():
                return new
            if self.solid is not None:
                return improved_soundly(new, self.filling.surface, problem.tolerance, problem.size)
            return improved(new, problem.mesh, problem.tolerance, problem.size)

        yield Candidate(finish, self._note_on(new.n_cells))

    def _note_on(self, n_cells: int) -> str:
        """Return a note if an open surface was filled by many more cells than predicted."""
        if self.solid is None or self.solid.is_closed or n_cells <= MANY_MORE * self.n_cells:
            return ""
        return f"{n_cells} elements instead of the predicted {self.n_cells:.3g}: {FILLS_MORE}"


def _accepted(found: Attempts, task: Task, given: RemeshOptions) -> Best:
    """Return the best mesh, with warnings on how it was made; raise if it must not be returned.

    Raises
    ------
    BackendError
        If there is no mesh, or cells of one that fills a surface overlap.
        BackendTimeoutError if the time was over before there was one.
    MeshingError
        If ``strict`` and the mesh does not meet all demands.
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
            text = f"no mesh meets the demands; tried {found.failures()}"
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
        text = (
            "size must not be a Metric for a surface to be filled: make tetrahedra first and "
            "remesh them, or pass {target:'triangles'}"
        )
        raise ValueError(Message(text))
    if strict:
        raise refusal("strict", "must be False with a Metric, whose cells are thin, got True")


def _task(mesh: SimplexMesh, target: str) -> Task:
    """Return the meshing task: from which cells to which cells."""
    mesh = as_mesh("mesh", mesh)
    given = (mesh.cell_dim, mesh.dim)
    if given == (3, 3) and target != "triangles":
        return "tetrahedra"
    if given == (2, 2) and target != "tetrahedra":
        return "plane triangles"
    if given == (2, 3):
        is_flat = target == "auto" and is_in_plane(mesh)
        return "surface" if target == "triangles" or is_flat else "surface to tetrahedra"
    if given[0] == 1:
        raise ValueError(
            f"mesh must consist of triangles or tetrahedra, got {mesh!r}; "
            "adaptsize.polygons returns the domain between closed lines in the plane"
        )
    raise refusal("target", f"{target!r} cannot be made from {mesh!r}")
