"""Measure the radii and times of docs/feature-size.md; takes about a minute.

python docs/measurements/inscribed_spheres.py
"""

import sys
import time
from pathlib import Path

import numpy as np

import adaptsize as ads
from adaptsize.geometry.medial.inscribed_spheres import SphereFinder

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import solids
from curved_shapes import irregular_torus, sliver_cylinder, smooth_torus
from meshes import random_sphere


def radii(boundary, points=None):
    """Return the smallest radius at each node, or next to each point."""
    finder = SphereFinder(boundary)
    return (finder.at_nodes() if points is None else finder.near(points)).smallest()


def report(name, ratio):
    """Print the least, the median and the largest radius over the exact one."""
    low = (ratio < 0.5).mean()
    print(
        f"{name}: {ratio.min():.3f} {np.median(ratio):.3f} {ratio.max():.3f}"
        f", mean {ratio.mean():.3f}, {100 * low:.2f} % below half"
    )


def ellipse():
    """Print the radii of an ellipse of 2 : 1."""
    x, y = (solids.circle(400) * [2.0, 1.0]).T
    # The ball touches at (x, y) and (x, -y); its radius is |y| over the normal's share of it.
    normal = np.column_stack([x / 4.0, y])
    length = np.linalg.norm(normal, axis=1)
    with np.errstate(invalid="ignore"):
        exact = np.where(np.abs(y) > 1e-12, np.abs(y) * length / np.abs(normal[:, 1]), 0.5)
    report("ellipse 2:1, 400 segments", radii(solids.outline(np.column_stack([x, y]))) / exact)


def shapes():
    """Print the radii of boundaries of known width."""
    report("box 10 x 10 x 1", radii(solids.box(10, 10, 1)) / 0.5)
    for degrees in (10, 20, 29):
        angle = np.radians(degrees)
        x = np.linspace(0.05, 3.5, 50)
        wedge = solids.outline([[0, 0], [4, 0], 4 * np.array([np.cos(angle), np.sin(angle)])])
        found = radii(wedge, np.column_stack([x, np.zeros(50)]))
        # Tangent to the x axis at x and to the other side, until the third side is nearer.
        exact = x * np.tan(0.5 * angle)
        near = x < 2.5
        report(f"wedge of {degrees}", found[near] / exact[near])
    ring = solids.outline(solids.circle(48, 2.0), solids.circle(48, 1.5)[::-1])
    report("annulus, 48 segments around", radii(ring) / 0.25)
    ellipse()
    report("cylinder of 32 uneven strips", radii(sliver_cylinder(32, 814)))
    report("sphere of 5000 random nodes", radii(random_sphere(5000, 815)))


def rough():
    """Print the radii of a torus whose nodes are moved, and of one with holes."""
    for n in (24, 48):
        torus, _ = irregular_torus(n, 825)
        report(f"torus of {torus.n_points} nodes", radii(torus) / 0.4)
    edge = float(np.median(torus.edge_lengths))
    for share in (0.01, 0.05, 0.1):
        noise = np.random.default_rng(20061121).normal(size=torus.points.shape)
        noise *= share * edge / np.linalg.norm(noise, axis=1)[:, None]
        found = radii(ads.SimplexMesh(torus.points + noise, torus.cells)) / 0.4
        report(f"... moved by {share:g} edges", found)
        print(f"    {100 * (found < 0.13).mean():.2f} % below .13")
    rng = np.random.default_rng(20061122)
    cells = np.array(torus.cells[rng.random(torus.n_cells) > 0.05])
    turned = rng.random(len(cells)) < 1.0 / 3.0
    cells[turned] = cells[turned][:, [1, 0, 2]]
    used = np.unique(cells)
    report(
        "... with holes, a third turned", radii(ads.SimplexMesh(torus.points, cells))[used] / 0.4
    )


def speed():
    """Print processor times."""
    for n in (40, 140):
        torus, _ = smooth_torus(n)
        start = time.process_time()
        finder = SphereFinder(torus)
        ready = time.process_time()
        few = torus.points[:: max(1, torus.n_points // 4000)]
        finder.near(few)
        end = time.process_time()
        print(
            f"torus of {torus.n_cells} triangles: {ready - start:.2f} s to prepare, "
            f"{1e6 * (end - ready) / len(few):.0f} us per sphere"
        )
    bracket = ads.read(Path(__file__).parents[2] / "data" / "bracket.stl")
    finder = SphereFinder(bracket)
    low, high = bracket.points.min(axis=0), bracket.points.max(axis=0)
    points = np.random.default_rng(20061123).uniform(low, high, (10_000, 3))
    start = time.process_time()
    finder.near(points)
    print(f"bracket: {1e6 * (time.process_time() - start) / len(points):.0f} us per sphere")


if __name__ == "__main__":
    for measure in (shapes, rough, speed):
        print(f"\n{measure.__name__.upper()}\n", flush=True)
        measure()
