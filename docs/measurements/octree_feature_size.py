"""Measure the figures on octrees in docs/width.md and decision 17; takes about three minutes.

python docs/measurements/octree_feature_size.py [NAME ...]
"""

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import adaptsize as ads

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import planar_shapes as planar
import solid_shapes as solid
import solids
from curved_shapes import irregular_torus, sliver_cylinder, smooth_torus

ROOT = Path(__file__).parents[2]

# A point is false if it is farther than that from the true axis, in spacings, and a piece of
# the true axis missing if no point is closer.
FALSE, MISSING = 1.5, 2.0
G = 0.25
TURN = solid.turn_about((1.0, 2.0, 3.0), 40.0)
ANGLE = np.radians(20.0)
PLANE = np.array([[np.cos(ANGLE), np.sin(ANGLE)], [-np.sin(ANGLE), np.cos(ANGLE)]])


def moved(mesh, turn, shift=0.0):
    """Return a mesh turned (rows times the matrix), after a shift."""
    return ads.SimplexMesh((mesh.points + np.asarray(shift)) @ turn, mesh.cells)


def in_box(x, half):
    """Return the distance of points to a box about the origin, which may be flat."""
    return np.linalg.norm(np.maximum(np.abs(x) - half, 0.0), axis=1)


def filled(*half, n=60):
    """Return points of a box about the origin."""
    axes = [np.linspace(-h, h, n if h > 0.0 else 1) for h in half]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(half))


def circle(radius, n=4000):
    """Return points of a circle in the plane."""
    angle = np.linspace(0.0, 2.0 * np.pi, n)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def plane_shapes():
    """Return name -> (boundary, distance inside, distance from the axis, points of the axis)."""
    letter = [(-1, -1), (1, -1), (1, -0.2), (-0.2, -0.2), (-0.2, 1), (-1, 1)]
    t = np.linspace(-0.6, -0.2, 2000)
    bent = np.column_stack([t, -0.6 + (t + 0.2) ** 2 / 1.6])
    bent = bent[bent[:, 0] >= bent[:, 1]]
    straight = np.column_stack([np.linspace(-0.2, 0.6, 4000), np.full(4000, -0.6)])
    axis = np.concatenate([bent, bent[:, ::-1], straight, straight[:, ::-1]])
    tree = cKDTree(axis)
    oval = solids.circle(400) * [1.0, 0.5]
    return {
        "rectangle 2 : 1, by 20 degrees": (
            moved(solids.outline([[-1, -0.5], [1, -0.5], [1, 0.5], [-1, 0.5]]), PLANE),
            planar.rectangle(2.0, 1.0),
            lambda x: in_box(x, (0.5, 0.0)),
            filled(0.5, 0.0, n=4000),
            PLANE,
        ),
        "annulus .4, 1, 120 segments": (
            solids.outline(solids.circle(120), solids.circle(120, 0.4)[::-1]),
            planar.annulus(0.4, 1.0),
            lambda x: np.abs(np.linalg.norm(x, axis=1) - 0.7),
            circle(0.7),
            np.eye(2),
        ),
        "ellipse 2 : 1, 400 segments": (
            solids.outline(oval),
            planar.ellipse(1.0, 0.5),
            lambda x: in_box(x, (0.75, 0.0)),
            filled(0.75, 0.0, n=4000),
            np.eye(2),
        ),
        "L": (
            solids.outline(letter),
            planar.letter_l(1.0, 0.8),
            lambda x: tree.query(x)[0],
            axis,
            np.eye(2),
        ),
    }


def solid_shapes():
    """Return the same in space."""
    torus, _ = smooth_torus(24, big=0.55, small=0.22)
    ring = np.column_stack([circle(0.55), np.zeros(4000)])
    return {
        "box 1 x .8 x .5, 12 triangles": (
            moved(solids.box(1.0, 0.8, 0.5), TURN, (-0.5, -0.4, -0.25)),
            solid.box(1.0, 0.8, 0.5),
            lambda x: in_box(x, (0.25, 0.15, 0.0)),
            filled(0.25, 0.15, 0.0),
            TURN,
        ),
        "torus .55, .22, 24 around the tube": (
            moved(torus, TURN),
            solid.torus(0.55, 0.22),
            lambda x: np.hypot(np.hypot(x[:, 0], x[:, 1]) - 0.55, x[:, 2]),
            ring,
            TURN,
        ),
        "cylinder .3, 1.4, 32 uneven strips": (
            moved(sliver_cylinder(32, 5, radius=0.3, height=1.4), TURN, (0.0, 0.0, -0.7)),
            solid.cylinder(0.3, 1.4),
            lambda x: in_box(x, (0.0, 0.0, 0.4)),
            filled(0.0, 0.0, 0.4, n=4000),
            TURN,
        ),
    }


def tree_at(boundary, step):
    """Return an octree that is as fine as that at the boundary, and coarse elsewhere."""
    lower, upper = box_around(boundary)
    near = ads.refine_at_boundary(lambda x: boundary.locator.nearest(x)[2], step)
    return ads.Octree.build(lower, upper, near, max_level=14)


def box_around(boundary):
    """Return corners of a box that no symmetry puts nodes on the axis in."""
    low, high = boundary.points.min(axis=0), boundary.points.max(axis=0)
    edge = float((high - low).max())
    part = np.array([0.1, 0.083, 0.117])[: boundary.dim]
    return low - edge * part, high + edge * part[::-1] * 1.09


def refined(tree, boundary, rounds, across=4.0, least=None):
    """Return the octree of the sizes of the last one, so many times."""
    for _ in range(rounds):
        h0 = ads.size_from_feature(
            tree, boundary, method="medial-axis", elements_across=across, hmin=least
        )
        size = ads.SizeFunction(tree, ads.limit_gradient(tree, h0, G, method="fast-marching"))
        wanted = ads.refine_to_size(size, g=G)
        tree = ads.Octree.build(tree.lower, tree.upper, wanted, max_level=14)
    return tree


def ratios(lfs, exact):
    """Return the least, the median and the largest of a feature size over the exact one."""
    found = lfs / exact
    low, middle, high = np.quantile(found, [0.001, 0.5, 0.999])
    return f"{low:.3f} {middle:.3f} {high:.3f}"


def seconds(call, *arguments, **options):
    """Return what a call returns, and its processor time."""
    start = time.process_time()
    found = call(*arguments, **options)
    return found, time.process_time() - start


def judged(points, axis, step):
    """Return what is false, and missing."""
    off = cKDTree(axis).query(points)[0] / step
    gap = cKDTree(points).query(axis)[0] / step
    return (
        f"{len(points):6d} points, {(off > FALSE).sum():3d} false, "
        f"{100 * (gap > MISSING).mean():5.1f} % missing, off by {off.max():.3f}"
    )


def compare(name, shape, step):
    """Print medial axis and width on octrees, and the medial axis on a grid."""
    boundary, distance, away, axis, turn = shape
    print(f"{name}, spacing {step:g}")
    first = tree_at(boundary, step)
    rounds = {"at the boundary": first, "by its own sizes": refined(first, boundary, 2)}
    for text, tree in rounds.items():
        medial, t_axis = seconds(ads.medial_axis, tree, boundary)
        lfs, t_size = seconds(ads.feature_size, tree, boundary, medial)
        quarter, t_rays = seconds(ads.size_from_feature, tree, boundary)
        finest = float(tree.leaf_sizes.min())
        x = tree.points @ turn.T
        inside = distance(x) < 0.0
        exact = (away(x) - distance(x))[inside]
        print(
            f"  octree fine {text}, {finest:.4f}, {tree.n_points} nodes: "
            f"{judged(medial.points @ turn.T, axis, step)}; "
            f"lfs {ratios(lfs[inside], exact)}, {t_axis:.2f} + {t_size:.2f} s; "
            f"half the width by rays {ratios(2.0 * quarter[inside], exact)}, {t_rays:.2f} s"
        )
    grid = ads.CartesianGrid.around(boundary.points, step, margin=3.3 * step)
    phi, t_phi = seconds(ads.signed_distance, grid, boundary)
    medial, t_axis = seconds(ads.medial_axis, grid, phi)
    lfs, t_size = seconds(ads.feature_size, grid, phi, medial)
    x = grid.points @ turn.T
    inside = (distance(x) < 0.0) & (phi.ravel() < 0.0)
    exact = (away(x) - distance(x))[inside]
    print(
        f"  grid, {grid.n_points} nodes: {judged(medial.points @ turn.T, axis, step)}; "
        f"lfs {ratios(lfs.ravel()[inside], exact)}, {t_phi:.2f} + {t_axis:.2f} + {t_size:.2f} s"
    )


def in_the_plane():
    """Print what is found of shapes in the plane."""
    for name, shape in plane_shapes().items():
        for n in (10, 40):
            compare(name, shape, 1.0 / n)


def in_space():
    """Print what is found of solids."""
    for name, shape in solid_shapes().items():
        for n in (8, 16, 32):
            compare(name, shape, 1.0 / n)


def leaves_across():
    """Print what plates get that are so many leaves thick."""
    for degrees in (0.0, 20.0, 45.0):
        turn = solid.turn_about((1.0, 2.0, 3.0), degrees)
        for thick in (0.25, 0.5, 1.0, 2.0, 4.0):
            step = 1.0 / 16.0
            plate = moved(
                solids.box(1.6, 1.4, thick * step), turn, (-0.8, -0.7, -0.5 * thick * step)
            )
            tree = tree_at(plate, 1.01 * 2.0 / 16.0)
            step = float(tree.leaf_sizes.max(axis=1).min())
            plate = moved(
                solids.box(1.6, 1.4, thick * step), turn, (-0.8, -0.7, -0.5 * thick * step)
            )
            tree = tree_at(plate, 1.01 * step)
            lfs = ads.feature_size(tree, plate)
            x = np.abs(tree.points @ turn.T)
            near = (x[:, 2] <= 0.5 * (thick + 1.0) * step) & (x[:, 0] < 0.6) & (x[:, 1] < 0.5)
            known = np.isfinite(lfs[near])
            ratio = lfs[near][known] / (0.5 * thick * step)
            grid = ads.CartesianGrid.around(plate.points, step, margin=3.3 * step)
            phi = ads.signed_distance(grid, plate)
            by_grid = np.array([np.nan])
            if (phi < 0.0).any():
                by_grid = ads.feature_size(grid, phi)[phi < 0.0] / (0.5 * thick * step)
            print(
                f"{degrees:3.0f} degrees, {thick:4.2f} leaves: "
                f"{100 * known.mean():5.1f} % of {near.sum()} nodes known, "
                f"{ratio.min():.3f} {np.median(ratio):.3f} {ratio.max():.3f}; "
                f"grid {by_grid.min():.3f} {np.median(by_grid):.3f} {by_grid.max():.3f}"
            )


def gap_that_varies():
    """Print the feature size over half the width, on plates 10 long and .2 to 2 thick."""
    wedge = solids.wedge_plate(10.0, 6.0, 0.2, 2.0)
    # The sum of the distances from the nearer wall and from the plane half way between both.
    slope = np.arctan(0.18)
    tree = tree_at(wedge, 0.3)
    for rounds in range(2):
        lfs = ads.feature_size(tree, wedge)
        rays = 2.0 * ads.size_from_feature(tree, wedge)
        x, y, z = tree.points.T
        top = 0.2 + 0.18 * x
        inside = (z > 0) & (z < top) & (x > 2) & (x < 8) & (y > 1) & (y < 5)
        to_bisector = np.abs((z - np.tan(0.5 * slope) * (x + 0.2 / 0.18)) * np.cos(0.5 * slope))
        to_top = (top - z) * np.cos(slope)
        exact = (np.minimum(z, to_top) + to_bisector)[inside]
        print(
            f"round {rounds}: {tree.n_points} nodes, {inside.sum()} of them inside, finest "
            f"{tree.leaf_sizes.min():.3f}: lfs {ratios(lfs[inside], exact)}, "
            f"half the width by rays {ratios(rays[inside], exact)}"
        )
        tree = refined(tree, wedge, 1)


def bracket():
    """Print half the width of the rib of the bracket, 1.8 thick, and times."""
    part = ads.read(ROOT / "data" / "bracket.stl")
    tree = tree_at(part, 4.0)
    for rounds in range(2):
        medial, t_axis = seconds(ads.medial_axis, tree, part)
        lfs, t_size = seconds(ads.feature_size, tree, part, medial)
        rays, t_rays = seconds(ads.size_from_feature, tree, part)
        phi = ads.signed_distance(tree, part)
        known = np.isfinite(lfs) & (phi <= 0.0)
        share = np.quantile(lfs[known] / (2.0 * rays[known]), [0.01, 0.1, 0.5, 0.9, 0.99])
        print(
            f"round {rounds}: {tree.n_points} nodes, {known.sum()} inside, finest "
            f"{tree.leaf_sizes.min():.3f}; {len(medial.points)} points; least "
            f"{lfs[known].min():.3f}, at {100 * (lfs[known] < 0.95).mean():.1f} % below .95; over "
            f"half the width {share.round(2)}; {t_axis:.2f} + {t_size:.2f} s, rays {t_rays:.2f} s"
        )
        tree = refined(tree, part, 1, across=2.0, least=0.8)


def disturbed():
    """Print the least feature size on boundaries that are not smooth."""
    wavy = planar.wavy_disc(0.9, 0.005, 24)
    angle = np.linspace(0.0, 2.0 * np.pi, 721)[:-1]
    radius = 0.9 + 0.005 * np.cos(24 * angle)
    line = solids.outline(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    for step in (1 / 15, 1 / 30, 1 / 60, 1 / 120):
        tree = tree_at(line, step)
        found = ads.medial_axis(tree, line)
        print(
            f"wavy disc, spacing {step:.4f}: {len(found.points)} points, closest to the boundary "
            f"{found.radii.min():.3f} {-wavy(found.points).max():.3f}"
        )
    torus, _ = irregular_torus(24, 825)
    edge = float(np.median(torus.edge_lengths))
    for share in (0.0, 0.01, 0.02, 0.05, 0.1, 0.2):
        noise = np.random.default_rng(20061121).normal(size=torus.points.shape)
        noise *= share * edge / np.linalg.norm(noise, axis=1)[:, None]
        rough = ads.SimplexMesh(torus.points + noise, torus.cells)
        tree = tree_at(rough, 0.1)
        texts = []
        for separation in (20.0, 40.0, 60.0):
            medial = ads.medial_axis(tree, rough, separation_angle=separation)
            lfs = ads.feature_size(tree, rough, medial)
            phi = ads.signed_distance(tree, rough)
            part = np.quantile(lfs[phi <= 0.0] / 0.4, [0.0, 0.01, 0.1, 0.5])
            texts.append(f"{separation:.0f}: {len(medial.points)} points {part.round(2)}")
        rays = 2.0 * ads.size_from_feature(tree, rough)[phi <= 0.0] / 0.4
        part = np.quantile(rays, [0.0, 0.01, 0.1, 0.5])
        print(f"torus, nodes moved by {share:g} edges:", "; ".join(texts), "; rays", part.round(2))


if __name__ == "__main__":
    every = (in_the_plane, in_space, leaves_across, gap_that_varies, bracket, disturbed)
    for measure in every:
        if len(sys.argv) == 1 or measure.__name__ in sys.argv[1:]:
            print(f"\n{measure.__name__.replace('_', ' ').upper()}\n", flush=True)
            measure()
