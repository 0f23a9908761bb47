"""The flow solver against known flows, and the adaptive loop on the bump at a coarse setting."""

import math

import numpy as np
import pytest
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh

pytest.importorskip("matplotlib", reason="the example draws")


@pytest.fixture
def euler(monkeypatch):
    from pathlib import Path

    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples"))
    import _euler

    return _euler


def mapped_square(n_x, n_y, place, *, seed=20040613):
    """Return triangles of a jittered grid on the unit square, moved by ``place``."""
    x, y = np.meshgrid(np.linspace(0, 1, n_x + 1), np.linspace(0, 1, n_y + 1), indexing="ij")
    points = np.stack([x, y], axis=-1).reshape(-1, 2)
    inner = ((points > 1e-9) & (points < 1.0 - 1e-9)).all(axis=1)
    moves = np.random.default_rng(seed).uniform(-0.2, 0.2, (int(inner.sum()), 2))
    points[inner] += moves / [n_x, n_y]
    cells = Delaunay(points * [n_x, n_y]).simplices
    mesh = SimplexMesh(place(points), cells)
    bad = mesh.signed_measures < 0.0
    return SimplexMesh(mesh.points, np.where(bad[:, None], cells[:, [1, 0, 2]], cells))


def no_wall(x):
    return np.zeros(len(x), bool)


def test_free_stream_stays_as_it_is(euler):
    mesh = mapped_square(12, 9, lambda x: x * [3.0, 1.0])
    stream = euler.free_stream(0.95, angle=17.0)
    flow = euler.FlowMesh.of(mesh, no_wall)
    balance = euler.residual(flow, np.tile(stream, (mesh.n_cells, 1)), stream)
    # Fluxes of order 1 on edges of order 0.1.
    assert np.abs(balance).max() < 1e-14
    # Along straight walls as well.
    level = euler.free_stream(0.95)
    flow = euler.FlowMesh.of(mesh, lambda x: (x[:, 1] < 1e-9) | (x[:, 1] > 1.0 - 1e-9))
    assert (flow.right == euler.WALL).sum() == 24
    balance = euler.residual(flow, np.tile(level, (mesh.n_cells, 1)), level)
    assert np.abs(balance).max() < 1e-14


def test_shock_of_a_wedge_has_the_angle_and_the_pressure_of_theory(euler):
    # 10 degrees at Mach 2: shock at 39.314 degrees, pressure ratio 1.7066, Mach 1.6405 behind
    # it (tan theta = 2 cot beta (M^2 sin^2 beta - 1) / (M^2 (1.4 + cos 2 beta) + 2)).
    rise = math.tan(math.radians(10.0))

    def place(p):
        x = -0.3 + 1.3 * p[:, 0]
        low = rise * np.maximum(x, 0.0)
        return np.column_stack([x, low + (1.0 - low) * p[:, 1]])

    mesh = mapped_square(26, 20, place)
    flow = euler.FlowMesh.of(mesh, lambda x: x[:, 1] < rise * np.maximum(x[:, 0], 0.0) + 1e-9)
    found = euler.solve(flow, euler.free_stream(2.0), tolerance=1e-5, sweeps=5)
    assert found.converged
    x, y = flow.centres.T
    behind = (x > 0.5) & (x < 0.9) & (y < 0.3)
    pressure = 1.4 * found.w[:, 3]
    assert pressure[behind].mean() == pytest.approx(1.7066, rel=3e-3)
    assert euler.mach_number(found.w[behind]).mean() == pytest.approx(1.6405, rel=8e-3)
    # Half of the rise: columns as wide as edges are long, 1 / 20.
    for left in (0.5, 0.7, 0.9):
        column = np.abs(x - left) < 1.0 / 40.0
        above = (pressure[column] > 1.3533).astype(float)
        areas = mesh.measures[column]
        height = rise * left + (areas * above).sum() / areas.sum() * (1.0 - rise * left)
        angle = math.degrees(math.atan2(height, left))
        assert angle == pytest.approx(39.314, abs=2.0)


def test_entropy_error_of_a_smooth_flow_is_of_second_order(euler):
    def place(p):
        x = -1.0 + 3.0 * p[:, 0]
        low = 0.05 * np.sin(np.pi * np.clip(x, 0.0, 1.0)) ** 2
        return np.column_stack([x, low + (1.0 - low) * p[:, 1]])

    errors = []
    for n in (8, 16):
        mesh = mapped_square(3 * n, n, place)
        flow = euler.FlowMesh.of(mesh, lambda x: (x[:, 0] > -1 + 1e-9) & (x[:, 0] < 2 - 1e-9))
        found = euler.solve(flow, euler.free_stream(0.4), tolerance=1e-5, sweeps=10)
        assert found.converged
        assert found.mass_lost < 1e-5
        square = mesh.measures @ euler.entropy_error(found.w) ** 2
        errors.append(math.sqrt(square / mesh.measures.sum()))
    # Order 1 would halve them.
    assert errors[1] < errors[0] / 2.5, errors


def test_limited_sizes_make_good_triangles_and_others_do_not(run):
    found = run("plot_euler_bump", n_triangles=1000, n_cycles=3)
    assert found["steepest slope of the sizes, with limiting"] < 0.25 * (1.0 + 1e-12)
    assert found["steepest slope of the sizes, without limiting"] > 2.0
    assert found["smallest angle, with limiting"] > 28.0
    assert found["smallest angle, without limiting"] < 26.0
    assert found["worst radius ratio, with limiting"] > 0.45
    assert found["worst radius ratio, without limiting"] < 0.52
    for name in ("with", "without"):
        assert found[f"triangles, {name} limiting"] == pytest.approx(1000, rel=0.15)
        assert found[f"boundary nodes off the boundary, {name} limiting"] < 1e-6
        # 1.95 on finer meshes, before the shock at the end of the bump.
        assert found[f"largest Mach number, {name} limiting"] == pytest.approx(1.94, abs=0.06)
    assert found["converged, with limiting"] == "True"
    assert found["mass lost, with limiting"] < 1e-4
