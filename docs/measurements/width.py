"""Measure the widths, separations and times of docs/width.md; takes about a minute.

python docs/measurements/width.py [NAME ...]
"""

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import adaptsize as ads
from adaptsize.geometry import boundary_separation, boundary_width
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.separation import Separation
from adaptsize.geometry.walls import WallTree
from adaptsize.geometry.width import Width

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import solids
from curved_shapes import irregular_torus, sliver_cylinder, smooth_torus
from meshes import random_sphere

ROOT = Path(__file__).parents[2]


def quiet(*_):
    """Report no progress."""


def report(name, ratio):
    """Print the least, the median and the largest width over the exact one."""
    found = ratio[np.isfinite(ratio)]
    print(
        f"{name}: {found.min():.4f} {np.median(found):.4f} {found.max():.4f}, "
        f"{len(ratio) - len(found)} of {len(ratio)} without a wall"
    )


def shapes():
    """Print the widths at the facets of boundaries of known width."""
    plate = solids.box(10, 10, 1)
    thick = np.abs(np.ptp(plate.points[plate.cells], axis=1)[:, 2]) < 1e-12
    report("box 10 x 10 x 1, top and bottom", boundary_width(plate)[thick])
    report("the same, rim", boundary_width(plate)[~thick] / 10.0)
    for degrees in (10, 20, 29):
        angle = np.radians(degrees)
        side = np.linspace(0.0, 3.9, 40)
        corners = np.concatenate(
            [
                np.column_stack([side, np.zeros(40)]),
                4.0 * np.array([[1.0, 0.0], [np.cos(angle), np.sin(angle)]]),
            ]
        )
        wedge = solids.outline(corners)
        x = wedge.points[wedge.cells].mean(axis=1)[:39, 0]
        near = x < 4.0 * np.cos(angle)
        report(f"wedge of {degrees}", boundary_width(wedge)[:39][near] / (np.tan(angle) * x)[near])
    ring = solids.outline(solids.circle(48, 2.0), solids.circle(48, 1.5)[::-1])
    report("annulus, 48 segments around", boundary_width(ring) / 0.5)
    report("cylinder of 32 uneven strips", boundary_width(sliver_cylinder(32, 814)) / 2.0)
    report("sphere of 5000 random nodes", boundary_width(random_sphere(5000, 815)) / 2.0)


def rough():
    """Print the widths of a torus whose nodes are moved, and of one with holes."""
    for n in (24, 48):
        torus, _ = irregular_torus(n, 825)
        report(f"torus of {torus.n_points} nodes", boundary_width(torus) / 0.8)
    edge = float(np.median(torus.edge_lengths))
    for share in (0.01, 0.05, 0.1):
        noise = np.random.default_rng(20061121).normal(size=torus.points.shape)
        noise *= share * edge / np.linalg.norm(noise, axis=1)[:, None]
        found = boundary_width(ads.SimplexMesh(torus.points + noise, torus.cells)) / 0.8
        report(f"... moved by {share:g} edges", found)
        print(f"    {100 * (found < 0.5).mean():.2f} % below half")
    rng = np.random.default_rng(20061122)
    cells = np.array(torus.cells[rng.random(torus.n_cells) > 0.05])
    turned = rng.random(len(cells)) < 1.0 / 3.0
    cells[turned] = cells[turned][:, [1, 0, 2]]
    holes = boundary_width(ads.SimplexMesh(torus.points, cells)) / 0.8
    report("... with holes, a third turned", holes)


def surfaces():
    """Return the surfaces in data/, and the boundary of a block."""
    names = ("bracket.stl", "deer.ply", "block.vtu")
    meshes = [ads.read(ROOT / "data" / name) for name in names]
    surfaces = [m if m.cell_dim == 2 else m.boundary().mesh for m in meshes]
    return dict(zip(names, surfaces, strict=True))


def at_feature_nodes(surface):
    """Return the separations at the nodes on feature edges."""
    faces = Faces.of(surface)
    separation = Separation(faces, 30.0, WallTree.of(faces))
    found = np.full(surface.n_points, np.inf)
    found[separation.nodes.node] = separation.at_nodes(quiet).distances
    return found


def change(a, b):
    """Return the largest relative difference, and the number of differences above 1e-6."""
    with np.errstate(invalid="ignore"):
        off = np.where(a == b, 0.0, np.abs(a - b) / np.minimum(a, b))
    off[np.isnan(off)] = np.inf
    return f"{off.max():.1e}, {(off > 1e-6).sum()} of {len(off)} above 1e-6"


def invariance():
    """Print how W and F change under a rotation, a mirror image, a scaling and a renumbering."""
    turn = Rotation.random(random_state=np.random.default_rng(20061201)).as_matrix()
    for name, surface in surfaces().items():
        width, separation = boundary_width(surface), at_feature_nodes(surface)
        moves = {
            "rotated and moved": surface.points @ turn.T + surface.diameter,
            "mirrored": surface.points * [-1.0, 1.0, 1.0],
            "times 3": 3.0 * surface.points,
            "times 1024": 1024.0 * surface.points,
        }
        for text, points in moves.items():
            other = ads.SimplexMesh(points, surface.cells)
            scale = {"times 3": 3.0, "times 1024": 1024.0}.get(text, 1.0)
            print(
                f"{name} {text}: W {change(width, boundary_width(other) / scale)}; "
                f"F {change(separation, at_feature_nodes(other) / scale)}"
            )
        order = np.random.default_rng(20061202).permutation(surface.n_points)
        cells = np.random.default_rng(20061203).permutation(surface.n_cells)
        other = ads.SimplexMesh(surface.points[np.argsort(order)], order[surface.cells[cells]])
        print(
            f"{name} renumbered: W {change(width[cells], boundary_width(other))}; "
            f"F {change(separation, at_feature_nodes(other)[order])}"
        )


def speed():
    """Print processor times, with compiled kernels."""
    boundary_separation(solids.box(3, 2, 1))
    boundary_width(solids.box(3, 2, 1))
    meshes = {"torus": smooth_torus(40)[0], "fine torus": smooth_torus(140)[0]} | surfaces()
    for name, mesh in meshes.items():
        start = time.process_time()
        faces = Faces.of(mesh)
        split = time.process_time()
        width = Width(faces, 30.0)
        _ = width.walls
        ready = time.process_time()
        width.at_centroids(quiet)
        shot = time.process_time()
        n_nodes = len(boundary_separation(mesh).points)
        end = time.process_time()
        print(
            f"{name}, {mesh.n_cells} triangles: {split - start:.2f} s for {faces.n_faces} faces, "
            f"{ready - split:.2f} s for the tree, {1e6 * (shot - ready) / mesh.n_cells:.1f} us "
            f"per ray; separation {end - shot:.2f} s for {n_nodes} points"
        )


if __name__ == "__main__":
    for measure in (shapes, rough, invariance, speed):
        if len(sys.argv) == 1 or measure.__name__ in sys.argv[1:]:
            print(f"\n{measure.__name__.upper()}\n", flush=True)
            measure()
