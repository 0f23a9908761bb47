"""Queries by several threads: the same results bit for bit, and no work after an exception."""

import math
import os
import threading
import time
import weakref

import numba
import numpy as np
import pytest

import adaptsize as ads
from adaptsize import _cores
from adaptsize._workers import Workers, in_all_threads
from adaptsize.background import _mesh_arrays, simplex
from adaptsize.geometry import convexity, inside
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import ridges_of, solid_angle, turns_of
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.inside import Inside
from adaptsize.geometry.separation import boundary_separation
from adaptsize.geometry.width import boundary_width
from adaptsize.limiting import Exact
from adaptsize.limiting.exact import candidates, field
from adaptsize.limiting.exact.field import node_entries
from adaptsize.quality import conformity
from adaptsize.quality.boundary import farthest_places
from adaptsize.quality.by_place import of_edges
from adaptsize.quality.elements import flat_cells, radius_ratios
from adaptsize.sizes import recovery

#: Numbers of items in the chunks of passes over a mesh and its boundary.
CHUNKS = [
    (_mesh_arrays, "CELLS"),
    (_mesh_arrays, "_POINTS"),
    (simplex, "_CELLS_TO_MEASURE"),
    (convexity, "_AT_ONCE"),
    (inside, "_CELLS"),
    (field, "_ENTRIES"),
    (recovery, "_PAIRS_AT_ONCE"),
    (conformity, "_EDGES_AT_ONCE"),
]


@pytest.fixture(scope="module")
def surface():
    """A ball of cubes, whose boundary has thousands of facets and feature edges."""
    grid = ads.CartesianGrid([-1.0] * 3, 0.1, (21,) * 3)
    middle = grid.mesh.points[grid.mesh.cells].mean(axis=1)
    ball = ads.SimplexMesh(grid.mesh.points, grid.mesh.cells[np.linalg.norm(middle, axis=1) < 0.9])
    return ball.boundary().mesh


def results(surface):
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (5000, 3))
    cells, weights, distances = surface.locator.nearest(points)
    separation = boundary_separation(surface)
    # Not around the same centre: facets as far from one another everywhere are divided for seconds.
    far = farthest_places(surface, surface.moved(1.01 * surface.points + [1e-3, 2e-3, 3e-3]), 0.0)
    winding = WindingNumber(surface)(points)
    width = boundary_width(surface)
    return [cells, weights, distances, winding, width, *separation, *far]


def passes_over_cells(mesh):
    """Return the boundary, the extent, flat cells, qualities and the conformity of a new mesh."""
    mesh = ads.SimplexMesh(mesh.points, mesh.cells)
    boundary = flat_boundary(mesh, numba.get_num_threads())
    values = 0.05 + (mesh.points**2).sum(axis=1)
    found = ads.size_conformity(mesh, values)
    numbers = [value for value in vars(found).values() if isinstance(value, float)]
    assert len(numbers) > 3
    qualities = radius_ratios(mesh), of_edges(mesh, np.mean), flat_cells(mesh)
    return [boundary.facets, boundary.cells, mesh.diagonal, *qualities, numbers]


@pytest.mark.parametrize("shape", [(240, 240), (27, 28, 27)])
def test_passes_over_cells_are_the_same_bit_for_bit(shape, monkeypatch):
    grid = ads.CartesianGrid([0.0] * len(shape), 1.0 / shape[0], shape).mesh
    points = grid.points + np.random.default_rng(1).uniform(-0.1, 0.1, grid.points.shape) / shape[0]
    mesh, found, chunks = ads.SimplexMesh(points, grid.cells), {}, []
    assert mesh.n_cells > 100_000  # more than one thread sums facets
    in_chunks = Workers.in_chunks

    def watched(self, task, n, *rest):
        chunks.append((task.__qualname__, self.threads))
        return in_chunks(self, task, n, *rest)

    monkeypatch.setattr(Workers, "in_chunks", watched)
    for threads in (1, 2, 3, 8):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        found[threads] = [np.asarray(one).tobytes() for one in passes_over_cells(mesh)]
    for name in ("_sums.<locals>.add", "flat_cells", "_of_cells", "of_edges"):
        assert {threads for task, threads in chunks if name in task} == {1, 2, 3, 8}
    assert found[1] == found[2] == found[3] == found[8]


def test_the_diagonal_is_that_of_nodes_in_cells():
    points = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0], [50.0, 50.0]])
    assert ads.SimplexMesh(points, [[0, 1, 2]]).diagonal == 5.0


def test_any_number_of_threads_gives_the_same_bit_for_bit(surface, monkeypatch):
    found, used = {}, set()
    in_chunks = Workers.in_chunks

    def watched(self, task, n, *rest):
        def own(first, last):
            used.add(threading.current_thread().name)
            return task(first, last)

        return in_chunks(self, own, n, *rest)

    monkeypatch.setattr(Workers, "in_chunks", watched)
    for threads in (1, 2, 3, 8):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        found[threads] = [np.asarray(one).tobytes() for one in results(surface)]
    assert len(used) > 3  # the main thread, and others
    assert found[1] == found[2] == found[3] == found[8]


@pytest.mark.parametrize("dim", [2, 3])
def test_chunks_of_cells_and_threads_do_not_matter_to_the_last_bit(dim, monkeypatch):
    """Nodes, edges and faces of steep cells are sources, in a domain with a notch and without."""
    n = 25 if dim == 2 else 9
    whole = ads.CartesianGrid([0.0] * dim, 1.0 / (n - 1), (n,) * dim).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    notched = ads.SimplexMesh(whole.points, whole.cells[~(middle > 0.5).all(axis=1)])
    for mesh in (whole, notched):
        waves = np.sin(9.0 * mesh.points).sum(axis=1)
        h0 = 0.4 + 0.1 * waves
        h0[np.random.default_rng(dim).random(mesh.n_points) < 0.2] = np.inf
        found = []
        for cells, threads in ((1 << 15, 1), (64, 1), (64, 2), (64, 3), (64, 8)):
            monkeypatch.setattr(candidates, "_CELLS", cells)
            fresh = ads.SimplexMesh(mesh.points, mesh.cells)
            found.append(ads.limit_gradient(fresh, h0, 0.3, method=Exact(threads=threads)))
        assert all(h.tobytes() == found[0].tobytes() for h in found)
        assert np.count_nonzero(found[0] < h0) > 50


@pytest.mark.parametrize("dim", [2, 3])
def test_recovered_derivatives_do_not_depend_on_threads(dim, monkeypatch):
    n = 60 if dim == 2 else 13
    mesh = ads.CartesianGrid([0.0] * dim, 1.0 / n, (n + 1,) * dim).mesh
    values, found = np.sin(9.0 * mesh.points).prod(axis=1), []
    for threads in (1, 2, 3, 8):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        found.append((ads.sizes.recovered_hessian(mesh, values), ads.zz_indicator(mesh, values)))
    for hessian, indicator in found:
        assert hessian.tobytes() == found[0][0].tobytes()
        assert indicator.tobytes() == found[0][1].tobytes()


def test_chunks_of_passes_over_a_mesh_and_its_boundary_do_not_matter(monkeypatch):
    grid = ads.CartesianGrid([0.0] * 3, 1.0 / 8, (9, 9, 9)).mesh
    shift = np.random.default_rng(3).uniform(-0.03, 0.03, grid.points.shape)
    found = []
    for step in (
        1 << 20,
        64,
        50,
    ):  # with all in one chunk, and in chunks of which the last is short
        for module, name in CHUNKS:
            monkeypatch.setattr(module, name, step)
        mesh = ads.SimplexMesh(grid.points + shift, grid.cells)
        skin, walls = mesh.boundary().mesh, flat_boundary(mesh)
        corners = mesh.points[walls.facets]
        turns = turns_of(mesh.points, walls.facets, ridges_of(walls.facets, mesh.n_points))
        normals = Inside(Faces.of(skin)).normals
        names = np.arange(mesh.n_points, dtype=np.int32)
        boxes = node_entries(mesh.points, mesh.points[:, 0], names).boxes
        solid = solid_angle(corners, corners.mean(axis=(0, 1)))
        derivatives = ads.sizes.recovered_hessian(mesh, mesh.points[:, 0] ** 2)
        ratios = conformity.edge_ratios(mesh, np.where(mesh.points[:, 0] < 0.5, 0.1, np.inf))
        of_mesh = mesh.diagonal, mesh.measures, mesh.in_a_cell, derivatives
        found.append([*of_mesh, turns, normals, boxes, solid, ratios])
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(one, other)
    assert np.nanmin(found[0][4]) < 0.0 < np.nanmax(found[0][4])
    assert np.isnan(found[0][8]).any()
    assert np.nanmax(found[0][8]) > 1.0
    assert found[0][7] == pytest.approx(4.0 * np.pi)


def test_threads_are_started_once_and_by_no_task():
    threads, inner = set(), set()

    def note(first, last):
        inner.add(threading.current_thread())

    def task(first, last):
        threads.add(threading.current_thread())
        time.sleep(0.001)
        Workers(3).in_chunks(note, 2, 1)

    for _ in range(3):
        Workers(3).in_chunks(task, 30, 1)
    assert inner == threads
    assert len(threads) <= 3


def test_nothing_goes_on_after_an_exception():
    begun = []

    def task(first, last):
        begun.append(first)
        time.sleep(0.01)
        if first == 3:
            raise ValueError("three")

    with pytest.raises(ValueError, match="three"):
        Workers(2).in_chunks(task, 1000, 1)
    count = len(begun)
    assert count < 1000
    time.sleep(0.1)
    assert len(begun) == count


def interrupt_first_of(running):
    """Run chunks, the first of which is interrupted; ``running`` holds those that run."""

    def task(first, last):
        running.add(first)
        time.sleep(0.05)
        running.remove(first)
        if first == 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Workers(3).in_chunks(task, 30, 1)


def test_no_chunk_runs_on_after_several_interrupts(monkeypatch):
    from adaptsize import _workers

    running, times = set(), []
    really_wait = _workers.wait

    def interrupted(futures):
        times.append(len(running))
        if len(times) < 3:
            raise KeyboardInterrupt
        return really_wait(futures)

    monkeypatch.setattr(_workers, "wait", interrupted)
    interrupt_first_of(running)
    assert len(times) >= 3
    assert not running


def test_no_chunk_runs_on_if_a_second_signal_comes_before_the_first_is_handled(monkeypatch):
    from adaptsize import _workers

    running, calls = set(), []
    really_end = _workers._end

    def interrupted(begun):
        calls.append(len(begun))
        if len(calls) == 1:  # as at the first line of the function
            raise KeyboardInterrupt
        really_end(begun)

    monkeypatch.setattr(_workers, "_end", interrupted)
    interrupt_first_of(running)
    assert calls == [30, 30]
    assert not running


def test_few_items_are_left_to_the_calling_thread(monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: 8)
    names = []
    in_all_threads(lambda *_: names.append(threading.current_thread().name), 100, 100)
    assert names == [threading.current_thread().name]


def test_a_pool_with_another_number_of_threads_ends_the_last_one():
    threads = {2: set(), 3: set()}
    for n, found in threads.items():
        Workers(n).in_chunks(
            lambda _first, _last, found=found: found.add(weakref.ref(threading.current_thread())),
            40,
            1,
        )
    until = time.monotonic() + 60.0
    while any(one() is not None and one().is_alive() for one in threads[2]):
        assert time.monotonic() < until
        time.sleep(0.01)
    assert any(one().is_alive() for one in threads[3])


@pytest.fixture
def control_group(tmp_path):
    """Return a function that writes quotas of nested groups, and says what is read."""

    def read(own, quotas, said="0::{}"):
        groups, mounted = tmp_path / "cgroup", tmp_path / "mounted"
        groups.write_text("9:name=systemd:/\n" + said.format(own) + "\n")
        for folder, text in quotas.items():
            (mounted / folder).mkdir(parents=True, exist_ok=True)
            (mounted / folder / "cpu.max").write_text(text)
        return _cores._quota(groups, mounted)

    return read


@pytest.mark.parametrize(
    ("own", "quotas", "cores"),
    [
        ("/", {".": "200000 100000\n"}, 2.0),  # as a container sees its own group
        ("/pod/one", {"pod": "150000 100000\n", "pod/one": "max 100000\n"}, 1.5),
        ("/pod/one", {"pod": "800000 100000\n", "pod/one": "50000 100000\n"}, 0.5),
        ("/pod/one", {".": "300000 100000\n"}, 3.0),  # the group of a host that is not mounted
        ("/pod", {"pod": "max 100000\n"}, math.inf),
        ("/pod", {"pod": "nonsense\n"}, math.inf),
        ("/pod", {"pod": "1 0\n"}, math.inf),
    ],
)
def test_the_quota_is_the_least_one_of_the_groups_around_a_process(
    control_group, own, quotas, cores
):
    assert control_group(own, quotas) == cores


def test_systems_without_control_groups_have_no_quota(control_group, tmp_path):
    assert control_group("/", {}, said="4:memory:{}") == math.inf
    assert _cores._quota(tmp_path / "missing", tmp_path) == math.inf


def test_threads_are_as_many_as_cores_unless_somebody_asked_for_more(monkeypatch):
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(64), raising=False)
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 64)
    monkeypatch.setattr(numba, "get_num_threads", lambda: 64)
    monkeypatch.setattr(_cores, "_quota", lambda *_: 1.5)
    _cores.cores.cache_clear()
    try:
        assert Workers.of(None).threads == 2
        monkeypatch.setattr(numba, "get_num_threads", lambda: 8)
        assert Workers.of(None).threads == 8
        monkeypatch.setattr(numba, "get_num_threads", lambda: 64)
        monkeypatch.setenv("NUMBA_NUM_THREADS", "64")
        assert Workers.of(None).threads == 64
    finally:
        _cores.cores.cache_clear()


def test_processes_per_core_are_at_least_one_and_unknown_ones_none(monkeypatch):
    monkeypatch.setattr(_cores, "cores", lambda: 2)
    for waiting, expected in ((13.0, 6.5), (2.0, 1.0), (0.1, 1.0)):
        monkeypatch.setattr(os, "getloadavg", lambda w=waiting: (w, 50.0, 50.0), raising=False)
        assert _cores.crowding() == expected
    monkeypatch.delattr(os, "getloadavg")
    assert _cores.crowding() == 1.0
