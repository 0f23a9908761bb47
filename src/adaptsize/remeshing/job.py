"""One request to `remesh` after checks and repairs, and how its attempts make meshes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_index_array, count_text, refusal, warn_caller
from adaptsize._defaults import refused_above
from adaptsize._messages import Message
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.errors import InputWarning, TooManyElementsError
from adaptsize.geometry.planes import is_in_plane
from adaptsize.geometry.solid import Solid
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import RemeshOptions
from adaptsize.quality.boundary import farthest_places
from adaptsize.quality.by_place import RequestedElements
from adaptsize.quality.certificate import NEAR
from adaptsize.quality.connections import refuse_repeated_cells
from adaptsize.quality.elements import folded_cells, refuse_folded
from adaptsize.remeshing import netgen, tuning
from adaptsize.remeshing.acceptance import (
    Judge,
    refuse_flat,
    warn_of_deviation,
    warn_of_lost_tags,
)
from adaptsize.remeshing.attempts import Attempts, Budget, Candidate, best_of
from adaptsize.remeshing.delivery import warn_of_unconnected
from adaptsize.remeshing.filling import FILLS_MORE, NOT_ADAPTED, Filling, improved_soundly
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.meshed_surface import SurfaceToFill, surface_to_fill
from adaptsize.remeshing.planning import Attempt, Known, plan
from adaptsize.remeshing.preparation import (
    Frame,
    RepairedMesh,
    repair_mesh,
    restore,
)
from adaptsize.remeshing.protocol import TASKS, Backend, Enclosing, MeshingProblem, Task
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
from adaptsize.remeshing.surface import facets_of
from adaptsize.remeshing.surface_checks import warn_of_surface
from adaptsize.remeshing.through_surface import refilled
from adaptsize.sizes import Enclosed, predict
from adaptsize.sizes.budget import count_elements
from adaptsize.sizes.prediction import Prediction
from adaptsize.typing import FloatArray, IntArray

#: Distance of nodes that rounding alone has moved, over the diagonal.
_SAME_PLACE = 1e-12


def prepared(
    mesh: SimplexMesh,
    size: SizeLike | Metric | MetricFunction | Callable[[FloatArray], Metric],
    required_facets: npt.ArrayLike | None,
    given: RemeshOptions,
) -> Job:
    """Return the request after all checks and repairs, with warnings of what was repaired."""
    task = task_of(mesh, given["target"])
    if mesh.cell_dim == mesh.dim:
        refuse_repeated_cells(mesh)
        warn_of_unconnected(mesh)
    if task == "plane triangles":  # folded tetrahedra are filled anew
        refuse_folded(mesh)
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
    solid, to_fill, may_be_joined, old = None, None, False, repaired.mesh
    if task == "surface to tetrahedra":
        solid = Solid.of(old)
        may_be_joined = warn_of_surface(old, given["tolerance"] * old.diagonal, solid)
        # Where facets must not change, the surface is not made smooth.
        within = given["tolerance"] if required_facets is None else math.inf
        to_fill = surface_to_fill(mesh, within)
        repaired = to_fill.sound
    requests = Requests(
        task, repaired.mesh, Frame.around(old),
        RequestedSizes(
            wanted, sizes, mesh, given["g"], given["hmax"], metric, metric_on(size, mesh)
        ),
        given["tolerance"], _required(required_facets, mesh, repaired),
        to_fill,
        _first_of_loop(mesh, old, given) if solid is None else None,
    )  # fmt: skip
    predicted = _predicted(repaired.mesh, size, requests.to(chosen.name, 1.0))
    _refuse_too_many(predicted.cells, refused_above(given["max_elements"]))
    return Job(requests, chosen, old, solid, predicted, given, may_be_joined)


@dataclass(frozen=True)
class Requests:
    """The requests to the generators, each made when it is needed."""

    task: Task
    mesh: SimplexMesh
    """The repaired mesh; of a surface to be filled, the facets that bound the solid."""
    frame: Frame
    """The coordinates in which generators work."""
    sizes: RequestedSizes
    tolerance: float
    """The allowed one, over the diagonal."""
    required: IntArray | None
    """Facets that must not change."""
    to_fill: SurfaceToFill | None = None
    """The surface to be filled."""
    first: SimplexMesh | None = None
    """The mesh with which a loop began, repaired, whose boundary and interfaces have to be kept."""
    _made: dict[tuple[bool, float], MeshingProblem] = field(
        default_factory=dict, init=False, repr=False
    )

    def to(self, backend: str, factor: float) -> MeshingProblem:
        """Return the request to a generator, with a tolerance over the allowed one."""
        key = backend == "mmg", factor
        if key not in self._made:
            made = as_request(
                self.task, self.mesh, self.frame, self.sizes, factor * self.left * self.tolerance,
                self.required, is_by_mmg=backend == "mmg",
            )  # fmt: skip
            if self.crossed is not None:
                made = replace(made, enclosing=_enclosing(self.crossed, self.frame))
            self._made[key] = replace(made, is_rough=self.left < 1.0)
        return self._made[key]

    @property
    def crossed(self) -> Solid | None:
        """The solid of a surface to be filled whose facets cross; None where others do not."""
        to_fill = self.to_fill
        return None if to_fill is None or not to_fill.is_crossed else to_fill.solid

    @property
    def left(self) -> float:
        """The share of the tolerance that is left for the generators."""
        return 1.0 if self.to_fill is None else self.to_fill.left

    def kept_by(self, problem: MeshingProblem) -> SimplexMesh:
        """Return the mesh whose boundary and interfaces count, in the coordinates of generators.

        In a loop it is the first one.  If each mesh kept to the one before, they would drift away.
        """
        return problem.mesh if self.first is None else self.frame.mesh(self.first)

    def served_by(self, new: SimplexMesh) -> RequestedElements | None:
        """Return how a mesh serves the metric, if that was found when it was made."""
        frame = self.frame
        for problem in self._made.values():
            for made, found in problem.served:
                if np.array_equal(made.cells, new.cells) and np.allclose(
                    frame.to_own(new.points), made.points, rtol=0.0, atol=_SAME_PLACE
                ):
                    return found.scaled(frame.scale, frame.from_own(found.points))
        return None

    @property
    def follows_sizes(self) -> bool:
        """Whether the edges of a mesh are compared with sizes.

        Beside facets that must not change, no sizes can be followed.
        """
        return self.sizes.metric is None and self.required is None


@dataclass(frozen=True)
class Job:
    """A request after checks and repairs, and how the routes of its attempts make meshes."""

    requests: Requests
    chosen: Backend
    """The first generator to be tried."""
    old: SimplexMesh
    """The repaired mesh with all facets, with which a new one is compared."""
    solid: Solid | None
    """The solid of a surface to be filled."""
    predicted: Prediction
    """Numbers of the mesh."""
    given: RemeshOptions
    may_be_joined: bool = False
    """Whether bodies are closer to each other than the tolerance."""
    most: float = math.inf
    """Number of cells beyond which a mesh is not improved and judged at first, see `best_of`."""

    def attempts(self, run: IsolatedRunner) -> Attempts:
        """Return what was tried, and the best mesh."""
        given, strict = self.given, self.given["strict"]
        compared = self.requests.sizes.at if self.requests.follows_sizes else None
        judge = Judge(self.old, self.solid, compared, given["tolerance"], strict)
        return best_of(
            plan(self.known(), strict=strict), self.solve, judge, Budget(given["timeout"]), run,
            strict=strict, always=self.solid is not None, most=self.most,
        )  # fmt: skip

    def warn_of(self, new: SimplexMesh) -> None:
        """Warn of what a mesh has lost, which is an error if ``strict``."""
        if self.given["strict"]:
            return
        allowed = self.given["tolerance"] * self.old.diagonal
        mesh = self.requests.mesh
        warn_of_deviation(new, mesh, allowed, self.solid, may_be_joined=self.may_be_joined)
        warn_of_lost_tags(new, mesh, self.chosen.name)

    def known(self) -> Known:
        """Return what decides the routes."""
        requests, chosen, solid = self.requests, self.chosen, self.solid
        names = [chosen.name]
        if self.given["backend"] == "auto":
            keep, metric = requests.required is not None, requests.sizes.metric is not None
            able = able_backends(requests.task, keep_facets=keep, metric=metric)
            names += [one.name for one in able if one.installed and one.name != chosen.name]
        return Known(
            requests.task, tuple(names), chosen.needs_volume, self.predicted.cells,
            requests.mesh.n_cells, self.given["tolerance"],
            can_fill=solid is not None and netgen.can_fill(requests.mesh),
            is_closed=requests.to_fill is not None and requests.to_fill.solid.is_closed,
            is_crossed=requests.crossed is not None,
            # Mmg fails on these, or does not end.
            is_folded=requests.task == "tetrahedra" and bool(folded_cells(requests.mesh).any()),
        )  # fmt: skip

    @cached_property
    def filling(self) -> Filling:
        """The routes that begin with a first volume."""
        problem = self.requests.to("tetwild", 1.0)
        surface, to_fill = problem.mesh, self.requests.to_fill
        if to_fill is not None and (to_fill.is_crossed or to_fill.left < 1.0):
            surface = self.requests.frame.mesh(to_fill.solid.skin)
        max_elements = refused_above(self.given["max_elements"])
        left = self.requests.left
        return Filling(problem, surface, self.predicted, max_elements, self.most, left)

    def solve(self, attempt: Attempt, run: IsolatedRunner) -> Iterator[Candidate]:
        """Yield the meshes of an attempt, in the given coordinates."""
        backend = available_backends()[attempt.backend]
        if attempt.first is None or self.requests.task == "tetrahedra":
            found = self._alone(attempt, backend, run)
        else:
            found = self.filling.candidates(attempt, backend, run)
        for finish, note, complete in found:
            last = None if complete is None else partial(self._completed, complete, attempt.backend)
            yield Candidate(partial(self._restored, finish, attempt.backend), note, last)

    def _restored(self, finish: Callable[[], SimplexMesh], backend: str) -> SimplexMesh:
        made = self.requests.frame.restored(finish(), self.requests.mesh)
        refuse_flat(made, backend)
        return made

    def _completed(
        self, complete: Callable[[], SimplexMesh | None], backend: str
    ) -> SimplexMesh | None:
        made = complete()
        return None if made is None else self._restored(lambda: made, backend)

    def _alone(
        self, attempt: Attempt, backend: Backend, run: IsolatedRunner
    ) -> Iterator[Candidate]:
        """Yield the mesh of one generator, improved unless it has a metric or required facets."""
        problem = self.requests.to(attempt.backend, attempt.factor)
        if attempt.first is None:
            asked = problem if attempt.is_sized else replace(problem, size=None)
            new = restore(backend.solve(asked, run), problem, backend.name)
        else:
            new = refilled(problem, run)

        undone: list[bool] = []

        def better() -> SimplexMesh:
            if problem.metric is not None or problem.facets.required.any():
                return new
            if self.solid is not None:
                allowed = problem.tolerance / self.requests.left
                return improved_soundly(new, self.filling.surface, allowed, problem.size)
            kept = self.requests.kept_by(problem)
            return improved(new, kept, problem.tolerance, problem.size)

        def finish() -> SimplexMesh:
            if new.n_cells <= self.most:
                return better()
            undone.append(True)
            return new

        note = self._note_on(new.n_cells) if attempt.is_sized else NOT_ADAPTED
        yield Candidate(finish, note, lambda: better() if undone else None)

    def _note_on(self, n_cells: int) -> str:
        """Return a note if an open surface was filled by many more cells than predicted."""
        most = tuning.MANY_MORE * self.predicted.cells
        if self.solid is None or self.solid.is_closed or n_cells <= most:
            return ""
        predicted = count_text(self.predicted.cells)
        return f"{n_cells} elements instead of the predicted {predicted}: {FILLS_MORE}"


def _first_of_loop(mesh: SimplexMesh, old: SimplexMesh, given: RemeshOptions) -> SimplexMesh | None:
    """Return the repaired mesh with which a loop in space began; ``old`` is ``mesh`` repaired.

    None if its cells are of another kind, or if boundary and interfaces of the two are farther from
    each other than the tolerance: they have been moved since, as onto the true boundary, or one of
    the two is a part of the other, or too coarse.  With ``strict``, the present mesh alone counts.
    """
    first = mesh.original
    if first is None or first.cell_dim != mesh.cell_dim or given["strict"]:
        return None
    limit = (1.0 + NEAR) * given["tolerance"] * old.diagonal
    first = repair_mesh(first).mesh
    there, here = facets_of(first), facets_of(old)
    both = (there, here), (here, there)
    for one, other in both:  # takes little time, and finds most of what is far
        if other.locator.nearest(one.points[one.cells].mean(axis=1))[2].max() > limit:
            return None
    for one, other in both:
        if farthest_places(one, other, limit).distance.max() > limit:
            return None
    return first


def _enclosing(solid: Solid, frame: Frame) -> Enclosing:
    """Return what a solid tells a generator, in the coordinates of a frame."""
    return Enclosing(~solid.hidden, lambda points: solid.contains(frame.from_own(points)))


def _required(
    value: npt.ArrayLike | None, mesh: SimplexMesh, repaired: RepairedMesh
) -> IntArray | None:
    """Return the facets to keep as node numbers of the repaired mesh."""
    if value is None:
        return None
    facets = as_index_array("required_facets", value, mesh.n_points, width=mesh.cell_dim)
    return repaired.node_map[facets] if len(facets) else None


def _predicted(before: SimplexMesh, size: object, problem: MeshingProblem) -> Prediction:
    """Return the numbers that the sizes predict; of facets, only for a surface to be filled.

    ``before`` is its mesh before it got coordinates for generators.
    """
    if problem.task != "surface to tetrahedra":
        return Prediction(count_elements(problem.mesh, problem.sizes_at_nodes))
    if isinstance(size, SizeFunction) and size.report is not None:
        nodes = before.points  # the first ones of its refined copy
        if np.array_equal(size.background.points[: len(nodes)], nodes):
            return Prediction(size.report.n_elements, size.report.n_facets)
    # So many points are enough to find out whether there are too many elements.
    return predict(Enclosed(problem.mesh, 1000), problem.sizes)


def _refuse_too_many(n_cells: float, most: float) -> None:
    """Raise a TooManyElementsError if too many elements are predicted."""
    if n_cells > most:
        text = (
            "the sizes require about {} elements, more than {max_elements} = {:.0f}; increase "
            "the sizes or raise {max_elements}"
        )
        raise TooManyElementsError(Message(text, count_text(n_cells), most), n_cells)


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


def task_of(mesh: SimplexMesh, target: str) -> Task:
    """Return the meshing task: from which cells to which cells."""
    mesh = as_mesh("mesh", mesh)
    if mesh.cell_dim == 1:
        raise ValueError(
            f"mesh must consist of triangles or tetrahedra, got {mesh!r}; "
            "adaptsize.polygons returns the domain between closed lines in the plane"
        )
    kind = target
    if target == "auto":
        kind = "triangles" if mesh.dim == 2 or is_in_plane(mesh) else "tetrahedra"
    task = TASKS.get((mesh.cell_dim, mesh.dim, kind))
    if task is None:
        raise refusal("target", f"{target!r} cannot be made from {mesh!r}")
    return task
