"""A mesh with a given number of elements or nodes."""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_tolerance, checked_before, warn_again, warn_caller
from adaptsize._defaults import TOLERANCE
from adaptsize._messages import Message, message_of
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize._stopwatch import Stopwatch
from adaptsize.background import AnyBackground, SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.background.merging import reordered
from adaptsize.background.simplex import as_mesh
from adaptsize.domain_size import tuning
from adaptsize.domain_size.across_sides import limited_across_sides
from adaptsize.domain_size.budget import (
    nearest_to_budget,
    predicted_number,
    what_controls,
    within_budget,
)
from adaptsize.domain_size.by_domain import SizedDomain, mesh_domain
from adaptsize.domain_size.complete_size import sizes_of
from adaptsize.domain_size.goals import Goal, goal_of
from adaptsize.domain_size.prescribed import Implicit
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.request import Request
from adaptsize.domain_size.unknowns import as_bytes, memory_on, unknowns_on
from adaptsize.errors import (
    BackendError,
    OptionError,
    ResolutionWarning,
    TooManyElementsError,
)
from adaptsize.options import RemeshToElementsOptions, checked, options_of, with_options
from adaptsize.options.meshes import DetailOptions, MeshOptions
from adaptsize.options.sizes import BudgetOptions
from adaptsize.quality.by_place import RequestedElements
from adaptsize.remeshing import tuning as of_remeshing
from adaptsize.remeshing.attempts import Attempts
from adaptsize.remeshing.details import remove_details
from adaptsize.remeshing.driver import Remeshed, check_backend, remeshed
from adaptsize.remeshing.job import task_of
from adaptsize.remeshing.protocol import Task
from adaptsize.sizes.search import Search, Trial
from adaptsize.sizes.sources import SourcesLike
from adaptsize.typing import ProgressCallback, Unpack

_LOGGER = logging.getLogger(__name__)
#: The task in which a surface becomes tetrahedra.
_FILLED: Task = "surface to tetrahedra"


class MeshOfElements(NamedTuple):
    """A mesh, and the sizes that it was made for."""

    mesh: SimplexMesh
    size: SizeFunction

    def plot(self, **options: Any) -> Any:
        """Draw the mesh, with the options of `adaptsize.plot.plot_mesh`."""
        return self.mesh.plot(**options)

    @property
    def report(self) -> SizeReport:
        """The report on the sizes."""
        return report_of(self.size)


@recorded("remesh_to_elements", "mesh", "size")
@with_options(RemeshToElementsOptions)
def remesh_to_elements(
    mesh: SimplexMesh,
    elements: float | None = None,
    *,
    nodes: float | None = None,
    background: AnyBackground | None = None,
    sources: SourcesLike | None = (),
    h0: npt.ArrayLike | Implicit | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[RemeshToElementsOptions],
) -> MeshOfElements:
    """Return a mesh of a domain with a given number of elements or nodes, within 5 %.

    The sizes are those of `size_function` with this predicted number.  If the mesh has another
    number, new sizes are predicted from those made: at most three meshes are made, and the one
    with the nearest number is returned.  A plane mesh is refined before the second one.

    Parameters
    ----------
    mesh : SimplexMesh
        As in `remesh`.
    elements : float, optional
        Requested number of cells of the new mesh, >= 1.
    nodes : float, optional
        Requested number of nodes, >= 1.  Either this or ``elements``.
    background, sources, h0, progress
        As in `size_function`.
    **options
        Those of the sizes are kept if they are given, and relaxed or tightened if not.

    Returns
    -------
    MeshOfElements
        The mesh and its size function, whose ``report`` has the parameters chosen.

    Raises
    ------
    ValueError
        As in `size_function` and `remesh`.
    BackendError
        As in `remesh`.

    Warns
    -----
    ResolutionWarning
        If none of the meshes has a number within 5 %.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> mesh, size = remesh_to_elements(square, 1000)
    >>> 950 <= mesh.n_cells <= 1050
    True
    >>> 950 <= remesh_to_elements(square, nodes=1000).mesh.n_points <= 1050
    True
    """
    mesh = as_mesh("mesh", mesh)
    given = checked(RemeshToElementsOptions, options)
    check_backend(mesh, given["target"], given["backend"])
    if (elements is None) == (nodes is None):
        number = "none" if nodes is None else "both"
        raise OptionError(Message("one of {elements} and {nodes} must be given, got {}", number))
    if given["least_detail"] is not None:
        mesh = remove_details(mesh, given["least_detail"], crease_angle=given["crease_angle"]).mesh
    request = {
        **given,
        **{"elements": elements, "nodes": nodes},
        **{"background": background, "sources": sources, "h0": h0},
    }
    with checked_before():
        made = mesh_with_sizes(mesh, request, progress=progress)
    return MeshOfElements(made.mesh, made.size)


def _log(text: str) -> None:
    _LOGGER.info("%s", text)


@dataclass(frozen=True)
class Listener:
    """Functions that are called before a mesh is made, to inform the user."""

    say: Callable[[str], object] = _log
    """Takes a text: why another mesh is made."""
    show: Callable[[SizeFunction], object] = report_of
    """Takes each size function before its mesh is made."""


class MadeMesh(NamedTuple):
    """A mesh, the sizes that it was made for, and how it was made."""

    mesh: SimplexMesh
    size: SizeFunction
    attempts: Attempts | None = None
    excess: Message | None = None
    """Why the mesh has more elements than allowed; None if it has not."""
    warned: Sequence[warnings.WarningMessage] = ()
    """The warnings of this mesh, which are issued if it is returned."""
    elements: RequestedElements | None = None
    """The requested elements at the places of the mesh, if they were found for the warnings."""
    later: Callable[[], MadeMesh] | None = None
    """Returns the mesh improved and judged, with further warnings; None if that is done."""

    def completed(self) -> MadeMesh:
        """Return the mesh improved and judged, if that was postponed."""
        if self.later is None:
            return self
        whole = self.later()
        return whole._replace(excess=self.excess, warned=[*self.warned, *whole.warned])

    @property
    def is_cut_short(self) -> bool:
        """Whether the time was over before a mesh was accepted."""
        return self.attempts is not None and self.attempts.is_cut_short

    @property
    def alone(self) -> str | None:
        """The generator, if a single one has made it."""
        best = None if self.attempts is None else self.attempts.best
        return None if best is None else best.alone

    @property
    def follows_failures(self) -> bool:
        """Whether other routes were tried before."""
        return self.attempts is not None and len(self.attempts.tried) > 1

    @property
    def took_long(self) -> bool:
        """Whether the generators took so long that a better use of a cap is not worth it."""
        tried = () if self.attempts is None else self.attempts.tried
        return sum(one.seconds for one in tried) > tuning.LONG

    @property
    def is_off(self) -> bool:
        """Whether the boundary is so far away that the generator has made another surface."""
        check = None if self.attempts is None else self.attempts.check
        return check is not None and any(
            requirement.name == "boundary"
            and requirement.value is not None
            and requirement.limit is not None
            and requirement.value > of_remeshing.FARTHEST_BOUNDARY * requirement.limit
            for requirement in check.missed
        )


def mesh_with_sizes(
    mesh: SimplexMesh,
    request: Mapping[str, Any],
    *,
    listener: Listener | None = None,
    progress: ProgressCallback | bool | None,
) -> MadeMesh:
    """Return a mesh with the sizes of its domain, or the best of several for a requested number.

    Parameters
    ----------
    mesh : SimplexMesh
    request : mapping
        Options of `size_function` and of mesh generators, and further arguments of the former.
        Details are already removed.
    listener : Listener, optional
    progress : callable, bool or None
    """
    numbers = {name: request[name] for name in options_of(BudgetOptions) if name in request}
    budget = checked(BudgetOptions, numbers)
    goal = goal_of(budget)
    maker = Maker.of(mesh, request, listener or Listener(), progress, is_exact=goal is not None)
    system = budget["degree"], budget["components"]
    if goal is None:
        made = within_cap(maker, Cap(budget["max_elements"], budget["max_memory"], system))
    else:
        made = reach_number(maker, goal, system)
    warn_again(made.warned)
    return made


@dataclass(frozen=True)
class Cap:
    """What a mesh may have at most: elements, and memory of the matrix of a system on it."""

    elements: float | None
    memory: str | None = None
    system: tuple[int, int] = (1, 1)

    @property
    def most(self) -> float:
        """The number of elements beyond which another mesh is made."""
        return math.inf if self.elements is None else tuning.OVER_CAP * self.elements

    def load(self, mesh: SimplexMesh) -> float:
        """Return the elements or the memory over the allowed one, whichever is more; 0 without."""
        loads = [0.0] if self.elements is None else [mesh.n_cells / self.elements]
        if self.memory is not None:
            loads.append(memory_on(mesh, *self.system) / as_bytes(self.memory))
        return max(loads)

    def said_of(self, mesh: SimplexMesh) -> Message:
        """Return what a mesh has, and the number that it exceeds."""
        if self.elements is not None and mesh.n_cells / self.elements >= self.load(mesh):
            text = "{} elements, more than {max_elements} = {:.0f}"
            return Message(text, mesh.n_cells, self.elements)
        need = f"{memory_on(mesh, *self.system) / 1e9:.2g} GB for the matrix"
        return Message("{}, more than {max_memory} = {}", need, self.memory)


@dataclass(frozen=True)
class Maker:
    """Makes sizes and meshes of a domain for several numbers of elements."""

    mesh: SimplexMesh
    for_sizes: Mapping[str, Any]
    """Arguments of `size_function`."""
    for_mesh: Mapping[str, Any]
    """Arguments of `remesh`."""
    most: float | None
    """The largest number of elements that is allowed, None if none is given."""
    is_exact: bool
    """Whether a number of elements is requested."""
    listener: Listener
    progress: ProgressCallback | bool | None
    time: Stopwatch = field(default_factory=lambda: Stopwatch(None))
    domains: dict[float, SizedDomain] = field(default_factory=dict)
    """The domain of the sizes by the crease angle, once it is needed."""

    @classmethod
    def of(
        cls,
        mesh: SimplexMesh,
        request: Mapping[str, Any],
        listener: Listener,
        progress: ProgressCallback | bool | None,
        *,
        is_exact: bool,
    ) -> Maker:
        """Return what serves a request as of `mesh_with_sizes`."""
        for_mesh = {name: request[name] for name in options_of(MeshOptions) if name in request}
        if request.get("periodic") is not None:
            for_mesh["periodic"] = request["periodic"]
        apart = {*for_mesh, *options_of(DetailOptions), "periodic"}
        for_sizes = {name: value for name, value in request.items() if name not in apart}
        # Sizes may do without a tolerance, a mesh keeps to the boundary.
        for_mesh["tolerance"] = as_tolerance("tolerance", request.get("tolerance") or TOLERANCE)
        most = request.get("max_elements")
        return cls(
            mesh, for_sizes, for_mesh, most, is_exact, listener, progress,
            Stopwatch(for_mesh.get("timeout")),
        )  # fmt: skip

    def sized(self, **number: float) -> SizeFunction:
        """Return the sizes for another number than the one in the request, or for that."""
        return self._shown(self._computed(within_budget, {**self.for_sizes, **number}))

    def nearest_sized(self, cap: Cap, ratio: float, start: float = 1.0) -> SizeFunction:
        """Return the sizes within a cap, or the nearest that are possible.

        Their predicted numbers are multiplied by a ratio, which follows from the meshes before.
        The search begins with the relaxation ``start``.
        """
        given = dict(self.for_sizes)
        if cap.elements is not None:
            given["max_elements"] = max(cap.elements / ratio, 1.0)
        if cap.memory is not None:
            given["max_memory"] = f"{as_bytes(cap.memory) / ratio:.0f}B"
        size = self._computed(partial(nearest_to_budget, start=start), given)
        report = report_of(size)
        report = replace(
            report, n_elements=ratio * report.n_elements, n_nodes=ratio * report.n_nodes
        )
        return self._shown(replace(size, report=report))

    def _computed(
        self,
        choose: Callable[[SizedDomain, Request], SizeFunction],
        given: Mapping[str, Any],
    ) -> SizeFunction:
        """Return sizes, in a periodic domain those that are limited across its sides."""

        def find(request: Request) -> SizeFunction:
            with checked_before():
                return choose(self._domain(request.crease_angle), request)

        options = {name: value for name, value in given.items() if name != "background"}
        compute = partial(sizes_of, find, progress=self.progress)
        motions = self.for_mesh.get("periodic")
        if motions is None:
            return compute(**options)
        return limited_across_sides(self.mesh, motions, compute, options)

    def _domain(self, crease_angle: float) -> SizedDomain:
        """Return the domain of the sizes, the same one for all meshes.

        That of a surface is what is meshed: a crack between facets that nearly meet is no narrow
        gap, and facets inside of bodies bound no sizes where these are filled.
        """
        if crease_angle not in self.domains:
            is_filled = task_of(self.mesh, self.for_mesh.get("target", "auto")) == _FILLED
            self.domains[crease_angle] = mesh_domain(
                self.mesh, self.for_sizes.get("background"), crease_angle,
                tolerance=self.for_mesh["tolerance"], is_filled=is_filled,
            )  # fmt: skip
        return self.domains[crease_angle]

    def _shown(self, size: SizeFunction) -> SizeFunction:
        self.listener.show(size)
        return size

    def by(self, backend: str) -> Maker:
        """Return what makes meshes by one generator only, within the same time."""
        return replace(self, for_mesh={**self.for_mesh, "backend": backend})

    def meshed(
        self, size: SizeFunction, old: SimplexMesh | None = None, most: float = math.inf
    ) -> MadeMesh:
        """Return a mesh of given sizes, from the mesh of the domain or from another one.

        If it has more than ``most`` elements, it is neither improved nor judged at first.
        """
        # A cap is kept unless given parameters forbid it; a requested number is not capped.
        report = report_of(size)
        limit: dict[str, Any] = {}
        if self.most is not None or self.is_exact:
            limit["max_elements"] = max(
                self.most or 0.0, of_remeshing.MANY_MORE * report.n_elements
            )
        limit["timeout"] = self.time.for_next_mesh()
        given = {**self.for_mesh, **limit, "g": report.g, "hmax": report.hmax}
        if given.get("strict"):
            most = math.inf  # whether it meets the requirements decides what follows
        start = self.mesh if old is None else old
        return _made(
            size, partial(remeshed, start, size, progress=self.progress, most=most, **given)
        )


def _made(size: SizeFunction, make: Callable[[], Remeshed]) -> MadeMesh:
    """Return a mesh with its warnings, which are issued now if it fails."""
    held: Sequence[warnings.WarningMessage] = ()
    try:
        with checked_before(), warnings.catch_warnings(record=True) as held:
            warnings.simplefilter("always")
            new = make()
    except Exception:
        warn_again(held)  # they may say why it has failed
        raise
    later = None if new.attempts.later is None else partial(_made, size, new.completed)
    return MadeMesh(new.mesh, size, new.attempts, warned=held, elements=new.elements, later=later)


def within_cap(maker: Maker, cap: Cap) -> MadeMesh:
    """Return a mesh within a cap, up to 10 %, or one that exceeds it by little.

    If the first has more, up to two are made for fewer, where the boundary allows; of those that
    exceed the cap, the one with the fewest elements is returned.  If a mesh has much fewer than
    were predicted within the cap, since a generator has filled a surface in its own way, that makes
    another one for more.

    None is made if the time is over, or if the boundary of the first is known to be far away:
    neither coarser nor finer sizes bring it nearer.  A first mesh of too many elements is improved
    and judged only if it is returned.
    """
    first = maker.meshed(maker.sized(), most=cap.most)
    if cap.load(first.mesh) <= tuning.OVER_CAP:
        return _for_more(maker, cap, first)
    made, ratio = _for_fewer(maker, cap, first)
    made = made.completed()
    if made.excess is not None:
        return made
    # It may be by another generator, which the first would also have been left to.
    return _for_more(maker, cap, made, ratio)


def _for_fewer(maker: Maker, cap: Cap, made: MadeMesh) -> tuple[MadeMesh, float]:
    """Return a mesh with fewer elements than one that exceeds a cap, or the one with the fewest.

    The latter comes with the reason.  Also returned is the factor of the numbers predicted for the
    last mesh.  The sizes of each mesh are corrected by what became of those before: numbers that
    exceed a prediction fall more slowly than it.  If routes had failed before one generator alone
    made the first mesh, they are not tried again.
    """
    best, predicted = made, report_of(made.size).n_elements
    ratio = (made.mesh.n_cells / predicted) ** tuning.FALL
    first = Message("the mesh has {}", cap.said_of(made.mesh))
    if made.is_off or made.is_cut_short or maker.time.is_over:
        reason = "the boundary is too far away" if made.is_off else "the time is over"
        text = "{}; none is made for fewer, since {}"
        return made._replace(excess=Message(text, first, reason)), ratio
    text = "{}, where {:.0f} elements were predicted"
    maker.listener.say(Message(text, first, report_of(made.size).n_elements))
    if made.alone is not None and made.follows_failures:
        maker = maker.by(made.alone)
    excess, fewest, last = None, math.inf, made
    for _ in range(tuning.MESHES_FOR_FEWER):
        start = report_of(last.size).relaxation * cap.load(last.mesh) ** tuning.FURTHER
        size = maker.nearest_sized(cap, ratio, start)
        asked = report_of(size).n_elements
        before, predicted = predicted, asked / ratio
        expected = last.mesh.n_cells * (predicted / before) ** (1.0 / tuning.FALL)
        if expected > (1.0 - tuning.UNUSED) * best.mesh.n_cells:
            excess = excess or Message("{}: {}", first, what_controls(report_of(size)))
            break
        try:
            with warnings.catch_warnings(record=True):  # of a mesh that is not written
                last = new = maker.meshed(size, most=cap.most)
        except (TooManyElementsError, BackendError) as error:
            excess = excess or Message("{}, and for fewer: {}", first, message_of(error))
            break
        if cap.load(new.mesh) <= tuning.OVER_CAP:
            return new, ratio
        text = "{}, and for fewer {} elements: {}"
        fewest = min(fewest, new.mesh.n_cells)
        excess = Message(text, first, fewest, what_controls(report_of(size)))
        best = min(best, new, key=lambda one: cap.load(one.mesh))
        if maker.time.is_over:
            break
        ratio *= (new.mesh.n_cells / asked) ** tuning.FALL
    return best._replace(excess=excess), ratio


def _for_more(maker: Maker, cap: Cap, made: MadeMesh, scale: float = 1.0) -> MadeMesh:
    """Return a mesh with more elements than one that leaves much of a cap unused, if it does.

    Predictions are those of Mmg, times ``scale``.  In walls thinner than the sizes, fTetWild makes
    fewer cells.  A mesh that took long is not made again.
    """
    count, predicted = made.mesh.n_cells, report_of(made.size).n_elements
    ratio, fills = count / predicted, made.mesh.cell_dim > maker.mesh.cell_dim
    is_bound = cap.load(made.mesh) > (1.0 - tuning.NEAR) * ratio  # sizes were relaxed to the cap
    name = made.alone
    is_last = made.is_off or made.is_cut_short or maker.time.is_over or made.took_long
    if name is None or is_last or not fills or not is_bound or ratio > tuning.UNDER_CAP:
        return made
    text = "{} has made {} elements, where {:.0f} were predicted"
    maker.listener.say(Message(text, name, count, predicted))
    try:
        with warnings.catch_warnings(record=True):  # of a mesh that is not written
            second = maker.by(name).meshed(maker.nearest_sized(cap, scale * ratio))
    except (TooManyElementsError, BackendError):
        return made
    is_worse = second.is_cut_short or second.is_off
    is_nearer = count < second.mesh.n_cells and cap.load(second.mesh) <= tuning.OVER_CAP
    return second if is_nearer and not is_worse else made


def reach_number(maker: Maker, goal: tuple[Goal, float], system: tuple[int, int]) -> MadeMesh:
    """Return the best of up to three meshes, by their numbers of elements, nodes or unknowns.

    A mesh of triangles in the plane is refined if the first new mesh misses the number.  Mmg
    leaves edges as they are within sqrt 2 of the size, so from a mesh with edges of a few lengths
    it cannot make any number: of 800 triangles in a regular grid it makes 800 or 417, not 641.
    From short edges it builds all new ones.  It visits them in the order of the file, so that they
    are also numbered at random: from regular grids in order, numbers were off by up to 35 %, and
    by up to 6 % without order.

    Parameters
    ----------
    maker : Maker
    goal : tuple of str and float
        What there is a requested number of, and how large it is.
    system : tuple of int
        Degree and number of components, for unknowns.
    """
    what, requested = goal
    first = maker.meshed(maker.sized(**{what: requested}))
    meshes = _Meshes(goal, system, Search.by_meshes(requested, first.mesh.cell_dim))
    meshes.add(first)
    best_before, old = meshes.search.best, maker.mesh
    is_free = maker.for_mesh.get("periodic") is None
    if meshes.search.factor is not None and old.dim == old.cell_dim == 2 and is_free:
        old = without_order(old, first.size)
        # The first mesh says little about one from this.
        meshes = meshes.begun_again()
        meshes.add(maker.meshed(first.size, old))
    while (wanted := meshes.wanted) is not None:
        if meshes.is_last:
            maker.listener.say(meshes.progress(wanted))
        try:
            meshes.add(maker.meshed(maker.sized(**{what: wanted}), old))
        except (TooManyElementsError, BackendError):
            break  # fewer are predicted to be too few for the boundary, or cannot be made
    best = min(best_before, meshes.search.best, key=lambda trial: abs(meshes.miss(trial)))
    if not meshes.search.is_met(meshes.miss(best)):
        warn_caller(
            f"the mesh has {best.number:.0f} {what} instead of {requested:.6g}; the meshes had "
            f"{meshes.search.records}; {what_controls(report_of(best.result.size))}",
            ResolutionWarning,
        )
    return best.result


@dataclass(frozen=True)
class _Meshes:
    """Meshes made for a number, and what the next one is made for."""

    goal: tuple[Goal, float]
    system: tuple[int, int]
    search: Search[MadeMesh]

    def begun_again(self) -> _Meshes:
        """Return a search without the meshes so far, of which one counts."""
        before, requested = self.search, self.goal[1]
        cell_dim = before.best.result.mesh.cell_dim
        most = before.most - 1
        return replace(self, search=Search.by_meshes(requested, cell_dim, most=most))

    def add(self, made: MadeMesh) -> None:
        """Add a mesh."""
        what, requested = self.goal
        predicted = predicted_number(report_of(made.size), what, self.system)
        # Sizes larger by a factor s have s^-dim as many elements, and s^-cell_dim cells.
        factor = (predicted / requested) ** (-1.0 / made.mesh.dim)
        self.search.add(predicted, made, _number_on(made.mesh, what, self.system), factor)

    @property
    def wanted(self) -> float | None:
        """The number for which the next sizes are made; None if there is no next mesh."""
        factor = self.search.factor
        if factor is None:
            return None
        return max(self.goal[1] * factor**-self.search.best.result.mesh.dim, 1.0)

    @property
    def is_last(self) -> bool:
        """Whether only one more mesh can be made."""
        return len(self.search.trials) == self.search.most - 1

    def progress(self, wanted: float) -> str:
        """Return why the meshes so far are not near the number."""
        bound = what_controls(report_of(self.search.best.result.size))
        return (
            f"{self.goal[0]} so far: {self.search.records}; {bound}; the last mesh is made for "
            f"{wanted:.0f}"
        )

    def miss(self, trial: Trial[MadeMesh]) -> float:
        """Return the logarithm of a number that was made over the requested one."""
        return math.log(trial.number / self.goal[1])


def _number_on(mesh: SimplexMesh, what: Goal, system: tuple[int, int]) -> int:
    if what == "dofs":
        return int(unknowns_on(mesh, *system))
    return mesh.n_cells if what == "elements" else mesh.n_points


def without_order(mesh: SimplexMesh, size: SizeFunction) -> SimplexMesh:
    """Return triangles with edges of at most half the size, in a random order, always the same."""
    mesh = resolved(mesh, size, factor=0.5, accuracy=0.0, max_points=1e6).mesh
    rng = np.random.default_rng(mesh.n_cells)
    return reordered(mesh, rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells))
