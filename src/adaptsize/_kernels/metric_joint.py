r"""The intersection of several metrics: the largest one that is nowhere above any of them.

The unit ball of a metric M is the ellipsoid x^T M x <= 1, and with P = M^-1 its volume is
proportional to (det P)^(1/2).  The intersection of the metrics M_s = K_s K_s^T is the solution of

    max log det P   such that   T_s = I - K_s^T P K_s  is positive semidefinite for all s.

The objective is strictly concave and the constraints are convex, so that the solution is unique; it
depends neither on the order of the metrics nor on those that are nowhere active.  It is the
largest ellipsoid in the intersection of ellipsoids with one centre [1]_.

For two metrics the solution is known (see metrics.py).  Otherwise the optimality conditions

    P^-1 = sum_s K_s Y_s K_s^T,   T_s Y_s = 0,   Y_s positive semidefinite

are solved by a primal-dual interior-point method: T_s Y_s = mu I with mu tending to 0.  Coordinates
are such that intersecting two by two, one after another, gives the identity, which is a feasible
start of the right size.

References
----------
.. [1] L. Vandenberghe, S. Boyd, S.-P. Wu, "Determinant maximization with linear matrix inequality
   constraints", SIAM J. Matrix Anal. Appl. 19 (1998) 499-533.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.metrics import (
    column_norm,
    copy_metric,
    factorise,
    fill_factor,
    intersect_into,
    invert,
    invert_lower,
    multiply,
    rotate_columns,
    sandwich,
    sizes_of_factor,
    solve,
)

#: Most metrics that are intersected at a time.
MOST = 16

# The sum of tr(Y_s T_s) at which steps with a constant mu begin, and their number.
_GAP = 1e-10
_CENTRE = 3
_ITERATIONS = 60
# Share to which mu falls after a full step and after a short one, and factors of steps that would
# leave the domain.  With less, iterates come too near to the boundary to move.
_FALL = 0.1
_FALL_NEAR = 0.6
_SHORTER = 0.95
_SHORT = 0.99


# Kernels are compiled once more for each literal that is an argument, so these are none.
YES, NO = np.bool_(True), np.bool_(False)


class Matrices(NamedTuple):
    """Scratch, each float64[dim, dim].

    Parameters
    ----------
    p, step
        P, and its step.
    outer
        K_s T_s^-1 K_s^T, or K_s Y_s K_s^T.
    inverse
        T_s^-1, or P^-1.
    residual
        P^-1 - mu sum_s K_s T_s^-1 K_s^T.
    product, factor, lower, half
        Products, and factors with their inverses.
    base
        S = R diag(h) of intersecting two by two.
    """

    p: np.ndarray
    step: np.ndarray
    outer: np.ndarray
    inverse: np.ndarray
    residual: np.ndarray
    product: np.ndarray
    factor: np.ndarray
    lower: np.ndarray
    half: np.ndarray
    base: np.ndarray


class Joint(NamedTuple):
    """Metrics to intersect, their intersection, and scratch.

    Parameters
    ----------
    h : float64[MOST, dim]
        Sizes of the metrics.
    r : float64[MOST, dim, dim]
        Their directions.
    number : int64[MOST]
        Their numbers.
    h_all : float64[dim]
        Sizes of the intersection.
    r_all : float64[dim, dim]
        Its directions.
    k : float64[MOST, dim, dim]
        Factors.
    t : float64[MOST, dim, dim]
        T_s.
    y : float64[MOST, dim, dim]
        Y_s.
    dt : float64[MOST, dim, dim]
        Steps of T_s.
    dy : float64[MOST, dim, dim]
        Steps of Y_s.
    work : Matrices
    normal : float64[6, 7]
        Equations for the step of P.
    """

    h: np.ndarray
    r: np.ndarray
    number: np.ndarray
    h_all: np.ndarray
    r_all: np.ndarray
    k: np.ndarray
    t: np.ndarray
    y: np.ndarray
    dt: np.ndarray
    dy: np.ndarray
    work: Matrices
    normal: np.ndarray


def new_joint(dim: int) -> Joint:
    """Return scratch for one thread."""
    square = (MOST, dim, dim)
    return Joint(
        h=np.empty((MOST, dim)),
        r=np.empty(square),
        number=np.empty(MOST, np.int64),
        h_all=np.empty(dim),
        r_all=np.empty((dim, dim)),
        k=np.empty(square),
        t=np.empty(square),
        y=np.empty(square),
        dt=np.empty(square),
        dy=np.empty(square),
        work=Matrices(*np.empty((10, dim, dim))),
        normal=np.empty((6, 7)),
    )


@lean
def _add_products(axes, b, c, normal):
    """Add tr(E_a B E_c C) for all pairs of basis matrices to the lower triangle (In/Out)."""
    dim = len(axes)
    row = 0
    for i in range(dim):
        for j in range(i, dim):
            column = 0
            for m in range(i + 1):
                for n in range(m, dim):
                    if column > row:
                        break
                    value = b[i, m] * c[j, n] + b[i, n] * c[j, m]
                    value += b[j, m] * c[i, n] + b[j, n] * c[i, m]
                    value *= (1.0 if i != j else 0.5) * (1.0 if m != n else 0.5)
                    normal[row, column] += value
                    column += 1
            row += 1


@lean
def _longest_step(axes, a, da, moved, factor):
    """Return a share of a step up to 1, most of the way to where a + share da is not definite."""
    dim = len(axes)
    share = 1.0
    for _ in range(100):
        for i in range(dim):
            for j in range(dim):
                moved[i, j] = a[i, j] + share * da[i, j]
        if factorise(dim, moved, factor):
            return share if share == 1.0 else _SHORT * share
        share *= _SHORTER
    return 0.0


@lean
def _fill_equations(axes, count, joint, mu):
    """Fill the equations for the step of P at a given mu; return False if they have no solution.

    With T_s and Y_s eliminated, they are those of the derivative of the first optimality condition.
    """
    dim, work, normal = len(axes), joint.work, joint.normal
    inverse, outer, residual = work.inverse, work.outer, work.residual
    for i in range(dim * (dim + 1) // 2):
        for j in range(7):
            normal[i, j] = 0.0
    if not invert(axes, work.p, work.factor, work.lower, residual):
        return False
    _add_products(axes, residual, residual, normal)
    for s in range(count):
        if not invert(axes, joint.t[s], work.factor, work.lower, inverse):
            return False
        sandwich(axes, joint.k[s], inverse, False, work.half, outer)
        sandwich(axes, joint.k[s], joint.y[s], False, work.half, work.product)
        _add_products(axes, outer, work.product, normal)
        for i in range(dim):
            for j in range(dim):
                residual[i, j] -= mu * outer[i, j]
    row = 0
    for i in range(dim):
        for j in range(i, dim):
            normal[row, 6] = residual[i, j] if i == j else 2.0 * residual[i, j]
            row += 1
    return True


@lean
def _fill_step(axes, s, joint, mu):
    """Fill the steps of T_s and Y_s that follow from that of P."""
    dim, work = len(axes), joint.work
    t, y, dt, dy = joint.t[s], joint.y[s], joint.dt[s], joint.dy[s]
    inverse, half, product = work.inverse, work.half, work.product
    sandwich(axes, joint.k[s], work.step, True, half, dt)
    invert(axes, t, work.factor, work.lower, inverse)
    for i in range(dim):
        for j in range(dim):
            dt[i, j] = -dt[i, j]
    multiply(axes, dt, inverse, (False, False), half)
    multiply(axes, y, half, (False, False), product)
    for i in range(dim):
        for j in range(dim):
            dy[i, j] = mu * inverse[i, j] - y[i, j] - 0.5 * (product[i, j] + product[j, i])


@lean
def _improve(axes, count, joint, mu, inside):
    """Take one step of the interior-point method (In/Out: joint); return its length up to 1.

    ``inside``: whether the step must keep P, T_s and Y_s definite.
    """
    dim, work, normal = len(axes), joint.work, joint.normal
    p, step = work.p, work.step
    m = np.int64(dim * (dim + 1) // 2)
    if not _fill_equations(axes, count, joint, mu) or not solve(m, normal):
        return 0.0
    row = 0
    for i in range(dim):
        for j in range(i, dim):
            step[i, j] = step[j, i] = normal[row, 6]
            row += 1
    share_p = _longest_step(axes, p, step, work.outer, work.factor) if inside else 1.0
    share_y = 1.0
    for s in range(count):
        _fill_step(axes, s, joint, mu)
        if inside:
            t, y, dt, dy = joint.t[s], joint.y[s], joint.dt[s], joint.dy[s]
            share_p = min(share_p, _longest_step(axes, t, dt, work.outer, work.factor))
            share_y = min(share_y, _longest_step(axes, y, dy, work.outer, work.factor))
    for i in range(dim):
        for j in range(dim):
            p[i, j] += share_p * step[i, j]
            for s in range(count):
                joint.y[s, i, j] += share_y * joint.dy[s, i, j]
    return min(share_p, share_y)


@lean
def _fill_slacks(axes, count, joint):
    """Fill T_s = I - K_s^T P K_s; return the sum of tr(Y_s T_s)."""
    dim = len(axes)
    gap = 0.0
    for s in range(count):
        t = joint.t[s]
        sandwich(axes, joint.k[s], joint.work.p, True, joint.work.half, t)
        for i in range(dim):
            for j in range(dim):
                t[i, j] = (1.0 if i == j else 0.0) - t[i, j]
        for i in range(dim):
            for j in range(dim):
                gap += t[i, j] * joint.y[s, i, j]
    return gap


@lean
def _drop_inactive(axes, count, joint):
    """Remove the metrics of small multipliers (In/Out: joint); return the new count.

    The multipliers tr(Y_s K_s^T P K_s) = tr(Y_s (I - T_s)) add up to dim.
    """
    dim, kept = len(axes), 0
    for s in range(count):
        total = 0.0
        for i in range(dim):
            total += joint.y[s, i, i]
            for j in range(dim):
                total -= joint.y[s, i, j] * joint.t[s, i, j]
        # Metrics with smaller multipliers are not active.
        if total <= 1e-6:
            continue
        joint.number[kept] = joint.number[s]
        for j in range(dim):
            joint.h[kept, j] = joint.h[s, j]
            for i in range(dim):
                joint.r[kept, i, j] = joint.r[s, i, j]
                joint.k[kept, i, j] = joint.k[s, i, j]
                joint.t[kept, i, j] = joint.t[s, i, j]
                joint.y[kept, i, j] = joint.y[s, i, j]
        kept += 1
    return kept


@lean
def _optimise(axes, count, joint):
    """Solve for P from the feasible start I / 2 (In/Out: joint).

    Metrics that are not active are removed near the solution.  Returns the number of the others.
    """
    dim, p = len(axes), joint.work.p
    for i in range(dim):
        for j in range(dim):
            p[i, j] = 0.5 if i == j else 0.0
            for s in range(count):
                joint.y[s, i, j] = 1.0 / count if i == j else 0.0
    fall, n = _FALL, count * dim
    gap = _fill_slacks(axes, count, joint)
    for _ in range(_ITERATIONS):
        if gap < _GAP:
            break
        step = _improve(axes, count, joint, fall * gap / n, YES)
        gap = _fill_slacks(axes, count, joint)
        fall = _FALL if step > 0.9 else _FALL_NEAR
    mu = gap / n
    count = _drop_inactive(axes, count, joint)
    for _ in range(_CENTRE):
        _improve(axes, count, joint, mu, YES)
        _fill_slacks(axes, count, joint)
    # From a point on the path of solutions for mu, a step to mu = 0 has an error of order mu^2.
    _improve(axes, count, joint, 0.0, NO)
    _fill_slacks(axes, count, joint)
    return count


@lean
def two_by_two(axes, count, joint):
    """Fill the result (Out: h_all, r_all) of intersecting two by two, one after another."""
    both = (joint.h_all, joint.r_all)
    copy_metric(axes, (joint.h[0], joint.r[0]), 0.0, both)
    for s in range(1, count):
        other = (joint.h[s], joint.r[s])
        intersect_into(axes, both, other, joint.work.half, joint.work.product)


@lean
def _as_metric(axes, count, joint):
    """Set the result to P^-1 (In/Out: h_all, r_all), scaled so that no metric exceeds it."""
    dim, work = len(axes), joint.work
    base, factor, product = work.base, work.factor, work.product
    for i in range(dim):
        for j in range(dim):
            factor[i, j] = 0.0
    factorise(dim, work.p, factor)
    largest = 0.0
    for s in range(count):
        multiply(axes, joint.k[s], factor, (True, False), product)
        rotate_columns(axes, product, None)
        for j in range(dim):
            largest = max(largest, column_norm(axes, product, j))
    invert_lower(axes, factor, work.lower)
    fill_factor(axes, joint.h_all, joint.r_all, base)
    multiply(axes, base, work.lower, (False, True), product)
    for i in range(dim):
        for j in range(dim):
            product[i, j] *= largest
    sizes_of_factor(axes, product, joint.h_all, joint.r_all)


@lean
def intersect_several(axes, count, joint):
    """Fill the intersection of the first metrics of ``joint`` (In/Out).

    Metrics that are not active are removed.  Returns the number of the others.
    """
    dim = len(axes)
    while True:
        two_by_two(axes, count, joint)
        if count <= 2:
            return count
        for s in range(count):  # K' = S^T K with S = R diag(h)
            multiply(axes, joint.r_all, joint.r[s], (True, False), joint.k[s])
            for i in range(dim):
                for j in range(dim):
                    joint.k[s, i, j] *= joint.h_all[i] / joint.h[s, j]
        left = _optimise(axes, count, joint)
        kept = _drop_inactive(axes, left, joint)
        if kept == left and kept > 2:
            _as_metric(axes, kept, joint)
            return kept
        count = kept


@lean_kernel
def intersect_stacks(axes, stacks, out, joint):
    """Intersect several metrics, node by node.

    Parameters
    ----------
    axes : tuple of length dim
    stacks : tuple of float64[m, n, dim], float64[m, n, dim, dim]
        From 2 to MOST metrics at each of n nodes.
    out : tuple of float64[n, dim], float64[n, dim, dim]
        Out.
    joint : Joint
    """
    (h, r), (h_all, r_all) = stacks, out
    count = h.shape[0]
    for v in range(h.shape[1]):
        for s in range(count):
            copy_metric(axes, (h[s, v], r[s, v]), 0.0, (joint.h[s], joint.r[s]))
            joint.number[s] = s
        intersect_several(axes, count, joint)
        copy_metric(axes, (joint.h_all, joint.r_all), 0.0, (h_all[v], r_all[v]))
