"""Attempts at a mesh: the best one is returned, within the time, whatever a generator does."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_generators import FakeBackend
from shapes import block

from adaptsize.background import SimplexMesh
from adaptsize.errors import (
    BackendError,
    BackendTimeoutError,
    BoundaryWarning,
    MeshingError,
    ResolutionWarning,
)
from adaptsize.quality.certificate import MeshCheck, Requirement
from adaptsize.remeshing import register_backend, registry, remesh
from adaptsize.remeshing.acceptance import Judge, Verdict
from adaptsize.remeshing.attempts import Budget, Candidate, best_of
from adaptsize.remeshing.driver import remeshed
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.planning import CURABLE, Attempt
from adaptsize.remeshing.preparation import as_problem, restore
from adaptsize.remeshing.registry import able_backends, available_backends

CUBE = block(2)
ALONE = frozenset()


class Clock:
    """A clock that a fake generator advances."""

    now = 50.0

    def __call__(self):
        return self.now


class Fakes:
    """Generators that take a time, and then return a mesh of a quality or fail.

    ``stories`` has for each generator what it does: seconds, and the value of its boundary over the
    tolerance, an exception, or a list of these.
    """

    def __init__(self, **stories):
        self.stories, self.clock, self.angles = stories, Clock(), {}
        self.limits, self.meshes = {}, {}

    def plan(self, cures=CURABLE, seconds=100.0):
        first = True
        for name in self.stories:
            yield Attempt(name, f"why {name}", seconds, cures=CURABLE if first else cures)
            first = False

    def solve(self, attempt, run):
        deadline = min(run.deadline, self.clock.now + run.elapsed)
        self.limits[attempt.backend] = deadline - self.clock.now, run.seconds
        seconds, *made = self.stories[attempt.backend]
        if self.clock.now + seconds > deadline:
            self.clock.now = deadline
            raise BackendTimeoutError(f"{attempt.backend} was stopped")
        self.clock.now += seconds
        for value in made:
            if isinstance(value, Exception):
                raise value
            mesh = CUBE.moved(CUBE.points)
            self.meshes[id(mesh)] = mesh, value
            yield Candidate(lambda mesh=mesh: mesh, f"note of {value}")

    def judge(self, mesh):
        value = self.meshes[id(mesh)][1]
        status = "met" if value <= 1.0 else "near" if value <= 1.1 else "missed"
        requirement = Requirement("boundary", status, f"{value}", 1e-3 * value, 1e-3)
        return Verdict(MeshCheck((requirement,)), self.angles.get(value, 20.0), status == "missed")

    def run(self, *, timeout=None, strict=False, **options):
        runner = IsolatedRunner("none", None, None, lambda *_: None)
        found = best_of(
            list(self.plan(**options)), self.solve, self.judge, Budget(timeout, self.clock),
            runner, strict=strict,
        )  # fmt: skip
        self.value = None if found.best is None else self.meshes[id(found.best.mesh)][1]
        return found


def statuses(found):
    return [(one.route, one.status) for one in found.tried]


CRASH = BackendError("crash failed: crashed (SIGSEGV)")


@pytest.mark.parametrize("order", list(itertools.permutations(["good", "bad", "worse", "crash"])))
@pytest.mark.parametrize("strict", [False, True])
def test_the_best_mesh_is_returned_in_any_order_of_the_attempts(order, strict):
    stories = {"good": (1.0, 0.9), "bad": (1.0, 1.5), "worse": (1.0, 7.0), "crash": (1.0, CRASH)}
    fakes = Fakes(**{name: stories[name] for name in order})
    found = fakes.run(strict=strict)
    assert fakes.value == 0.9
    assert found.best.route == "good"
    tried = list(order[: order.index("good") + 1])  # nothing is tried after an accepted mesh
    assert [one.route for one in found.tried] == tried
    assert [one.reason for one in found.tried] == [f"why {name}" for name in tried]
    expected = {"good": "met", "bad": "missed", "worse": "missed", "crash": "failed"}
    assert statuses(found) == [(name, expected[name]) for name in tried]
    assert all("SIGSEGV" in one.text for one in found.tried if one.route == "crash")
    assert not found.is_cut_short
    assert json.loads(json.dumps(found.as_list()))[0]["route"] == order[0]


@pytest.mark.parametrize(
    ("follower", "timeout", "expected", "statuses_"),
    [
        ((1.0, CRASH), None, 0.9, ["met", "failed"]),
        ((999.0,), None, 0.9, ["met", "timeout"]),  # longer than its limit
        ((1.0, 0.5), 4.0, 5.0, ["missed", "no time"]),  # the time is over
        ((1.0, 7.0), None, 0.9, ["met", "missed"]),
        ((1.0, 0.5), None, 0.5, ["missed", "met"]),  # better: nothing is left to do
    ],
)
def test_a_mesh_given_up_is_completed_if_no_better_one_follows(
    follower, timeout, expected, statuses_
):
    fakes = Fakes(first=(4.0, 5.0), second=follower)
    finished = CUBE.moved(CUBE.points)
    fakes.meshes[id(finished)] = finished, 0.9
    asked, solve = [], fakes.solve

    def solve_and_give_up(attempt, run):
        if timeout is not None:
            run = replace(run, deadline=np.inf)
        for candidate in solve(attempt, run):
            give_up = attempt.backend == "first"
            yield candidate._replace(complete=complete if give_up else None)

    def complete():
        asked.append(fakes.clock.now)
        return finished

    fakes.solve = solve_and_give_up
    found = fakes.run(timeout=timeout)
    assert fakes.value == expected
    assert [one.status for one in found.tried] == statuses_
    assert len(asked) == (expected == 0.9)
    assert found.best.verdict.check.is_met == (expected < 1.0)


def test_a_mesh_of_too_many_cells_is_judged_later():
    fakes = Fakes(first=(4.0, 5.0), second=(1.0, 0.5))
    finished, judged, solve = CUBE.moved(CUBE.points), [], fakes.solve
    fakes.meshes[id(finished)] = finished, 0.9

    def judge(mesh):
        judged.append(mesh)
        return fakes.judge(mesh)

    def solve_and_leave(attempt, run):
        for candidate in solve(attempt, run):
            yield candidate._replace(complete=lambda: finished)

    runner = IsolatedRunner("none", None, None, lambda *_: None)
    given = list(fakes.plan()), solve_and_leave, judge, Budget(None, fakes.clock), runner
    found = best_of(*given, most=CUBE.n_cells - 1)
    assert statuses(found) == [("first", "made")]
    assert found.best.verdict is None
    assert judged == []
    whole = found.later()
    assert (whole.best.mesh, whole.later) == (finished, None)
    assert statuses(whole) == [("first", "met")]
    assert best_of(*given, most=CUBE.n_cells).later is None


def test_a_mesh_is_not_replaced_by_a_worse_or_failing_completion():
    failing = BackendError("flat cells")
    for what in (9.0, failing, None):
        fakes = Fakes(first=(1.0, 5.0), second=(1.0, CRASH))
        worse, solve = CUBE.moved(CUBE.points), fakes.solve
        fakes.meshes[id(worse)] = worse, what

        def complete(what=what, worse=worse):
            if what is failing:
                raise failing
            return None if what is None else worse

        fakes.solve = lambda attempt, run, solve=solve, complete=complete: (
            candidate._replace(complete=complete) for candidate in solve(attempt, run)
        )
        fakes.run()
        assert fakes.value == 5.0


def test_the_best_of_bad_meshes_is_returned():
    fakes = Fakes(worse=(1.0, 7.0), bad=(1.0, 1.5), crash=(1.0, CRASH), worst=(1.0, 9.0))
    found = fakes.run()
    assert (fakes.value, found.best.route) == (1.5, "bad")
    assert "worse: 7.0" in found.failures(but="bad").replace("boundary ", "")


def test_near_is_accepted_but_not_by_strict():
    stories = {"near": (1.0, 1.05), "met": (1.0, 1.0)}
    assert statuses(Fakes(**stories).run()) == [("near", "near")]
    strict = Fakes(**stories).run(strict=True)
    assert statuses(strict) == [("near", "near"), ("met", "met")]
    assert strict.best.route == "met"
    flat = Fakes(near=(1.0, 1.05), flat=(1.0, 0.9))  # flat cells are no requirement
    flat.angles = {0.9: 1.0}
    assert flat.run(strict=True).best.route == "flat"
    only = Fakes(near=(1.0, 1.05)).run(strict=True)
    assert not only.best.verdict.check.is_met


@pytest.mark.parametrize("timeout", [1.0, 30.0, 900.0])
def test_the_time_limit_is_kept_and_the_best_mesh_so_far_is_returned(timeout):
    fakes = Fakes(
        bad=(0.2 * timeout, 1.5), hang=(np.inf, 0.5), good=(1e9, 0.5), late=(0.1 * timeout, 0.4)
    )
    found = fakes.run(timeout=timeout, seconds=1e6)
    assert fakes.clock.now - Clock.now <= timeout * (1.0 + 1e-9)
    assert statuses(found)[:3] == [("bad", "missed"), ("hang", "timeout"), ("good", "timeout")]
    # Each leaves a third of the time left to the others; the last one gets the rest.
    left = [fakes.limits[name][0] / timeout for name in fakes.stories if name in fakes.limits]
    assert left[:3] == pytest.approx([2 / 3, 0.8 * 2 / 3, 0.8 * 2 / 9])
    assert left[3] == pytest.approx(0.8 / 9)
    assert found.is_cut_short
    assert fakes.value == 1.5


def test_attempts_that_would_begin_too_late_do_not_begin():
    fakes = Fakes(bad=(0.0, 1.5), good=(1.0, 0.5))
    budget = Budget(5.0, fakes.clock)

    def slow(mesh):
        fakes.clock.now += 10.0
        return Fakes.judge(fakes, mesh)

    run = IsolatedRunner("none", None, None, lambda *_: None)
    found = best_of(list(fakes.plan()), fakes.solve, slow, budget, run)
    assert statuses(found) == [("bad", "missed"), ("good", "no time")]
    assert found.is_cut_short
    assert found.best.route == "bad"


def test_without_a_time_limit_each_attempt_gets_what_is_useful():
    fakes = Fakes(hang=(np.inf, 0.5), good=(1.0, 0.5))
    found = fakes.run(seconds=20.0)
    assert statuses(found) == [("hang", "timeout"), ("good", "made")]
    assert fakes.limits == {"hang": (60.0, 20.0), "good": (60.0, 20.0)}
    assert not found.is_cut_short
    # A long limit is no reason to wait for a generator that hangs, while others may follow.
    fakes = Fakes(hang=(np.inf, 0.5), good=(1.0, 0.5))
    fakes.run(timeout=1e5, seconds=20.0)
    assert fakes.limits["hang"] == (60.0, 20.0)
    assert fakes.limits["good"] == (pytest.approx(1e5 - 60.0), np.inf)


def test_time_between_generators_takes_none_from_those_that_follow():
    fakes, left = Fakes(good=(50.0, 0.5)), []

    def solve(attempt, run):
        fakes.clock.now += 1000.0  # kernels are compiled, on a busy machine
        left.append(run.deadline - fakes.clock.now)
        return fakes.solve(attempt, run)

    run = IsolatedRunner("none", None, None, lambda *_: None)
    attempts = list(fakes.plan(seconds=20.0))
    assert statuses(best_of(attempts, solve, fakes.judge, Budget(None, fakes.clock), run)) == [
        ("good", "made")
    ]
    assert left == [np.inf]


def test_attempts_for_failures_only_are_left_out_once_there_is_a_mesh():
    assert statuses(Fakes(bad=(1.0, 7.0), good=(1.0, 0.5)).run(cures=ALONE)) == [("bad", "made")]
    found = Fakes(crash=(1.0, CRASH), good=(1.0, 0.5)).run(cures=ALONE)
    assert statuses(found) == [("crash", "failed"), ("good", "made")]


def test_a_mesh_from_before_a_failure_counts_and_says_so():
    found = Fakes(mmg=(1.0, 0.7, CRASH), other=(1.0, 0.5)).run()
    assert statuses(found) == [("mmg", "met")]
    assert found.best.note == f"note of 0.7: {CRASH}"
    assert str(CRASH) in found.tried[0].text


def test_a_failed_route_is_tried_again_with_another_tolerance_only_for_failures():
    def run(story, *factors_and_cures):
        fakes, seen = Fakes(one=story), []

        def solve(attempt, runner):
            seen.append(attempt.factor)
            return fakes.solve(attempt, runner)

        attempts = [Attempt("one", "", 10.0, factor=f, cures=c) for f, c in factors_and_cures]
        runner = IsolatedRunner("none", None, None, lambda *_: None)
        best_of(attempts, solve, fakes.judge, Budget(None, fakes.clock), runner, strict=True)
        return seen

    usual, again = (1.0, CURABLE), (0.25, ALONE)
    assert run((1.0, CRASH), usual, (0.4, CURABLE), again) == [1.0, 0.25]
    assert run((np.inf, 0.5), usual, (0.4, CURABLE), again) == [1.0]  # it would take longer
    assert run((1.0, 1.5), usual, (0.4, CURABLE), again) == [1.0, 0.4]


def test_an_interrupt_ends_all_attempts():
    fakes = Fakes(first=(1.0, KeyboardInterrupt()), good=(1.0, 0.5))
    fakes.stories["first"] = (1.0, KeyboardInterrupt())

    def solve(attempt, run):
        if attempt.backend == "first":
            raise KeyboardInterrupt
        return fakes.solve(attempt, run)

    run = IsolatedRunner("none", None, None, lambda *_: None)
    with pytest.raises(KeyboardInterrupt):
        best_of(list(fakes.plan()), solve, fakes.judge, Budget(None, fakes.clock), run)
    assert fakes.limits == {}


def check_of(**values):
    """Return a check with boundaries and shares over their limits, and missed requirements."""
    requirements = []
    for name, value in values.items():
        status = "met" if value <= 1.0 else "near" if value <= 1.1 else "missed"
        requirements.append(Requirement(name, status, "", 1e-3 * value, 1e-3))
    return MeshCheck(tuple(requirements))


#: From the best to the worst.
VERDICTS = [
    Verdict(check_of(boundary=0.9, edges=1.0), 20.0, False),
    Verdict(check_of(boundary=0.2, edges=1.0), 10.0, False),
    Verdict(check_of(boundary=1.05, edges=1.0), 20.0, False),
    Verdict(check_of(boundary=0.9, edges=2.0), 20.0, False),
    Verdict(check_of(boundary=0.9, edges=1.0), 1.0, False),
    Verdict(check_of(boundary=1.5, edges=1.0), 20.0, True),
    Verdict(check_of(boundary=2.5, edges=1.0), 30.0, True),
    Verdict(check_of(boundary=20.0, edges=1.0), 30.0, True),
    Verdict(check_of(boundary=1.5, topology=2.0), 20.0, True),
    Verdict(check_of(boundary=0.5, overlaps=2.0), 40.0, False),
]


def test_cells_come_before_the_domain_and_that_before_sizes_and_angles():
    ranks = [verdict.rank for verdict in VERDICTS]
    assert ranks == sorted(ranks)
    assert len(set(ranks)) == len(ranks)
    assert [bool(verdict.faults) for verdict in VERDICTS] == [False] * 4 + [True] * 6
    assert [verdict.is_sound for verdict in VERDICTS] == [True] * 9 + [False]


@pytest.mark.parametrize(("size", "off"), [(0.9, 0.0), (0.9, 0.05), (0.2, 0.0), (0.2, 0.05)])
def test_coarse_sizes_that_cut_corners_of_a_boundary_are_no_fault_of_a_generator(size, off):
    # A regular polygon in place of a circle: all its nodes are on the circle, the edges are not.
    def disc(n, radius=1.0):
        angle = 2.0 * np.pi * np.arange(n) / n
        ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        cells = [[n, k, (k + 1) % n] for k in range(n)]
        return SimplexMesh(np.vstack([ring, [[0.0, 0.0]]]), cells)

    round_, made = disc(400), disc(round(2.0 * np.pi / size), 1.0 + off)
    verdict = Judge(round_, None, None, 1e-2)(made)
    missed = [requirement.name for requirement in verdict.check.missed]
    assert ("boundary" in missed) == (size > 0.5 or off > 0.0)
    assert ("boundary" in verdict.faults) == (off > 0.0)


@pytest.fixture
def fakes(monkeypatch):
    """Return a function that replaces all generators by fakes in child processes."""
    monkeypatch.setattr(registry, "_BACKENDS", {})
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "support"))

    def register(**functions):
        for name, (function, options) in functions.items():
            register_backend(FakeBackend(function, tuple(options.items()), name=name))
        assert [one.name for one in able_backends("tetrahedra", keep_facets=False)] == [*functions]

    return register


COPY, TWICE, CRASHES = ("copy", {}), ("one_twice", {}), ("fail", {})


def test_of_a_crash_a_hang_a_bad_and_a_good_mesh_the_good_one_is_returned(fakes, tmp_path):
    hangs = ("hang_with_stray", {"pid_file": str(tmp_path / "pids")})
    fakes(crash=CRASHES, hang=hangs, bad=TWICE, good=COPY, never=COPY)
    problem = as_problem("tetrahedra", CUBE, 1e-3)

    def solve(attempt, run):
        raw = available_backends()[attempt.backend].solve(problem, run)
        yield Candidate(lambda: restore(raw, problem, attempt.backend))

    attempts = [
        Attempt(name, f"why {name}", 0.5 if name == "hang" else 60.0)
        for name in ("crash", "hang", "bad", "good", "never")
    ]
    judge = Judge(CUBE, None, lambda x: np.full(len(x), 0.55), 1e-3)
    run = IsolatedRunner("none", None, None, lambda *_: None, crowding=lambda: 1.0)
    found = best_of(attempts, solve, judge, Budget(), run)
    assert found.best.mesh.n_cells == CUBE.n_cells
    assert statuses(found) == [
        ("crash", "failed"), ("hang", "timeout"), ("bad", "missed"), ("good", "met"),
    ]  # fmt: skip
    assert [one.reason for one in found.tried] == [f"why {one.route}" for one in found.tried]
    assert "no luck" in found.tried[0].text
    assert 1.5 <= found.tried[1].seconds < 15.0  # three times the useful time, and ending it
    assert "overlaps 2 cells overlap others" in found.tried[2].text
    assert not found.is_cut_short


def test_generators_of_auto_are_tried_until_a_mesh_is_sound(fakes):
    fakes(crash=CRASHES, bad=TWICE, good=COPY, never=COPY)
    found = remeshed(CUBE, 0.55).attempts
    assert statuses(found) == [("crash", "failed"), ("bad", "missed"), ("good", "met")]
    assert all(one.reason for one in found.tried)


def test_at_the_time_limit_the_mesh_so_far_is_returned_with_a_warning(fakes, tmp_path):
    fakes(bad=TWICE, hang=("hang_with_stray", {"pid_file": str(tmp_path / "pids")}))
    with (
        pytest.warns(
            ResolutionWarning, match=r"stopped at the time limit of 3 s .* by bad"
        ) as seen,
        pytest.warns(BoundaryWarning, match="cells overlap others"),
        pytest.warns(BoundaryWarning, match="another topology"),
    ):
        made = remeshed(CUBE, 0.55, timeout=3.0)
    assert made.mesh.n_cells == CUBE.n_cells + 1
    assert made.attempts.is_cut_short
    said = [w for w in seen if "stopped" in str(w.message)]
    assert len(said) == 1
    assert said[0].filename == __file__


def test_without_any_mesh_the_time_limit_is_an_error(fakes, tmp_path):
    hangs = ("hang_with_stray", {"pid_file": str(tmp_path / "pids")})
    fakes(hang=hangs)
    with pytest.raises(BackendTimeoutError, match="hang was stopped after the time limit of 1 s"):
        remesh(CUBE, 0.55, timeout=1.0)
    fakes(hang=hangs, other=hangs)
    text = r"no generator made a mesh within the time limit of 1\.5 s; tried hang: .*; other: "
    with pytest.raises(BackendTimeoutError, match=text):
        remesh(CUBE, 0.55, timeout=1.5)


def test_if_all_generators_fail_the_error_lists_them(fakes):
    fakes(one=CRASHES, two=("empty", {}))
    text = "no generator made a mesh; tried one: one failed: .*; two: two returned an empty mesh"
    with pytest.raises(BackendError, match=text) as caught:
        remesh(CUBE, 0.55)
    assert not isinstance(caught.value, BackendTimeoutError)


def test_strict_prepares_once_and_accepts_only_what_meets_all_requirements(fakes):
    fakes(bad=TWICE, good=COPY)
    with pytest.warns(ResolutionWarning, match="made by good after bad, bad with 0.4 x tolerance"):
        made = remeshed(CUBE, 0.55, strict=True)
    assert [one.status for one in made.attempts.tried] == ["missed", "missed", "met"]
    with pytest.raises(MeshingError, match="no mesh meets the requirements; tried ") as caught:
        remesh(CUBE, 0.1, strict=True)
    assert [requirement.name for requirement in caught.value.check.failures] == ["edges", "served"]


def test_a_mesh_holds_nothing_of_its_attempts(fakes):
    fakes(good=COPY)
    made = remeshed(CUBE, 0.55)
    assert statuses(made.attempts) == [("good", "made")]
    assert not any("attempts" in name for name in vars(made.mesh))
