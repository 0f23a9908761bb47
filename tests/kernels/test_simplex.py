"""Measures and gradients of single cells, slivers and degenerate ones included."""

from fractions import Fraction
from math import factorial

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adaptsize._kernels.simplex import dual_edges, fill_measures

SHAPES = {
    "segment": (1, 1),
    "edge in space": (1, 3),
    "triangle": (2, 2),
    "facet": (2, 3),
    "tet": (3, 3),
}


def _cell(k):
    return np.arange(k + 1, dtype=np.int32)


def _dual(points, k):
    edges, dual = np.full((2, k, points.shape[1]), np.nan)
    measure = dual_edges(points, _cell(k), edges, dual)
    return measure, edges, dual


def _exact_measure(points):
    """Return the measure of a cell of whole coordinates, from its rational Gram determinant."""
    edges = [[Fraction(int(x)) for x in row] for row in points[1:] - points[0]]
    gram = [[sum(a * b for a, b in zip(e, f, strict=True)) for f in edges] for e in edges]
    determinant = Fraction(1)
    for i in range(len(gram)):  # Gauss without pivoting: Gram matrices need none
        if gram[i][i] == 0:
            return 0.0
        determinant *= gram[i][i]
        for j in range(i + 1, len(gram)):
            share = gram[j][i] / gram[i][i]
            gram[j] = [a - share * b for a, b in zip(gram[j], gram[i], strict=True)]
    return float(determinant) ** 0.5 / factorial(len(edges))


@given(st.sampled_from(sorted(SHAPES)), st.integers(0, 2**32 - 1), st.sampled_from([5, 10_000]))
def test_measure_is_the_root_of_the_gram_determinant(shape, seed, largest):
    k, dim = SHAPES[shape]
    points = np.random.default_rng(seed).integers(-largest, largest + 1, (k + 1, dim))
    measures = np.full(1, np.nan)
    fill_measures(points.astype(float), _cell(k)[None], measures)
    assert_allclose(measures[0], _exact_measure(points), rtol=1e-10)


@given(
    st.sampled_from(sorted(SHAPES)),
    st.integers(0, 2**32 - 1),
    st.sampled_from([1.0, 1e-3, 1e-6, 1e-9, 1e-12]),
)
def test_dual_basis_is_dual_on_slivers(shape, seed, flatness):
    # One height is `flatness` of the others: gradients are as long as 1/flatness.  The
    # products with edges of length 1 err by eps/flatness; with 1e-12 that is 1e-3.
    k, dim = SHAPES[shape]
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.5, 1.5, (k + 1, dim)) * rng.choice([-1.0, 1.0], (k + 1, dim))
    points[:, -1] *= flatness
    measure, edges, dual = _dual(points, k)
    if measure == 0.0:  # nearly flat by chance
        assert flatness < 1e-9
        return
    error = np.abs(dual @ edges.T - np.eye(k)).max()
    heights = 1.0 / np.linalg.norm(dual, axis=1)
    longest = np.linalg.norm(edges, axis=1).max()
    assert error <= 1e-14 * longest / heights.min() * 4.0
