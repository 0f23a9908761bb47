"""Steady compressible flow of a perfect gas on triangles: a cell-centred finite volume solver.

Second order in space.  In each triangle the state is linear: its slope is that of the P1 function
of nodal values, which are fitted to the triangles around each node.  It is limited such that the
state at each corner stays between the least and the largest mean around that node, with
Venkatakrishnan's smooth function of the two.  Fluxes are HLLC's; a wall has the pressure of the
wave that stops what flows into it; the far boundary has the free stream beyond it.

Time steps are local and implicit: Gauss-Seidel sweeps with and against the stream, the matrix
that of the first-order scheme.

Density and speed of sound of the free stream are 1, so that its pressure is 1 / 1.4
and its speed the Mach number.

References: E. F. Toro, M. Spruce, W. Speares, Shock Waves 4 (1994) 25-34 (HLLC); P. Batten,
N. Clarke, C. Lambert, D. M. Causon, SIAM J. Sci. Comput. 18 (1997) 1553-1570 (its wave speeds);
V. Venkatakrishnan, J. Comput. Phys. 118 (1995) 120-130, and J. S. Park, S.-H. Yoon, C. Kim,
J. Comput. Phys. 229 (2010) 788-812 (limiting); S. Yoon, A. Jameson, AIAA J. 26 (1988) 1025-1026
(symmetric sweeps).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.sparse import csr_array

import adaptsize as ads

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

#: For functions that only compiled ones call; less to compile.
inner = njit(cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)

GAMMA = 1.4
#: What stands for a neighbour beyond the boundary.
WALL, FAR = -1, -2
#: Changes of the state below (this times the root of the area)^(3/2) are not limited.
_SMOOTH = 2.0
#: Most relative change of density and pressure in one step.
_LARGEST_CHANGE = 0.2


def free_stream(mach: float, angle: float = 0.0) -> FloatArray:
    """Return density, velocity (two components) and pressure; the angle in degrees."""
    turn = math.radians(angle)
    return np.array([1.0, mach * math.cos(turn), mach * math.sin(turn), 1.0 / GAMMA])


def mach_number(w: FloatArray) -> FloatArray:
    """Return the Mach numbers of states (density, velocity, pressure), float64[..., 4]."""
    speed = np.hypot(w[..., 1], w[..., 2])
    return np.asarray(speed / np.sqrt(GAMMA * w[..., 3] / w[..., 0]))


def entropy_error(w: FloatArray) -> FloatArray:
    """Return p / rho^gamma over that of the free stream, less one."""
    return np.asarray(GAMMA * w[..., 3] / w[..., 0] ** GAMMA - 1.0)


def conserved(w: FloatArray) -> FloatArray:
    """Return density, momentum and energy per area of states."""
    rho, u, v, p = np.moveaxis(w, -1, 0)
    energy = p / (GAMMA - 1.0) + 0.5 * rho * (u * u + v * v)
    return np.stack([rho, rho * u, rho * v, energy], axis=-1)


def primitive(q: FloatArray) -> FloatArray:
    """Return the states of density, momentum and energy per area."""
    rho, u, v = q[..., 0], q[..., 1] / q[..., 0], q[..., 2] / q[..., 0]
    p = (GAMMA - 1.0) * (q[..., 3] - 0.5 * rho * (u * u + v * v))
    return np.stack([rho, u, v, p], axis=-1)


@dataclass(frozen=True)
class FlowMesh:
    """A mesh of triangles as the solver needs it.

    Attributes
    ----------
    mesh : SimplexMesh
    left, right : int64[n_faces]
        Triangles at each edge; ``right`` may be ``WALL`` or ``FAR``.
    normals : float64[n_faces, 2]
        From left to right, as long as the edge.
    middles : float64[n_faces, 2]
    cell_faces : int64[n_cells, 3]
    centres : float64[n_cells, 2]
    hats : float64[n_cells, 3, 2]
        Gradients of the hat functions of the corners.
    to_nodes : csr_array (n_points, n_cells)
        Weights of the triangles around each node; exact for linear functions.
    order : int64[n_cells]
        Triangles from left to right.
    """

    mesh: ads.SimplexMesh
    left: IntArray
    right: IntArray
    normals: FloatArray
    middles: FloatArray
    cell_faces: IntArray
    centres: FloatArray
    hats: FloatArray
    to_nodes: csr_array
    order: IntArray

    @classmethod
    def of(cls, mesh: ads.SimplexMesh, is_wall: Callable[[FloatArray], Any]) -> FlowMesh:
        """Return what the solver needs; ``is_wall`` selects midpoints of boundary edges."""
        n_faces = len(mesh.facets)
        cell_faces = mesh.cell_facets.astype(np.int64)
        right = np.full(n_faces, FAR, np.int64)
        left = np.empty(n_faces, np.int64)
        cell_of = np.repeat(np.arange(mesh.n_cells), 3)
        left[cell_faces.ravel()] = cell_of  # the last one that is written
        other = left[cell_faces.ravel()] != cell_of
        right[cell_faces.ravel()[other]] = cell_of[other]
        ends = mesh.points[mesh.facets]
        middles = ends.mean(axis=1)
        right[(right == FAR) & np.asarray(is_wall(middles))] = WALL
        along = ends[:, 1] - ends[:, 0]
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
        corners = mesh.points[mesh.cells]
        centres = corners.mean(axis=1)
        outward = np.einsum("fd,fd->f", normals, middles - centres[left]) > 0.0
        normals[~outward] *= -1.0
        opposite = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)
        hats = np.stack([opposite[..., 1], -opposite[..., 0]], axis=-1)
        hats /= 2.0 * mesh.signed_measures[:, None, None]
        return cls(
            mesh, left, right, normals, middles, cell_faces, centres, hats,
            _fits(mesh, centres), np.argsort(centres[:, 0]),
        )  # fmt: skip

    @property
    def inflow(self) -> float:
        """Length of the far boundary across the stream along x, on the left."""
        far = self.right == FAR
        return float(-np.minimum(self.normals[far, 0], 0.0).sum())


def _fits(mesh: ads.SimplexMesh, centres: FloatArray) -> csr_array:
    """Return weights of linear fits to the centres around each node, evaluated at the node.

    Where the centres nearly lie on a line, or are too few, the fit is drawn to the mean.
    """
    pointer, ring = (a.astype(np.int64) for a in mesh.rings)
    node = np.repeat(np.arange(mesh.n_points), np.diff(pointer))
    away = centres[ring] - mesh.points[node]
    weight = 1.0 / np.linalg.norm(away, axis=1)

    def sums(values: FloatArray) -> FloatArray:
        return np.bincount(node, weight * values, mesh.n_points).astype(np.float64, copy=False)

    total = np.maximum(sums(np.ones(len(ring))), np.finfo(float).tiny)
    mean = np.stack([sums(away[:, d]) / total for d in (0, 1)], axis=1)
    off = away - mean[node]
    second = np.empty((mesh.n_points, 2, 2))
    for a in (0, 1):
        for b in (0, 1):
            second[:, a, b] = sums(off[:, a] * off[:, b]) / total
    scale = second[:, 0, 0] + second[:, 1, 1] + np.einsum("nd,nd->n", mean, mean)
    second += (0.03 * scale * _lopsided(second))[:, None, None] * np.eye(2)
    slope = -np.linalg.solve(second, mean[..., None])[..., 0]
    share = (1.0 + np.einsum("nd,nd->n", off, slope[node])) * weight / total[node]
    return csr_array((share, ring, pointer), shape=(mesh.n_points, mesh.n_cells))


def _lopsided(second: FloatArray) -> npt.NDArray[np.bool_]:
    low, high = np.moveaxis(np.linalg.eigvalsh(second), -1, 0)
    return np.asarray(low < 0.03 * high + np.finfo(float).tiny)


@dataclass(frozen=True)
class Solution:
    """A flow, and how it was found."""

    flow: FlowMesh
    w: FloatArray
    """Density, velocity and pressure of each triangle, float64[n_cells, 4]."""
    history: FloatArray
    """After each step, the sum over triangles of what flows in and not out, over the inflow."""
    converged: bool
    mass_lost: float
    """What flows in through the boundary and not out, over the inflow."""

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.history)

    def at_nodes(self, values: FloatArray) -> FloatArray:
        """Return values of triangles at the nodes, between those around each of them."""
        pointer, ring = self.flow.mesh.rings
        fitted = self.flow.to_nodes @ values
        low = np.minimum.reduceat(values[ring], pointer[:-1])
        high = np.maximum.reduceat(values[ring], pointer[:-1])
        return np.asarray(np.clip(fitted, low, high))


def solve(
    flow: FlowMesh,
    stream: FloatArray,
    start: FloatArray | None = None,
    *,
    tolerance: float = 1e-5,
    max_steps: int = 2000,
    cfl: float = 1e5,
    sweeps: int = 20,
) -> Solution:
    """Return the steady flow, with the free stream beyond the far boundary.

    Parameters
    ----------
    flow : FlowMesh
    stream : float64[4]
    start : float64[n_cells, 4], optional
        The free stream if not given.
    tolerance : float
        Of the imbalance in `Solution.history`.
    max_steps : int
    cfl : float
        Time steps over those of explicit schemes, reached after 50 steps.
    sweeps : int
        Gauss-Seidel sweeps, there and back, in each step.
    """
    w = np.tile(stream, (flow.mesh.n_cells, 1)) if start is None else np.array(start)
    work = _Work.of(flow)
    history: list[float] = []
    inflow = float(stream[0] * math.hypot(stream[1], stream[2])) * flow.inflow
    while len(history) < max_steps and (not history or history[-1] > tolerance):
        balance = residual(flow, w, stream, work)
        history.append(float(np.abs(balance[:, 0]).sum() / inflow))
        if history[-1] <= tolerance:
            break
        ramp = min(1.0, (len(history) / 50.0) ** 2)
        step(w, balance, flow.left, flow.right, flow.normals, flow.cell_faces, flow.order,
             1.0 + (cfl - 1.0) * ramp, sweeps, work.waves, work.change)  # fmt: skip
    lost = abs(float(residual(flow, w, stream, work)[:, 0].sum())) / inflow
    return Solution(flow, w, np.array(history), history[-1] <= tolerance, lost)


@dataclass(frozen=True)
class _Work:
    """Arrays that are filled anew in each step."""

    low: FloatArray
    high: FloatArray
    slopes: FloatArray
    balance: FloatArray
    change: FloatArray
    waves: FloatArray

    @classmethod
    def of(cls, flow: FlowMesh) -> _Work:
        n, m = flow.mesh.n_points, flow.mesh.n_cells
        return cls(
            *(np.empty(s) for s in ((n, 4), (n, 4), (m, 4, 2), (m, 4), (m, 4), len(flow.left)))
        )


def residual(
    flow: FlowMesh, w: FloatArray, stream: FloatArray, work: _Work | None = None
) -> FloatArray:
    """Return what flows out of each triangle: mass, momentum and energy, float64[n_cells, 4]."""
    work = work or _Work.of(flow)
    nodal = flow.to_nodes @ w
    cells = flow.mesh.cells
    bound_at_nodes(w, cells, work.low, work.high)
    limited_slopes(w, nodal, work.low, work.high, cells, flow.mesh.points, flow.centres,
                   flow.hats, flow.mesh.measures, work.slopes)  # fmt: skip
    sum_fluxes(w, work.slopes, flow.left, flow.right, flow.normals, flow.middles, flow.centres,
               stream, work.balance)  # fmt: skip
    return work.balance


@njit(cache=True)
def bound_at_nodes(w, cells, low, high):
    """Fill the least and the largest state of the triangles around each node.

    w : float64[m, 4]; cells : int32[m, 3]; low, high : float64[n, 4], out
    """
    low[:] = np.inf
    high[:] = -np.inf
    for c in range(len(cells)):
        for i in range(3):
            node = cells[c, i]
            for k in range(4):
                low[node, k] = min(low[node, k], w[c, k])
                high[node, k] = max(high[node, k], w[c, k])


@njit(cache=True)
def limited_slopes(w, nodal, low, high, cells, points, centres, hats, areas, slopes):
    """Fill the gradient of the state in each triangle, float64[m, 4, 2], out."""
    for c in range(len(cells)):
        # Where nothing but rounding or a smooth extremum is seen nothing is limited.
        small = (_SMOOTH * math.sqrt(areas[c])) ** 3
        for k in range(4):
            gx = gy = 0.0
            for i in range(3):
                gx += nodal[cells[c, i], k] * hats[c, i, 0]
                gy += nodal[cells[c, i], k] * hats[c, i, 1]
            share = 1.0
            for i in range(3):
                node = cells[c, i]
                rise = gx * (points[node, 0] - centres[c, 0])
                rise += gy * (points[node, 1] - centres[c, 1])
                room = (high[node, k] if rise > 0.0 else low[node, k]) - w[c, k]
                if rise != 0.0:
                    above = (room * room + small) + 2.0 * rise * room
                    below = room * room + 2.0 * rise * rise + rise * room + small
                    share = min(share, above / below)
            slopes[c, k, 0] = share * gx
            slopes[c, k, 1] = share * gy


@njit(cache=True)
def sum_fluxes(w, slopes, left, right, normals, middles, centres, stream, balance):
    """Fill the sum of the fluxes out of each triangle, float64[m, 4], out."""
    balance[:] = 0.0
    a, b, flux = np.empty(4), np.empty(4), np.empty(4)
    for f in range(len(left)):
        i, j = left[f], right[f]
        length = math.hypot(normals[f, 0], normals[f, 1])
        nx, ny = normals[f, 0] / length, normals[f, 1] / length
        state_at(w, slopes, centres, i, middles[f, 0], middles[f, 1], a)
        if j == WALL:
            flux[0] = flux[3] = 0.0
            # The pressure of the wave that stops what flows into the wall.
            pressure = a[3] + math.sqrt(GAMMA * a[3] * a[0]) * (a[1] * nx + a[2] * ny)
            flux[1], flux[2] = pressure * nx, pressure * ny
        else:
            if j == FAR:
                b[:] = stream
            else:
                state_at(w, slopes, centres, j, middles[f, 0], middles[f, 1], b)
            hllc(a, b, nx, ny, flux)
        for k in range(4):
            balance[i, k] += length * flux[k]
            if j >= 0:
                balance[j, k] -= length * flux[k]


@inner
def state_at(w, slopes, centres, c, x, y, state):
    """Fill the state of triangle c at a point, or its mean if that were no gas."""
    for k in range(4):
        state[k] = w[c, k] + slopes[c, k, 0] * (x - centres[c, 0])
        state[k] += slopes[c, k, 1] * (y - centres[c, 1])
    if state[0] <= 0.0 or state[3] <= 0.0:
        for k in range(4):
            state[k] = w[c, k]


@njit(cache=True)
def hllc(a, b, nx, ny, flux):
    """Fill the flux along a unit normal from state a to state b."""
    ca, cb = math.sqrt(GAMMA * a[3] / a[0]), math.sqrt(GAMMA * b[3] / b[0])
    qa, qb = a[1] * nx + a[2] * ny, b[1] * nx + b[2] * ny
    # With Roe's means the waves of a single shock are exact.
    ra, rb = math.sqrt(a[0]), math.sqrt(b[0])
    q = (ra * qa + rb * qb) / (ra + rb)
    spread = 0.5 * (GAMMA - 1.0) * ra * rb / (ra + rb) ** 2 * (qb - qa) ** 2
    c = math.sqrt((ra * ca * ca + rb * cb * cb) / (ra + rb) + spread)
    slow, fast = min(qa - ca, q - c), max(qb + cb, q + c)
    below, above = a[0] * (slow - qa), b[0] * (fast - qb)
    contact = (b[3] - a[3] + below * qa - above * qb) / (below - above)
    if contact >= 0.0:
        one_side(a, qa, slow, contact, nx, ny, flux)
    else:
        one_side(b, qb, fast, contact, nx, ny, flux)


@inner
def one_side(a, q, wave, contact, nx, ny, flux):
    """Fill the flux between a wave and the contact, or before that wave."""
    energy = a[3] / (GAMMA - 1.0) + 0.5 * a[0] * (a[1] * a[1] + a[2] * a[2])
    flux[0] = a[0] * q
    flux[1] = a[0] * q * a[1] + a[3] * nx
    flux[2] = a[0] * q * a[2] + a[3] * ny
    flux[3] = q * (energy + a[3])
    if (wave < 0.0) == (contact >= 0.0):
        density = a[0] * (wave - q) / (wave - contact)
        flux[0] += wave * (density - a[0])
        flux[1] += wave * (density * (a[1] + (contact - q) * nx) - a[0] * a[1])
        flux[2] += wave * (density * (a[2] + (contact - q) * ny) - a[0] * a[2])
        lift = (contact - q) * (contact + a[3] / (a[0] * (wave - q)))
        flux[3] += wave * (density * (energy / a[0] + lift) - energy)


@njit(cache=True)
def step(w, balance, left, right, normals, cell_faces, order, cfl, sweeps, waves, change):
    """Move the state by one implicit step; waves, float64[n_faces], and change, are for work.

    The matrix is that of the first-order scheme whose fluxes are damped by the fastest wave.
    """
    for f in range(len(left)):
        nx, ny = normals[f, 0], normals[f, 1]
        waves[f] = fastest_wave(w, left[f], nx, ny)
        if right[f] >= 0:
            waves[f] = max(waves[f], fastest_wave(w, right[f], nx, ny))
    change[:] = 0.0
    m = len(order)
    for sweep in range(2 * sweeps):
        for at in range(m):
            i = order[at] if sweep % 2 == 0 else order[m - 1 - at]
            sweep_cell(i, w, balance, left, right, normals, cell_faces, cfl, waves, change)
    for i in range(m):
        update_cell(w, change, i)


@inner
def fastest_wave(w, i, nx, ny):
    """Return the speed of the fastest wave along a normal, times its length."""
    sound = math.sqrt(GAMMA * w[i, 3] / w[i, 0] * (nx * nx + ny * ny))
    return abs(w[i, 1] * nx + w[i, 2] * ny) + sound


@inner
def sweep_cell(i, w, balance, left, right, normals, cell_faces, cfl, waves, change):
    """Solve for the change of the conserved state of triangle i, given those around it."""
    r0, r1, r2, r3 = -balance[i, 0], -balance[i, 1], -balance[i, 2], -balance[i, 3]
    diagonal = 0.0
    for at in range(3):
        f = cell_faces[i, at]
        j = left[f] + right[f] - i
        wave = waves[f]
        if right[f] >= 0:
            sign = 1.0 if left[f] == i else -1.0
            f0, f1, f2, f3 = flux_change(w, change, j, sign * normals[f, 0], sign * normals[f, 1])
            r0 -= 0.5 * (f0 - wave * change[j, 0])
            r1 -= 0.5 * (f1 - wave * change[j, 1])
            r2 -= 0.5 * (f2 - wave * change[j, 2])
            r3 -= 0.5 * (f3 - wave * change[j, 3])
        diagonal += 0.5 * wave
    diagonal = 1.0 / (diagonal * (1.0 + 1.0 / cfl))
    change[i, 0], change[i, 1] = r0 * diagonal, r1 * diagonal
    change[i, 2], change[i, 3] = r2 * diagonal, r3 * diagonal


@inner
def flux_change(w, change, j, nx, ny):
    """Return the linearised change of the flux along a normal of any length, in triangle j."""
    u, v = w[j, 1], w[j, 2]
    c0, c1, c2, c3 = change[j, 0], change[j, 1], change[j, 2], change[j, 3]
    q = u * nx + v * ny
    kinetic = 0.5 * (u * u + v * v)
    enthalpy = GAMMA / (GAMMA - 1.0) * w[j, 3] / w[j, 0] + kinetic
    dp = (GAMMA - 1.0) * (kinetic * c0 - u * c1 - v * c2 + c3)
    mass = c1 * nx + c2 * ny
    dq = mass - q * c0  # density times the change of q
    return mass, u * dq + q * c1 + dp * nx, v * dq + q * c2 + dp * ny, enthalpy * dq + q * (c3 + dp)


@inner
def update_cell(w, change, i):
    """Add the change of the conserved state of triangle i, or as much as leaves a gas."""
    rho, u, v, p = w[i, 0], w[i, 1], w[i, 2], w[i, 3]
    c0, c1, c2, c3 = change[i, 0], change[i, 1], change[i, 2], change[i, 3]
    energy = p / (GAMMA - 1.0) + 0.5 * rho * (u * u + v * v)
    dp = (GAMMA - 1.0) * (0.5 * (u * u + v * v) * c0 - u * c1 - v * c2 + c3)
    share = min(1.0, _LARGEST_CHANGE / max(abs(c0) / rho, abs(dp) / p, 1e-300))
    w[i, 0] = rho + share * c0
    w[i, 1] = (rho * u + share * c1) / w[i, 0]
    w[i, 2] = (rho * v + share * c2) / w[i, 0]
    energy += share * c3
    w[i, 3] = (GAMMA - 1.0) * (energy - 0.5 * w[i, 0] * (w[i, 1] ** 2 + w[i, 2] ** 2))
    w[i, 3] = max(w[i, 3], 0.5 * p)
