"""The Hamilton-Jacobi steps on padded grids against array formulas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize._kernels.hamilton_jacobi import hamilton_jacobi_stage, iterate_hamilton_jacobi


def _padded(values, width):
    return np.pad(values, width, constant_values=np.nan)


def _problem(h0, g, spacing, order, dt, still=0.0):
    """Pack what the kernels take; ``h0`` holds NaN at missing nodes, ``g`` too if per node."""
    bound = _padded(h0, order)
    number = np.arange(bound.size).reshape(bound.shape)
    first = number[tuple(slice(order, -order) for _ in h0.shape)][..., 0]
    strides = np.array(bound.strides) // bound.itemsize
    weights = np.asarray(spacing, dtype=float) ** -2.0
    varies = g.shape == h0.shape
    limits = _padded(g, order).ravel() if varies else g
    rows = (np.array(first, ndmin=1).ravel(), h0.shape[-1], strides)
    return (bound.ravel(), limits, int(varies), *rows, weights, order, dt, still)


def _stage(u, base, share, problem, order):
    out = np.full(_padded(u, order).shape, np.nan)
    moving = hamilton_jacobi_stage(
        _padded(u, order).ravel(), _padded(base, order).ravel(), share, problem, out.ravel()
    )
    return out, moving


def _shifted(u, axis, by):
    """Return the neighbours ``by`` nodes further along the axis, NaN beyond the end."""
    wide = np.pad(
        u, [(2, 2) if a == axis else (0, 0) for a in range(u.ndim)], constant_values=np.nan
    )
    return np.take(wide, np.arange(u.shape[axis]) + 2 + by, axis=axis)


def _minmod(a, b):
    smaller = np.sign(a) * np.minimum(np.abs(a), np.abs(b))
    return np.nan_to_num(np.where(np.sign(a) == np.sign(b), smaller, 0.0))


def _twin(u, h0, g, spacing, order, dt):
    """Return Euler's step by the textbook: D^- and D^+ per axis, then Godunov's choice."""
    square, lowest = np.zeros_like(u), u.copy()
    for axis, dx in enumerate(spacing):
        ll, low, high, hh = (_shifted(u, axis, by) for by in (-2, -1, 1, 2))
        backward, forward = (u - low) / dx, (high - u) / dx
        lowest = np.fmin(lowest, np.fmin(low, high))
        if order == 2:
            middle = (high - 2.0 * u + low) / dx**2
            backward = backward + 0.5 * dx * _minmod((u - 2.0 * low + ll) / dx**2, middle)
            forward = forward - 0.5 * dx * _minmod((hh - 2.0 * high + u) / dx**2, middle)
        square += np.fmax(np.fmax(backward, -forward), 0.0) ** 2
    moved = u - dt * (np.sqrt(square) - g)
    if order == 2:
        moved = np.maximum(moved, lowest)
    return np.minimum(h0, moved)


def _random_problem(shape, seed, *, missing=0.2):
    rng = np.random.default_rng(seed)
    gone = rng.random(shape) < missing
    u = rng.uniform(0.5, 3.0, shape)
    h0 = np.where(rng.random(shape) < 0.4, u + rng.uniform(0.0, 0.1, shape), np.inf)
    g = rng.uniform(0.1, 1.0, shape)
    for values in (u, h0, g):
        values[gone] = np.nan
    return u, h0, g


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("shape", [(40,), (9, 12), (6, 7, 8)])
def test_one_step_is_the_textbook_formula(shape, order):
    spacing = (0.7, 1.0, 0.4)[: len(shape)]
    u, h0, g = _random_problem(shape, seed=21)
    for limit in (g, np.array([0.3])):
        problem = _problem(h0, limit, spacing, order, 0.1)
        out, _ = _stage(u, u, 0.0, problem, order)
        expected = _twin(u, h0, limit, spacing, order, 0.1)
        inside = tuple(slice(order, -order) for _ in shape)
        assert_allclose(out[inside], expected, rtol=1e-13)  # NaN where nodes are missing
        # What lies around the grid is left alone.
        assert np.isnan(out).sum() == out.size - np.isfinite(u).sum()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("n_steps", [1, 2, 5])
def test_steps_are_eulers_or_runge_kuttas(order, n_steps):
    u, h0, g = _random_problem((8, 9), seed=22)
    problem = _problem(h0, g, (1.0, 1.0), order, 0.3)
    now, spare, stage = (_padded(a, order).ravel() for a in (u, u * np.nan, u * np.nan))
    taken, moving = iterate_hamilton_jacobi(n_steps, now, spare, stage, problem)
    assert (taken, moving > 0) == (n_steps, True)

    def mixed(share, values):
        free = _twin(values, np.inf, g, (1.0, 1.0), order, 0.3)
        return np.minimum(h0, share * u + (1.0 - share) * free)

    for _ in range(n_steps):
        u = mixed(0.0, u) if order == 1 else mixed(1.0 / 3.0, mixed(0.75, mixed(0.0, u)))
    assert_allclose(now if n_steps % 2 == 0 else spare, _padded(u, order).ravel(), rtol=1e-13)
