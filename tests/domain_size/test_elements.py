"""Sizes and meshes with a given number of elements."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from distance_shapes import ball
from meshes import random_sphere, with_cracks

from adaptsize import SimplexMesh, remesh_to_elements, size_function
from adaptsize._stopwatch import Stopwatch
from adaptsize.domain_size import budget
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.elements import (
    Cap,
    Listener,
    MadeMesh,
    Maker,
    mesh_with_sizes,
    reach_number,
    within_cap,
)
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.unknowns import memory_on
from adaptsize.errors import BackendError, ResolutionWarning, TooManyElementsError
from adaptsize.quality.certificate import MeshCheck, Requirement
from adaptsize.remeshing.acceptance import Verdict
from adaptsize.remeshing.attempts import Attempts, Best, Tried
from adaptsize.remeshing.driver import Remeshed

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
LINE = SimplexMesh([[0, 0], [1, 0]], [[0, 1]])  # not refined


def sphere():
    return random_sphere(400, 616, radius=3.0)


BOX = {"box": ([-1.1, -1.1], [1.1, 1.1])}


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
@pytest.mark.parametrize(("domain", "options"), [(sphere(), {}), (ball(1.0), BOX)])
def test_the_predicted_number_is_the_requested_one(domain, options, factor):
    free = size_function(domain, **options).report
    wanted = factor * free.n_elements
    report = size_function(domain, **options, elements=wanted).report
    assert report.n_elements == pytest.approx(wanted, rel=0.025)
    assert (report.relaxation < 1.0) == (report.n_elements > free.n_elements)


@pytest.mark.parametrize("domain", [SQUARE, sphere()])
def test_the_predicted_number_of_nodes_is_the_requested_one(domain):
    report = size_function(domain, nodes=7_000).report
    assert report.n_nodes == pytest.approx(7_000, rel=0.025)
    assert 1.7 < report.n_elements / report.n_nodes < (2.0 if domain is SQUARE else 6.0)


@pytest.mark.filterwarnings("ignore:the surface is open")
@pytest.mark.parametrize("nodal", [False, True])
def test_a_surface_with_cracks_gets_the_sizes_of_the_repaired_one(nodal):
    def sized(surface):
        request = {"h0": 0.5 + 0.1 * surface.points[:, 0]} if nodal else {}
        maker = Maker.of(surface, request, Listener(), None, is_exact=False)
        return report_of(maker.sized()).n_elements

    cracked = with_cracks(sphere(), 8387)
    assert not cracked.is_closed
    assert sized(cracked) == pytest.approx(sized(sphere()), rel=1e-3)


def test_a_number_that_the_given_sizes_forbid_is_reported_with_the_bound():
    message = (
        r"require about 2\d\d elements instead of 9000: .* controls .*, given parameters: hmin"
    )
    with pytest.warns(ResolutionWarning, match=message):
        report = size_function(SQUARE, elements=9000, hmin=0.1).report
    assert report.n_elements == pytest.approx(4.0 / 3.0**0.5 / 0.1**2, rel=0.05)  # of side hmin


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nodes": 9, "elements": 9}, "nodes and elements exclude each other"),
        ({"nodes": 9, "max_elements": 9}, "nodes and max_elements exclude each other"),
        ({"elements": 9, "max_elements": 9}, "elements and max_elements exclude each other"),
        ({"elements": 9, "max_memory": "1GB"}, "elements and max_memory exclude each other"),
        (
            {"elements": 9, "elements_per_radian": 1, "elements_across": 1, "hmin": 1, "hmax": 2},
            "all given: omit one of them, or elements",
        ),
    ],
)
def test_bad_and_contradictory_numbers_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        size_function(SQUARE, **options)


# --- meshes ---------------------------------------------------------------------------


class Generator:
    """Makes some times the predicted number of cells, of one dimension less than predicted."""

    def __init__(self, ratio, power=1.0):
        self.ratio, self.power, self.wanted = ratio, power, []
        self.mesh, self.listener, self.messages = LINE, Listener(self._said), []
        self.time, self.for_mesh = Stopwatch(None), {}

    def _said(self, text):
        self.messages.append(text)

    def sized(self, **number):
        self.wanted += number.values()
        return size_function(SQUARE, **number)

    def meshed(self, size, old=None, most=np.inf):
        n = max(round(self.ratio * size.report.n_elements**self.power), 1)
        points = np.column_stack([np.arange(n + 1.0), np.zeros(n + 1)])
        cells = np.column_stack([np.arange(n), np.arange(1, n + 1)])
        if self.power == 1.0:
            points = np.column_stack([np.arange(n + 2.0), np.arange(n + 2.0) % 2])
            cells = np.column_stack([np.arange(n), np.arange(1, n + 1), np.arange(2, n + 2)])
        return MadeMesh(SimplexMesh(points, cells), size)


class CappedGenerator(Generator):
    """Makes too many cells at a given distance from the boundary, and may fail for fewer."""

    def __init__(self, ratio, away=0.0, *, fails=None):
        super().__init__(ratio)
        self.away, self.fails, self.made = away, fails, 0

    def nearest_sized(self, cap, ratio, start=1.0):
        size = size_function(SQUARE, elements=(cap.elements or 1000.0) / ratio)
        report = replace(size.report, n_elements=ratio * size.report.n_elements)
        return replace(size, report=report)

    def meshed(self, size, old=None, most=np.inf):
        self.made += 1
        if self.made > 1:
            size = replace(size, report=replace(size.report, n_elements=1000.0 / self.ratio))
            if self.fails is not None:
                raise self.fails("it failed")
        requirement = Requirement("boundary", "missed", "", self.away, 1e-3)
        best = Best(LINE, Verdict(MeshCheck((requirement,)), 20.0, False), "", "")
        found = Attempts((), best, is_cut_short=False)
        return super().meshed(size)._replace(attempts=found)


@pytest.mark.parametrize(("away", "meshes"), [(3.9e-3, 2), (4.1e-3, 1)])
def test_no_second_mesh_under_a_cap_where_the_boundary_is_far_away(away, meshes):
    generator = CappedGenerator(1.3, away)
    generator.sized = lambda: size_function(SQUARE, elements=1000)
    made = within_cap(generator, Cap(1000.0))
    assert generator.made == meshes
    assert made.mesh.n_cells == pytest.approx(1000 if meshes == 2 else 1300, rel=0.05)
    if meshes == 2:
        assert made.excess is None
        assert "more than max_elements = 1000" in str(generator.messages[0])
    else:
        assert "none is made for fewer, since the boundary is too far away" in str(made.excess)


class FillingGenerator(Generator):
    """Makes fewer cells in a curve than predicted, by some generator; then in some other ratio."""

    def __init__(self, ratio, later, alone="tetwild", away=(0.0, 0.0), seconds=1.0):
        super().__init__(ratio)
        self.tried = (Tried("", "", "met", "", seconds),)
        self.mesh, self.alone, self.later = SimplexMesh([[0, 0], [1, 0]], [[0, 1]]), alone, later
        self.asked, self.away = [], list(away)

    def sized(self):
        return size_function(SQUARE, elements=1000)

    def by(self, backend):
        self.asked.append(backend)
        return self

    def nearest_sized(self, cap, ratio, start=1.0):
        self.asked.append(ratio)
        size, self.ratio = size_function(SQUARE, elements=cap.elements / ratio), self.later
        return size

    def meshed(self, size, old=None, most=np.inf):
        if self.ratio is None:
            raise BackendError("it failed")
        requirement = Requirement("boundary", "missed", "", self.away.pop(0), 1e-3)
        best = Best(LINE, Verdict(MeshCheck((requirement,)), 20.0, False), "", "", self.alone)
        found = Attempts(self.tried, best, is_cut_short=False)
        return super().meshed(size)._replace(attempts=found)


@pytest.mark.parametrize(
    ("ratio", "later", "alone", "cap", "is_second"),
    [
        (0.55, 0.57, "tetwild", 1000.0, True),
        (0.55, 0.66, "tetwild", 1000.0, False),  # it has too many
        (0.55, 0.25, "tetwild", 1000.0, False),  # it has even fewer
        (0.55, None, "tetwild", 1000.0, False),  # it fails
        (0.88, None, "tetwild", 1000.0, None),  # near what was predicted
        (0.55, None, None, 1000.0, None),  # Mmg's predictions are right
        (0.55, None, "tetwild", 1300.0, None),  # fewer were requested
    ],
)
def test_a_generator_that_leaves_much_of_a_cap_unused_makes_a_second_mesh(
    ratio, later, alone, cap, is_second
):
    generator = FillingGenerator(ratio, later, alone)
    made = within_cap(generator, Cap(cap))
    factor = ratio if not is_second else later / ratio
    assert made.mesh.n_cells == pytest.approx(1000 * factor, rel=0.06)
    said = ["tetwild has made"] if is_second is not None else []
    assert [str(text)[:16] for text in generator.messages] == said
    assert generator.asked == (
        [] if is_second is None else ["tetwild", pytest.approx(ratio, rel=0.06)]
    )
    generator = FillingGenerator(0.55, None)
    generator.mesh = SQUARE  # cells of the same dimension: nothing is filled
    within_cap(generator, Cap(1000.0))
    assert generator.asked == []


def test_a_mesh_that_took_long_is_not_made_again_for_more():
    generator = FillingGenerator(0.55, 0.57, seconds=100.0)
    assert within_cap(generator, Cap(1000.0)).mesh.n_cells == pytest.approx(550, rel=0.06)
    assert generator.asked == []


class ChangingGenerator(FillingGenerator):
    """Makes too many cells at first, and for fewer by another generator half of the allowed."""

    def __init__(self):
        super().__init__(1.3, None, alone=None, away=[0.0] * 3)
        self.per_size = iter([1.3, 0.65, 0.65])

    def nearest_sized(self, cap, ratio, start=1.0):
        self.asked.append(ratio)
        size = size_function(SQUARE, elements=cap.elements / ratio)
        self.alone = "tetwild"
        return replace(size, report=replace(size.report, n_elements=ratio * size.report.n_elements))

    def meshed(self, size, old=None, most=np.inf):
        scale = np.prod([one for one in self.asked if one != "tetwild"][-1:])
        self.ratio = next(self.per_size) / scale
        return super().meshed(size)


def test_a_mesh_for_fewer_that_leaves_much_of_a_cap_unused_is_followed_by_one_for_more():
    generator = ChangingGenerator()
    made = within_cap(generator, Cap(1000.0))
    assert generator.asked == [
        pytest.approx(1.3**1.5, rel=0.06), "tetwild", pytest.approx(0.65, rel=0.06)
    ]  # fmt: skip
    assert made.mesh.n_cells == pytest.approx(1000, rel=0.06)
    assert made.excess is None


class ThinWalls(FillingGenerator):
    """Makes some cells of those that the sizes have without corrections, in turn."""

    def __init__(self, *per_size):
        super().__init__(1.0, None, alone=None, away=[0.0] * 4)
        self.per_size = iter(per_size)

    def nearest_sized(self, cap, ratio, start=1.0):
        self.asked.append(ratio)
        size = size_function(SQUARE, elements=cap.elements / ratio)
        return replace(size, report=replace(size.report, n_elements=ratio * size.report.n_elements))

    def meshed(self, size, old=None, most=np.inf):
        self.ratio = next(self.per_size) / (self.asked[-1] if self.asked else 1.0)
        return super().meshed(size)


@pytest.mark.parametrize(
    ("per_size", "count", "asked"),
    [
        ((1.6, 2.4, 2.75), 1050, [2.02, 2.61]),
        ((1.6, 2.4, 3.0), 1150, [2.02, 2.61]),  # no third one for fewer
        ((1.6, 2.5, 3.5), 1235, [2.02, 2.78]),
    ],
)
def test_a_mesh_for_fewer_that_exceeds_a_cap_is_followed_by_one_for_even_fewer(
    per_size, count, asked
):
    generator = ThinWalls(*per_size)
    made = within_cap(generator, Cap(1000.0))
    assert generator.asked == pytest.approx(asked, rel=0.04)
    assert made.mesh.n_cells == pytest.approx(count, rel=0.04)
    assert (made.excess is None) == (count < 1100)


def test_an_excess_that_is_on_facets_is_met_by_the_next_mesh():
    generator = ThinWalls()

    def of_facets(size, **_):
        raw = size.report.n_elements / (generator.asked[-1] if generator.asked else 1.0)
        generator.ratio = 1500.0 * (raw / 1000.0) ** (2.0 / 3.0) / size.report.n_elements
        return FillingGenerator.meshed(generator, size)

    generator.meshed = of_facets
    made = within_cap(generator, Cap(1000.0))
    assert len(generator.asked) == 1
    assert made.mesh.n_cells == pytest.approx(1000, rel=0.04)


@pytest.mark.parametrize(("first", "least", "meshes"), [(1.12, 0.9, 2), (1.3, 0.95, 1)])
def test_a_mesh_for_as_few_as_the_boundary_allows_is_made_if_it_may_be_enough(first, least, meshes):
    """Sizes cannot have fewer elements than a share of those predicted for the first mesh."""
    generator, made = FillingGenerator(first, None, alone=None, away=[0.0] * 4), []

    def nearest_sized(cap, ratio, start):
        size = size_function(SQUARE, elements=max(1.0 / ratio, least) * 1000.0)
        return replace(size, report=replace(size.report, n_elements=ratio * size.report.n_elements))

    def of_facets(size, **_):
        made.append(size)
        count = 1000.0 * (first if len(made) == 1 else first * least ** (2.0 / 3.0))
        generator.ratio = count / size.report.n_elements
        return FillingGenerator.meshed(generator, size)

    generator.nearest_sized, generator.meshed = nearest_sized, of_facets
    found = within_cap(generator, Cap(1000.0))
    assert len(made) == meshes
    assert (found.excess is None) == (meshes == 2)


def test_a_search_may_begin_with_relaxed_sizes(monkeypatch):
    tried, real = [], budget._relaxed

    def relaxed(domain, request, relaxation):
        tried.append(relaxation)
        return real(domain, request, relaxation)

    monkeypatch.setattr(budget, "_relaxed", relaxed)
    maker = Maker.of(sphere(), {"max_elements": 9000.0}, Listener(), None, is_exact=False)
    usual, number = maker.nearest_sized(Cap(9000.0), 1.0), len(tried)
    near = 1.5 * usual.report.relaxation
    begun = maker.nearest_sized(Cap(9000.0), 1.0, near)
    assert tried[number] == near
    assert len(tried) - number < number
    assert 8550 <= begun.report.n_elements <= 9180


@pytest.mark.parametrize(
    ("away", "is_tried", "is_second"),
    [
        ((3.9e-3, 3.9e-3), True, True),
        ((4.1e-3, 0.0), False, False),  # finer sizes bring another surface no nearer
        ((3.9e-3, 4.1e-3), True, False),
    ],
)
def test_no_cells_are_added_to_a_mesh_of_another_surface(away, is_tried, is_second):
    generator = FillingGenerator(0.55, 0.57, away=away)
    made = within_cap(generator, Cap(1000.0))
    assert bool(generator.asked) == bool(generator.messages) == is_tried
    assert made.mesh.n_cells == pytest.approx(1000 if is_second else 550, rel=0.06)


@pytest.mark.parametrize(
    ("alone", "failures", "is_named"),
    [("tetwild", 1, True), ("tetwild", 0, False), (None, 1, False)],
)
def test_routes_that_failed_are_not_tried_again_for_fewer(alone, failures, is_named):
    generator = FillingGenerator(1.3, 1.0, alone=alone)
    generator.tried = (Tried("", "", "failed", "", 1.0),) * failures + generator.tried
    assert within_cap(generator, Cap(1000.0)).excess is None
    assert generator.asked == ["tetwild"] * is_named + [pytest.approx(1.3**1.5, rel=0.06)]


def test_the_second_mesh_is_by_the_generator_that_is_named():
    maker = Maker.of(SQUARE, {"backend": "auto"}, Listener(), None, is_exact=False)
    assert maker.by("tetwild").for_mesh == {**maker.for_mesh, "backend": "tetwild"}
    assert maker.by("tetwild").time is maker.time


def test_no_second_mesh_when_the_time_is_over():
    generator = CappedGenerator(1.3)
    generator.sized = lambda: size_function(SQUARE, elements=1000)
    meshed = generator.meshed

    def in_time(size, **_):
        made = meshed(size)
        return made._replace(attempts=replace(made.attempts, is_cut_short=True))

    generator.meshed = in_time
    made = within_cap(generator, Cap(1000.0))
    assert generator.made == 1
    assert "none is made for fewer, since the time is over" in str(made.excess)


def test_a_time_limit_is_one_for_all_meshes(monkeypatch):
    now, given = [100.0], []
    maker = Maker.of(SQUARE, {"timeout": 9.0}, Listener(), None, is_exact=False)
    maker = replace(maker, time=Stopwatch(9.0, clock=lambda: now[0]))

    def slow(mesh, size, timeout, **options):
        given.append(timeout)
        now[0] += 4.0
        return Remeshed(mesh, Attempts((), None, is_cut_short=False))

    monkeypatch.setattr("adaptsize.domain_size.elements.remeshed", slow)
    for _ in range(4):
        maker.meshed(maker.sized())
    assert given[:3] == [9.0, 5.0, 1.0]
    assert 0.0 < given[3] < 1e-300

    generator = CappedGenerator(1.3)
    generator.sized = lambda: size_function(SQUARE, elements=1000)
    generator.time = Stopwatch(0.0, clock=lambda: 5.0)
    made = within_cap(generator, Cap(1000.0))
    assert generator.made == 1
    assert "since the time is over" in str(made.excess)


@pytest.mark.parametrize("ratio", [1.0, 1.3])
def test_only_warnings_of_the_mesh_that_is_returned_are_issued(monkeypatch, ratio):
    sizes = iter([round(ratio * 1000), 900])

    def warning(mesh, size, **options):
        count = next(sizes)
        warnings.warn(f"of {count} cells", ResolutionWarning, stacklevel=1)
        points = np.column_stack([np.arange(count + 2.0), np.arange(count + 2.0) % 2])
        cells = np.arange(count)[:, None] + [0, 1, 2]
        return Remeshed(SimplexMesh(points, cells), Attempts((), None, is_cut_short=False))

    monkeypatch.setattr("adaptsize.domain_size.elements.remeshed", warning)
    request = {"max_elements": 1000, "hmin": 1e-3}
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        made = mesh_with_sizes(SQUARE, request, progress=None)
    assert [str(one.message) for one in found] == [f"of {made.mesh.n_cells} cells"]


def test_a_failure_is_told_with_the_warnings_before_it(monkeypatch):
    def failing(mesh, size, **options):
        warnings.warn("this is why", ResolutionWarning, stacklevel=1)
        raise BackendError("it failed")

    monkeypatch.setattr("adaptsize.domain_size.elements.remeshed", failing)
    with (
        pytest.warns(ResolutionWarning, match="this is why"),
        pytest.raises(BackendError, match="it failed"),
    ):
        mesh_with_sizes(SQUARE, {}, progress=None)


def test_the_memory_of_the_mesh_made_is_compared_with_a_cap():
    generator = CappedGenerator(1.3)
    generator.sized = lambda: size_function(SQUARE, elements=1000)
    mesh = generator.meshed(generator.sized()).mesh
    generator.made = 0
    need = memory_on(mesh, 1, 1)
    # CSR: 8 bytes and an index of 4 for each pair of nodes in a cell.
    pairs = np.unique(np.sort(mesh.cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
    assert need == 12 * (mesh.n_points + 2 * len(pairs)) + 4 * (mesh.n_points + 1)
    cap = Cap(None, f"{need / 1.05:.0f}B")
    assert within_cap(generator, cap).mesh.n_cells == mesh.n_cells
    assert generator.made == 1
    generator.made = 0
    made = within_cap(generator, Cap(None, f"{need / 1.2:.0f}B"))
    assert generator.made == 2
    assert made.excess is None
    assert "GB for the matrix, more than max_memory" in str(generator.messages[-1])


def test_a_very_small_cap_is_no_error():
    maker = Maker.of(SQUARE, {"max_elements": 3.0}, Listener(), None, is_exact=False)
    size = maker.nearest_sized(Cap(3.0), 100.0)
    assert np.isfinite(size.report.n_elements)


@pytest.mark.parametrize("error", [BackendError, TooManyElementsError])
def test_the_first_mesh_is_kept_if_the_second_fails(error):
    generator = CappedGenerator(1.3, fails=error)
    generator.sized = lambda: size_function(SQUARE, elements=1000)
    made = within_cap(generator, Cap(1000.0))
    assert made.mesh.n_cells > 1100
    assert "more than max_elements = 1000, and for fewer: it failed" in str(made.excess)


@pytest.mark.parametrize("fails", [None, BackendError])
def test_a_first_mesh_beyond_a_cap_is_completed_only_if_it_is_returned(monkeypatch, fails):
    asked, completed, counts = [], [], iter([1300, 900])

    def mesh_of(count):
        points = np.column_stack([np.arange(count + 2.0), np.arange(count + 2.0) % 2])
        return SimplexMesh(points, np.arange(count)[:, None] + [0, 1, 2])

    def remeshed(mesh, size, most, **options):
        asked.append(most)
        count = next(counts)
        warnings.warn(f"of {count} cells", ResolutionWarning, stacklevel=1)
        if len(asked) == 2 and fails is not None:
            raise fails("it failed")
        later = (lambda: None) if count > most else None
        return Postponed(mesh_of(count), Attempts((), None, is_cut_short=False, later=later))

    class Postponed(Remeshed):
        def completed(self):
            completed.append(self.mesh.n_cells)
            warnings.warn("completed", ResolutionWarning, stacklevel=1)
            return Remeshed(mesh_of(1299), Attempts((), None, is_cut_short=False))

    monkeypatch.setattr("adaptsize.domain_size.elements.remeshed", remeshed)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        made = mesh_with_sizes(SQUARE, {"max_elements": 1000, "hmin": 1e-3}, progress=None)
    assert asked == [pytest.approx(1100.0)] * 2
    said = [str(one.message) for one in found]
    if fails is None:
        assert (made.mesh.n_cells, completed, said) == (900, [], ["of 900 cells"])
        return
    assert (made.mesh.n_cells, completed) == (1299, [1300])
    assert said == ["of 1300 cells", "completed"]
    assert "and for fewer: it failed" in str(made.excess)


@pytest.mark.parametrize(("ratio", "meshes"), [(1.03, 1), (1.1, 2), (1.3, 2), (0.5, 2)])
def test_sizes_are_corrected_by_what_the_first_mesh_has_made_of_them(ratio, meshes):
    generator = Generator(ratio)
    mesh, size, *_ = reach_number(generator, ("elements", 1000), (1, 1))
    assert generator.messages == []
    assert mesh.n_cells == pytest.approx(1000, rel=0.05)
    assert len(generator.wanted) == meshes
    if meshes > 1:
        assert size.report.n_elements == pytest.approx(1000 / ratio, rel=0.05)


def test_the_reason_is_messages_before_the_last_of_three_meshes():
    generator = Generator(1.5 * 1000**0.3, 0.7)
    mesh = reach_number(generator, ("elements", 1000), (1, 1)).mesh
    messages = generator.messages
    assert mesh.n_cells == pytest.approx(1000, rel=0.05)
    wanted = [f"{number:.0f}" for number in generator.wanted]
    assert len(wanted) == 3
    assert messages[0].startswith("elements so far: 15")
    assert messages[0].endswith(f"the last mesh is made for {wanted[2]}")


def grid(n):
    """A regular grid of 2 n^2 triangles, n even, with tagged cells and sides."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    a = (i[:-1, :-1] * (n + 1) + j[:-1, :-1]).ravel()
    cells = [np.column_stack([a, a + n + 1, a + n + 2]), np.column_stack([a, a + n + 2, a + 1])]
    left = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    return SimplexMesh(
        np.column_stack([i.ravel(), j.ravel()]) / n,
        np.concatenate(cells),
        cell_tags=np.tile(np.repeat([3, 4], n * n // 2), 2),  # left and right half
        tagged_facets=np.concatenate([left, left + n * (n + 1)]),
        facet_tags=np.repeat([7, 8], n),
    )


def test_a_regular_grid_becomes_any_number_and_keeps_its_tags(monkeypatch):
    # From the grid itself, Mmg makes 800 or 417 triangles, and from a finer one in order 700.
    pytest.importorskip("mmgpy")
    wanted = []

    def sized(domain, request):
        wanted.append(request.goal[1])
        return within_budget(domain, request)

    monkeypatch.setattr("adaptsize.domain_size.elements.within_budget", sized)
    mesh, _ = remesh_to_elements(grid(20), 550)
    assert len(set(wanted)) == len(wanted)  # no size function is computed twice
    assert mesh.n_cells == pytest.approx(550, rel=0.05)
    assert mesh.measures[mesh.cell_tags == 3].sum() == pytest.approx(0.5)
    assert set(mesh.facet_tags) >= {7, 8}


def test_what_is_no_mesh_or_no_target_is_refused_before_the_sizes():
    with pytest.raises(ValueError, match="mesh must be a SimplexMesh"):
        remesh_to_elements("part.stl", 1000)
    with pytest.raises(ValueError, match="target"):
        remesh_to_elements(SQUARE, 1000, target="hexahedra")
    with pytest.raises(ValueError, match="elements must be"):
        remesh_to_elements(SQUARE, -1)
    with pytest.raises(ValueError, match="one of elements and nodes must be given, got both"):
        remesh_to_elements(SQUARE, 10, nodes=10)
    with pytest.raises(ValueError, match="one of elements and nodes must be given, got none"):
        remesh_to_elements(SQUARE)
