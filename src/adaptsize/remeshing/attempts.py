"""Attempts at a mesh, one after the other: the best mesh so far, within one budget of time."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, NamedTuple, TypeAlias

from adaptsize._checks import place_text
from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendError, BackendTimeoutError
from adaptsize.quality.certificate import MeshCheck
from adaptsize.remeshing import tuning
from adaptsize.remeshing.acceptance import Verdict
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.planning import Attempt

_LOGGER = logging.getLogger("adaptsize.remeshing")
#: Length of a failure in the message about all attempts.
_LONGEST = 120


class Candidate(NamedTuple):
    """A mesh that a route has made; of several, the later ones are better."""

    finish: Callable[[], SimplexMesh]
    """Returns the mesh, checked and with tags, or raises a BackendError."""
    note: str = ""
    """What a user should know if this mesh is returned."""
    complete: Callable[[], SimplexMesh | None] | None = None
    """Returns the mesh with the work that `finish` left undone because another attempt may follow;
    None if nothing was left."""


#: Yields the candidates of an attempt.
Solve: TypeAlias = Callable[[Attempt, IsolatedRunner], Iterator[Candidate]]


@dataclass(frozen=True)
class Tried:
    """An attempt, and what came of it."""

    route: str
    """The generators, and the factor of the tolerance if it is not 1."""
    reason: str
    """Why it was tried."""
    status: Literal["made", "met", "near", "missed", "failed", "timeout", "no time"]
    """``"made"``: a mesh that was not compared.  ``"no time"``: not begun."""
    text: str
    """What was missed, or how it failed."""
    seconds: float


class Best(NamedTuple):
    """The best mesh so far."""

    mesh: SimplexMesh
    verdict: Verdict | None
    """None if the mesh was not compared, since nothing else would have been tried."""
    route: str
    note: str
    alone: str | None = None
    """The generator, if a single one has followed the sizes from the given mesh on."""
    complete: Callable[[], SimplexMesh | None] | None = None
    """As of the candidate."""


@dataclass(frozen=True)
class Attempts:
    """What was tried, and the best mesh."""

    tried: tuple[Tried, ...]
    best: Best | None
    is_cut_short: bool
    """Whether the time was over before a mesh was accepted."""
    later: Callable[[], Attempts] | None = field(default=None, compare=False)
    """Returns the same with the best mesh improved and judged; None if that is done."""

    @property
    def check(self) -> MeshCheck | None:
        """How the best mesh compares with the given domain; None if it was not compared."""
        verdict = None if self.best is None else self.best.verdict
        return None if verdict is None else verdict.check

    def as_list(self) -> list[dict[str, Any]]:
        """Return the attempts as dictionaries, for JSON."""
        return [asdict(one) for one in self.tried]

    @property
    def is_stopped(self) -> bool:
        """Whether all attempts were stopped at their limits of time."""
        return all(one.status in ("timeout", "no time") for one in self.tried)

    def failures(self, *, but: str | None = None) -> str:
        """Return the routes that were tried but for one, and their faults, each fault once."""
        by_text: dict[str, list[str]] = {}
        for one in self.tried:
            if one.route != but:
                by_text.setdefault(_in_short(one.text), []).append(one.route)
        return "; ".join(f"{', '.join(routes)}: {text}" for text, routes in by_text.items())


def _in_short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


@dataclass(frozen=True)
class Budget:
    """The time for all attempts.

    Attributes
    ----------
    timeout : float or None
        Seconds for all attempts together.  None: only each child has limits.
    clock : callable
    """

    timeout: float | None = None
    clock: Callable[[], float] = time.monotonic
    start: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", self.clock())

    @property
    def left(self) -> float:
        """Seconds that are left."""
        if self.timeout is None:
            return math.inf
        return self.start + self.timeout - self.clock()

    def limits(self, attempt: Attempt, *, is_last: bool) -> tuple[float, float, float]:
        """Return the elapsed seconds of an attempt, and elapsed and processor time of each child.

        A child gets no more than is useful, and an attempt leaves time to others.  The last one
        gets all that is left of a time limit.
        """
        if is_last and self.timeout is not None:
            return self.left, math.inf, math.inf
        whole = self.left if is_last else tuning.SHARE_OF_TIME * self.left
        return whole, tuning.ELAPSED_OVER_PROCESSOR * attempt.seconds, attempt.seconds


def best_of(
    attempts: Sequence[Attempt],
    solve: Solve,
    judge: Callable[[SimplexMesh], Verdict],
    budget: Budget,
    run: IsolatedRunner,
    *,
    strict: bool = False,
    always: bool = False,
    most: float = math.inf,
) -> Attempts:
    """Return the best mesh of several attempts, which end once a mesh is accepted.

    The failure of a generator is an attempt, too.  A mesh is accepted if it has no fault that the
    attempts left may cure; with ``strict``, if it meets all requirements.

    Parameters
    ----------
    attempts : sequence of Attempt
    solve : callable
        Yields the candidates of an attempt.
    judge : callable
        Compares a mesh with the request.
    budget : Budget
    run : IsolatedRunner
        Its limits are those of each attempt.
    strict : bool
    always : bool
        Whether a mesh is also judged if no other attempt could follow.
    most : float
        A first mesh with more cells ends the attempts without being judged: see `Attempts.later`.
    """
    tried: list[Tried] = []
    failed: dict[str, BackendError] = {}
    best: Best | None = None
    is_stopped = False
    for number, attempt in enumerate(attempts):
        rest = attempts[number + 1 :]
        if not _is_useful(attempt, best, failed, strict=strict):
            continue
        if budget.left <= 0.0:
            tried.append(Tried(str(attempt), attempt.reason, "no time", "no time left", 0.0))
            return Attempts(tuple(tried), best, is_cut_short=True)
        _LOGGER.info("%s: %s", attempt, attempt.reason)
        began = budget.clock()
        is_last = not any(_is_useful(one, best, failed, strict=strict) for one in rest)
        whole, elapsed, processor = budget.limits(attempt, is_last=is_last)
        own = replace(
            run, backend=attempt.backend, deadline=began + whole, elapsed=elapsed,
            seconds=processor, timeout=budget.timeout if is_last and budget.timeout else whole,
        )  # fmt: skip
        made, error = _made(attempt, solve, own)
        is_stopped = isinstance(error, BackendTimeoutError)
        if made is not None and best is None and made.mesh.n_cells > most:
            tried.append(_record(attempt, None, error, budget.clock() - began, made=True))

            def later(best: Best = made) -> Attempts:
                whole = _completed(best, tried, judge, budget)
                return Attempts(tuple(tried), whole, is_cut_short=False)

            return Attempts(tuple(tried), made, is_cut_short=False, later=later)
        verdict = None
        matters = strict or always or best is not None or any(one.cures for one in rest)
        if made is not None and matters:
            verdict = judge(made.mesh)
            made = made._replace(verdict=verdict)
        if made is None:
            assert error is not None
            failed[attempt.route] = error
        elif best is None or _is_better(made, best, strict=strict):
            best = made
        tried.append(
            _record(attempt, verdict, error, budget.clock() - began, made=made is not None)
        )
        _LOGGER.info("%s: %s, %s", attempt, tried[-1].status, tried[-1].text)
    best = _completed(best, tried, judge, budget)
    return Attempts(tuple(tried), best, is_cut_short=is_stopped and budget.left <= 0.0)


def _is_useful(
    attempt: Attempt, best: Best | None, failed: dict[str, BackendError], *, strict: bool
) -> bool:
    """Return whether an attempt may give a better mesh than the best so far."""
    before = failed.get(attempt.route)
    if before is not None:
        # A smaller tolerance takes longer, and hardly helps a generator that fails.
        return best is None and not attempt.cures and not isinstance(before, BackendTimeoutError)
    if best is None:
        return True
    if best.verdict is None or not attempt.cures:
        return False
    if strict:
        return not best.verdict.check.is_met
    return bool(best.verdict.faults & attempt.cures)


def _made(
    attempt: Attempt, solve: Solve, run: IsolatedRunner
) -> tuple[Best | None, BackendError | None]:
    """Return the mesh of an attempt, and how it failed: then the mesh is one before the last."""
    candidates: list[Candidate] = []
    error: BackendError | None = None
    try:
        for candidate in solve(attempt, run):
            candidates.append(candidate)  # those before a failure count
    except BackendError as failure:
        error = failure
    for candidate in reversed(candidates):
        try:
            mesh = candidate.finish()
        except BackendError as failure:
            error = error or failure
            continue
        note = candidate.note
        if note and error is not None:
            note = f"{note}: {error}"
        alone = attempt.backend if attempt.first is None and attempt.is_sized else None
        return Best(mesh, None, str(attempt), note, alone, candidate.complete), error
    return None, error or BackendError(f"{attempt} has made no mesh")


def _completed(
    best: Best | None,
    tried: list[Tried],
    judge: Callable[[SimplexMesh], Verdict],
    budget: Budget,
) -> Best | None:
    """Return the best mesh with what was left undone for an attempt that gave no better one.

    That one may have failed, or have been left out.  The record of the mesh is renewed.  Where no
    time is left, the mesh stays as it is.
    """
    if best is None or best.complete is None or budget.left <= 0.0:
        return best
    began = budget.clock()
    try:
        mesh = best.complete()
    except BackendError:  # as it is, the mesh is good enough to be returned
        return best
    if mesh is None:
        return best
    made = best._replace(mesh=mesh, verdict=judge(mesh), complete=None)
    assert made.verdict is not None
    if not _is_better(made, best, strict=False):
        return best
    number = [one.route for one in tried].index(best.route)
    tried[number] = replace(
        tried[number],
        status=made.verdict.check.status,
        text=made.verdict.text,
        seconds=tried[number].seconds + budget.clock() - began,
    )
    _LOGGER.info("%s, completed: %s", best.route, made.verdict.text)
    return made


def _is_better(made: Best, best: Best, *, strict: bool) -> bool:
    assert made.verdict is not None
    if best.verdict is None or (strict and made.verdict.check.is_met):
        return True
    return made.verdict.rank < best.verdict.rank


def _record(
    attempt: Attempt,
    verdict: Verdict | None,
    error: BackendError | None,
    seconds: float,
    *,
    made: bool,
) -> Tried:
    name, failure = (str(attempt), attempt.reason), "" if error is None else str(error)
    if verdict is not None:
        text = ", ".join(filter(None, [verdict.text, failure]))
        return Tried(*name, verdict.check.status, text, seconds)
    if made:
        return Tried(*name, "made", failure, seconds)
    is_timeout = isinstance(error, BackendTimeoutError)
    return Tried(*name, "timeout" if is_timeout else "failed", failure, seconds)


def worst_places(verdict: Verdict) -> str:
    """Return the worst place of each requirement that is not met."""
    return ", ".join(
        f"{requirement.name} at {place_text(requirement.places[0].point)}"
        for requirement in verdict.check.failures
        if requirement.places
    )
