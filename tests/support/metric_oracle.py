"""Slow twins of the operations on metrics, and random metrics."""

import numpy as np
from scipy.optimize import minimize

from adaptsize.metrics import Metric


def random_rotations(rng, n, dim):
    return np.linalg.qr(rng.normal(size=(n, dim, dim)))[0]


def random_metric(rng, n, dim, decades):
    """Return sizes of up to 1 and down to 10^-decades in random directions."""
    return Metric(10.0 ** rng.uniform(-decades, 0.0, (n, dim)), random_rotations(rng, n, dim))


def excess(present, sizes, directions):
    """Return the largest eigenvalues of M relative to a present metric: at most 1 if not above it.

    present : Metric with n nodes, or 1; sizes, directions : float64[n, dim], float64[n, dim, dim]
    """
    s = present.directions * present.sizes[:, None, :]
    relative = (directions.swapaxes(1, 2) @ s) / sizes[:, :, None]
    return np.linalg.norm(relative, 2, axis=(1, 2)) ** 2


def largest_ratio(a, b):
    """Return by how much any size of two metrics differs in any direction, as a ratio less 1."""
    worst = max(excess(a, b.sizes, b.directions).max(), excess(b, a.sizes, a.directions).max())
    return np.sqrt(worst) - 1.0


def limited_by_all(points, metric, g, nodes=None, distances_to=None):
    """Return the limited metric by trying all nodes at each node, without tree and survivors.

    ``distances_to(v)`` returns the distances of all points from point v, by default straight ones.
    """
    bounded = np.isfinite(metric.sizes).any(axis=1)
    metric = metric[bounded]
    nodes = np.arange(len(points)) if nodes is None else nodes
    n, dim = len(nodes), points.shape[1]
    h, r = np.empty((n, dim)), np.empty((n, dim, dim))
    for i, v in enumerate(nodes):
        lengths = distances_to(v) if distances_to else np.linalg.norm(points - points[v], axis=1)
        grown = metric.sizes + g * lengths[bounded, None]
        k = int(np.argmin(grown.max(axis=1)))
        parts = [Metric.of(grown[k : k + 1].copy(), metric.directions[k : k + 1])]
        while True:
            present = parts[0].intersect(*parts[1:])
            over = excess(present, grown, metric.directions)
            k = int(np.argmax(over))
            if over[k] <= 1.0 + 1e-10 or len(parts) == 15:
                break
            parts.append(Metric.of(grown[k : k + 1].copy(), metric.directions[k : k + 1]))
        h[i], r[i] = present.sizes[0], present.directions[0]
    return Metric.of(h, r)


def largest_inscribed(parts):
    """Return log sqrt(det M) of the intersection of metrics of one node each, by optimisation.

    Ellipsoids are images of the unit ball by a lower triangle C; the constraints are that no part
    exceeds the metric (C C^T)^-1.
    """
    dim = parts[0].dim
    least = min(part.sizes.min() for part in parts)
    factors = [part.directions[0].T / part.sizes[0][:, None] * least for part in parts]
    rows, columns = np.tril_indices(dim)

    def triangle(x):
        c = np.zeros((dim, dim))
        c[rows, columns] = x
        c[np.diag_indices(dim)] = np.exp(np.minimum(np.diag(c), 50.0))  # trial steps are long
        return c

    def slack(x):
        c = triangle(x)
        return np.concatenate(
            [np.linalg.eigvalsh(np.eye(dim) - (f @ c) @ (f @ c).T) for f in factors]
        )

    found = minimize(
        lambda x: -x[rows == columns].sum(),
        np.zeros(len(rows)),
        constraints={"type": "ineq", "fun": slack},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-13},
    )
    return found.fun - dim * np.log(least), slack(found.x).min()
