"""The crossings of Algorithm 1 against the same steps with polynomials of NumPy."""

import numpy as np
import pytest
from distance_shapes import Ellipse, ball, letter_l, sampled, turned

from adaptsize._progress import silent
from adaptsize.geometry.medial.crossings import Padded, find_crossings, fronts_on_edges


def by_polynomials(phi, tolerance, gamma=2.0):
    """Algorithm 1 on a plane grid of spacing 1 with NumPy's polynomials; {(i, j, axis): s0}."""
    n, m = phi.shape

    def one_sided(line):
        """Of seven values the difference in the middle, on the smoother side."""
        back, front = line[3] - line[2], line[4] - line[3]
        bends = abs(np.diff(line[1:4], 2)[0]), abs(np.diff(line[3:6], 2)[0])
        if abs(bends[0] - bends[1]) <= 1e-9 * sum(bends):
            return 0.5 * (back + front)
        return back if bends[0] < bends[1] else front

    def curvature(i, j):
        c = phi[i - 1 : i + 2, j - 1 : j + 2]
        fx, fy = 0.5 * (c[2, 1] - c[0, 1]), 0.5 * (c[1, 2] - c[1, 0])
        fxx, fyy = np.diff(c[:, 1], 2)[0], np.diff(c[1], 2)[0]
        fxy = 0.25 * (c[2, 2] - c[2, 0] - c[0, 2] + c[0, 0])
        return abs(fxx * fy**2 - 2 * fx * fy * fxy + fyy * fx**2) / np.hypot(fx, fy) ** 3

    found = {}
    for axis in (0, 1):
        for i in range(4, n - 5):
            for j in range(4, m - 5):
                step = np.eye(2, dtype=int)[axis]
                line = np.array([phi[tuple(np.array([i, j]) + s * step)] for s in range(-2, 4)])
                if line[2] >= 0.0 or line[3] >= 0.0:
                    continue
                apart = np.poly1d(np.polyfit([1, 2, 3], line[3:], 2)) - np.poly1d(
                    np.polyfit([-2, -1, 0], line[:3], 2)
                )
                slope = apart.deriv()
                roots = [s.real for s in np.roots(apart) if abs(s.imag) < 1e-12]
                roots = [s for s in roots if -1e-9 <= s <= 1.0 + 1e-9]
                if len(roots) != 1 or slope(-2.0) <= 0.0 or slope(3.0) <= 0.0:
                    continue
                a, b = np.array([i, j]), np.array([i, j]) + step
                across = 1 - axis
                gradients = []
                for node, along in ((a, line[2] - line[1]), (b, line[4] - line[3])):
                    beside = [
                        phi[tuple(node + s * np.eye(2, dtype=int)[across])] for s in range(-3, 4)
                    ]
                    gradients.append((along, one_sided(np.array(beside))))
                kappa = max(curvature(*(a - step)), curvature(*(b + step)))
                alpha = np.dot(*gradients)
                bound = max(1.0 - 0.5 * (gamma * kappa) ** 2, 0.5)
                if alpha < min(bound, 1.0 - 0.5 * (gamma * tolerance) ** 2):
                    found[i, j, axis] = roots[0]
    return found


@pytest.mark.parametrize(
    "shape",
    [turned(letter_l(9.0, 8.0), 17.0), Ellipse(11.0, 6.0), ball(9.0)],
)
def test_crossings_are_those_of_algorithm_1(shape):
    grid, phi = sampled(shape, 1.0, half=17.0, shift=(0.31, 0.77))
    twin = by_polynomials(phi, 0.1)
    crossings = find_crossings(Padded.of(grid, phi), phi < 0.0, 0.1, silent)
    positions = Padded.of(grid, phi).positions(crossings.nodes)
    edges = np.column_stack([positions, crossings.axis]).tolist()
    found = {tuple(edge): s for edge, s in zip(edges, crossings.place, strict=True)}
    assert len(twin) > 3
    assert found.keys() == twin.keys()
    for key, s in twin.items():
        assert found[key] == pytest.approx(s, abs=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_crossing_at_a_node_is_found_once(dim):
    """A ridge through nodes lies on the two edges of each, which are equally steep."""
    grid, phi = sampled(lambda x: np.abs(x[:, 0]) - 5.0, 1.0, dim=dim, half=8.0, shift=0.0)
    assert (phi == -5.0).any()
    crossings, fronts = fronts_on_edges(grid, phi, 0.1, silent)
    assert (crossings.axis == 0).all()
    np.testing.assert_allclose(fronts.points[:, 0], 0.0, atol=1e-9)
    assert len(np.unique(fronts.points[:, 1:], axis=0)) == len(fronts.points)
    assert len(fronts.points) == np.prod(grid.shape[1:])
