"""Measure the figures of docs/octrees.md; takes about a minute.

python docs/measurements/octrees.py
"""

import resource
import time
from itertools import pairwise

import numpy as np

import adaptsize as ads

G = 0.3
SIZES = np.array([1.0, 5.0])


def sphere(x, radius=0.775):
    """Return the signed distance to a circle or a sphere."""
    return np.linalg.norm(x, axis=1) - radius


def at_sphere(dim, level):
    """Return an octree that is refined at a sphere."""
    return ads.Octree.build([-1] * dim, [1] * dim, ads.refine_at_boundary(sphere), max_level=level)


def growth():
    """Print the number of leaves at a circle and a sphere."""
    print("leaves at a circle or sphere")
    for dim, levels in ((2, (5, 8, 11, 14)), (3, (3, 6, 9))):
        counts = [at_sphere(dim, level).n_leaves for level in levels]
        ratios = [round(b / a, 2) for a, b in pairwise(counts)]
        print(f"  {dim}-D, levels {levels}: {counts}, ratios {ratios}")


def speed(dim, level):
    """Print seconds of wall clock and of this process, and the peak of memory so far."""
    small = at_sphere(dim, 3)  # compiled before it is timed
    small.locator.interpolate(np.ones(small.n_points), small.mesh.points)
    tree = timed("build", lambda: at_sphere(dim, level))
    timed("nodes", lambda: tree.points)
    mesh = timed("mesh", lambda: tree.mesh)
    rng = np.random.default_rng(20051)
    x = rng.uniform(-1.0, 1.0, (1_000_000, dim))
    near = x * (0.775 + rng.uniform(-0.01, 0.01, (1_000_000, 1)))
    near /= np.linalg.norm(x, axis=1, keepdims=True)
    values = rng.random(tree.n_points)
    timed("10^6 points anywhere", lambda: tree.locator.interpolate(values, x))
    timed("10^6 points at the sphere", lambda: tree.locator.interpolate(values, near))
    print(f"  {tree}, {mesh}")


def timed(name, function):
    """Return the result of a function, and print what it took."""
    start = time.perf_counter(), time.process_time()
    result = function()
    wall, own = time.perf_counter() - start[0], time.process_time() - start[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"  {name}: {wall:.2f} s, own {own:.2f} s, peak so far {peak:.2f} GiB")
    return result


def error(dim, spacing, *, balanced):
    """Return nodes and largest error of the two sources of section 6.2, exact near them."""
    sources = np.zeros((2, dim))
    sources[:, 0] = -10.0, 10.0

    def distances(x):
        return np.stack([np.linalg.norm(x - source, axis=1) for source in sources], axis=1)

    def needs_refinement(centres, edges):
        near = np.maximum(distances(centres).min(axis=1) / 10.0, 1.0)
        # Fine on one side of the axis only: its leaves touch others three levels coarser.
        above_axis = np.abs(centres[:, 1] - 0.001) <= 0.5 * edges[:, 1]
        return edges[:, 0] > np.where(above_axis, spacing / 8.0, spacing * near)

    box = ([-50.0] * dim, [50.0] * dim)
    tree = ads.Octree.build(*box, needs_refinement, max_level=12, balanced=balanced)
    exact = (SIZES + G * distances(tree.points)).min(axis=1)
    known = (distances(tree.points) <= 10.0).any(axis=1)
    h = ads.limit_gradient(tree.mesh, np.where(known, exact, np.inf), G, method="fast-marching")
    return tree.n_points, np.abs(h - exact).max()


def convergence():
    """Print errors of the limited sizes and their orders."""
    for dim, counts in ((2, (32, 64, 128, 256, 512)), (3, (16, 32, 64))):
        for balanced in (False, True):
            print(f"{dim}-D, {'balanced' if balanced else 'not balanced'}")
            before = None
            for n in counts:
                n_points, now = error(dim, 100.0 / n, balanced=balanced)
                order = "" if before is None else f", order {np.log2(before / now):.2f}"
                print(f"  spacing 100/{n}: {n_points} nodes, error {now:.4f}{order}")
                before = now


if __name__ == "__main__":
    growth()
    for dim, level in ((2, 18), (3, 9)):
        print(f"speed in {dim}-D")
        speed(dim, level)
    convergence()
