"""Speed of what is found out about the geometry, and other libraries on the same input.

    python benchmarks/geometry.py [--quick] [--only NAME ...] [--output benchmarks/results]

One core; kernels compiled beforehand; least process time of two.  Every entry of `CASES` is
a function that takes ``quick`` and gives one table: a title, its heads and its rows.

*Signed distance*: a bumpy ball of 100,000 triangles on a grid of 128^3 nodes.  Libraries
that give one distance per point (libigl: tree of boxes and fast winding number; trimesh:
R-tree and rays) are asked for a sample of the nodes, and the time is scaled up; where they
are not installed their rows are left out.  "Largest difference" is that of the sample, in
spacings: within the band, and beyond it.

*Medial axis*: Algorithm 1 and the marching from it on 256^3 nodes.

*Sizes inside*: those of a screw of 25 to 100 layers, whose steps hide most sources from each point.

*Complete size*: curvature, width and limiting (formulas (18)-(19) of the paper) for the sample
bracket, as a share of the time that the mesh generator then takes: wall time, as generators
are processes of their own.

Writes `geometry.md` and `geometry.json`.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from _timing import best_of, machine, table, three, write
from scipy.spatial import ConvexHull

import adaptsize as ads


def bumpy_ball(n_points):
    """Return a closed surface of nearly equal triangles, 2 ``n_points`` - 4 of them."""
    i = np.arange(n_points) + 0.5
    z, angle = 1.0 - 2.0 * i / n_points, np.pi * (3.0 - np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z * z)
    points = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    cells = ConvexHull(points).simplices
    corners = points[cells]
    inward = np.linalg.det(corners) < 0.0
    cells[inward] = cells[inward][:, [0, 2, 1]]
    bumps = np.sin(5.0 * points[:, 0]) * np.cos(4.0 * points[:, 1] + points[:, 2])
    return ads.SimplexMesh(points * (1.0 + 0.15 * bumps[:, None]), cells)


def signed_distance(quick):
    """Time the signed distance of a surface on a grid."""
    n_points, n_side, n_sample = (2_502, 48, 500) if quick else (50_002, 128, 20_000)
    surface = bumpy_ball(n_points)
    grid = ads.CartesianGrid([-1.3] * 3, 2.6 / (n_side - 1), (n_side,) * 3)
    small = ads.CartesianGrid([-1.3] * 3, 0.2, (14,) * 3)
    sample = np.random.default_rng(60119).choice(grid.n_points, n_sample, replace=False)
    points = grid.points[sample]
    for band in (3.0, np.inf):  # compiled by this
        ads.signed_distance(small, bumpy_ball(100), band=band)
    phi, _, own = best_of(2, lambda: ads.signed_distance(grid, surface))
    rows = [("adaptsize, band 3", grid.n_points, own, phi.ravel()[sample])]
    few = ads.SimplexMesh(
        points, np.arange(n_sample // 4 * 4).reshape(-1, 4)
    )  # nodes without a grid: every distance by the tree
    exact, _, own = best_of(1, lambda: ads.signed_distance(few, surface))
    rows.append(("adaptsize, band inf", n_sample, own, exact))
    for name, peer in (("libigl", _by_libigl), ("trimesh", _by_trimesh)):
        n = n_sample if name == "libigl" else min(n_sample, 300)
        asked = peer(surface)
        if asked is not None:
            asked(points[:10])
            found, _, own = best_of(1, partial(asked, points[:n]))
            rows.append((name, n, own, found))
    return _compared(grid, surface, rows, exact)


def _compared(grid, surface, rows, exact):
    h = grid.spacing[0]
    lines, base = [], rows[0][2]
    for name, n, seconds, found in rows:
        m = len(found)
        off = np.abs(np.asarray(found) - exact[:m]) / h
        near = np.abs(exact[:m]) <= 3.0 * h
        whole = seconds * grid.n_points / n
        lines.append(
            [name, n, three(whole), three(1e6 * seconds / n), three(whole / base),
             f"{off[near].max():.0e}", f"{off[~near].max():.0e}"]
        )  # fmt: skip
    title = f"Signed distance, {surface.n_cells} triangles on {grid.shape[0]}^3 nodes"
    heads = ["", "nodes timed", "s for all", "µs/node", "times as long",
             "largest difference in the band", "beyond"]  # fmt: skip
    return title, heads, lines


def _by_libigl(surface):
    try:
        import igl
    except ImportError:
        return None
    points, cells = np.array(surface.points), np.array(surface.cells, dtype=np.int64)
    kind = igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
    return lambda x: igl.signed_distance(x, points, cells, sign_type=kind)[0]


def _by_trimesh(surface):
    try:
        import rtree  # noqa: F401 - what trimesh finds closest points with
        import trimesh
    except ImportError:
        return None
    mesh = trimesh.Trimesh(surface.points, surface.cells, process=False)
    return lambda x: -trimesh.proximity.signed_distance(mesh, x)


def medial_axis(quick):
    """Time Algorithm 1 and the feature size from it on a grid in space."""
    n_side = 64 if quick else 256
    grid = ads.CartesianGrid([-0.95] * 3, 1.9 / (n_side - 1), (n_side,) * 3)
    lines = []
    for name, distance in (("plate and rib", _plate_and_rib), ("ball", _ball), ("torus", _torus)):
        small = ads.CartesianGrid([-1.0] * 3, 0.1, (21,) * 3)
        ads.feature_size(small, small.sample(distance))  # compiled by this
        phi = grid.sample(distance)
        medial, _, axis = best_of(2, partial(ads.medial_axis, grid, phi))
        _, _, size = best_of(2, partial(ads.feature_size, grid, phi, medial))
        lines.append(
            [name, f"{100.0 * (phi < 0.0).mean():.0f} %", len(medial.points), three(axis),
             three(size), three(1e6 * (axis + size) / grid.n_points)]
        )  # fmt: skip
    heads = ["", "nodes inside", "points", "s medial axis", "s feature size", "µs/node"]
    return f"Medial axis and local feature size on {n_side}^3 nodes", heads, lines


def width(quick):
    """Time the rays, the separation and the default size function of surfaces."""
    from adaptsize.geometry.faces import Faces
    from adaptsize.geometry.separation import Separation
    from adaptsize.geometry.walls import WallTree
    from adaptsize.geometry.width import Width

    lines = []
    for name in ("bracket.stl",) if quick else ("bracket.stl", "deer.ply"):
        part = ads.read(Path(__file__).parents[1] / "data" / name)
        ads.size_function(part)  # compiled by this
        faces, _, prepared = best_of(3, partial(Faces.of, part))
        walls, _, tree = best_of(3, partial(WallTree.of, faces))
        finder = Width(faces, 30.0)
        _, _, rays = best_of(3, partial(finder.at_centroids, lambda *_: None))
        separation = Separation(faces, 30.0, walls)
        n_features = len(separation.nodes.node)
        _, _, between = best_of(3, partial(separation.at, separation.nodes, lambda *_: None))
        _, _, size = best_of(3, partial(ads.size_function, part))
        lines.append(
            [name, part.n_cells, three(1e3 * (prepared + tree)), three(1e6 * rays / part.n_cells),
             n_features, three(1e6 * between / max(n_features, 1)), three(size)]
        )  # fmt: skip
    heads = [
        "",
        "facets",
        "ms preparation",
        "µs/ray",
        "feature nodes",
        "µs/node",
        "s size_function",
    ]
    return "Width, separation and the default size function", heads, lines


def screw(n_layers, n_around=64, turn=0.147, pitch=0.03):
    """Return the surface of a rod of layers that are turned against each other, with steps."""
    angle = 2.0 * np.pi * np.arange(n_around) / n_around + turn * np.arange(n_layers + 1)[:, None]
    heights = np.broadcast_to(pitch * np.arange(n_layers + 1)[:, None], angle.shape)
    sides = np.stack([np.cos(angle), np.sin(angle), heights], axis=-1).reshape(-1, 3)
    i, k = np.arange(n_around), n_around * np.arange(n_layers)[:, None]
    here, after, n = (k + i).ravel(), (k + (i + 1) % n_around).ravel(), len(sides)
    top, ends = n - n_around, [[0.0, 0.0, 0.0], [0.0, 0.0, pitch * n_layers]]
    cells = [
        np.column_stack([here, after, after + n_around]),
        np.column_stack([here, after + n_around, here + n_around]),
        np.column_stack([np.full(n_around, n), (i + 1) % n_around, i]),
        np.column_stack([np.full(n_around, n + 1), i + top, (i + 1) % n_around + top]),
    ]
    return ads.SimplexMesh(np.concatenate([sides, ends]), np.concatenate(cells))


def inside(quick):
    """Time the sizes of parts whose steps hide most of the sources from each point."""
    lines = []
    for n_layers in (10,) if quick else (25, 50, 100):
        part = screw(n_layers)
        sized = partial(ads.size_function, part, max_elements=40_000, tolerance=2e-3)
        sized()  # compiled by this
        size, _, own = best_of(2, sized)
        n = size.background.n_points
        lines.append([n_layers, part.n_cells, n, three(own), three(1e6 * own / n)])
    heads = ["layers", "facets", "nodes of the sizes", "s", "µs/node"]
    return "Sizes inside a screw of layers, whose steps hide most sources", heads, lines


def _ball(x):
    return np.linalg.norm(x, axis=1) - 0.9


def _torus(x):
    return np.hypot(np.hypot(x[:, 0], x[:, 1]) - 0.6, x[:, 2]) - 0.3


def _plate_and_rib(x):
    parts = []
    for centre, half in (([0.0, 0.0, -0.3], [0.8, 0.6, 0.1]), ([0.1, 0.0, 0.1], [0.05, 0.5, 0.5])):
        gaps = np.abs(x - centre) - half
        outside = np.linalg.norm(np.maximum(gaps, 0.0), axis=1)
        parts.append(outside + np.minimum(gaps.max(axis=1), 0.0))
    return np.min(parts, axis=0)


def complete_size(quick):
    """Time the size function of a part beside the meshing with it."""
    part = ads.read(Path(__file__).parents[1] / "data" / "bracket.stl")
    options = {"hmin": 2.0} if quick else {}
    spacing = np.ptp(part.points, axis=0).max() / (40 if quick else 120)
    grid = ads.CartesianGrid.around(part.points, spacing, 3.0 * spacing)
    routes = {
        "on the surface, as `adaptsize remesh` does": lambda: ads.size_function(part, **options),
        "by distance on a grid": lambda: ads.size_function(part, background=grid, **options),
    }
    lines = []
    for name, route in routes.items():
        route()  # compiled by this
        size, seconds, _ = best_of(2, route)
        mesh, meshing, _ = best_of(1, partial(ads.remesh, part, size))
        lines.append(
            [name, size.background.n_points, three(seconds), mesh.n_cells, three(meshing),
             f"{100.0 * seconds / meshing:.0f} %"]
        )  # fmt: skip
    heads = ["size", "nodes", "s size", "tetrahedra", "s meshing", "share"]
    return "Size function of data/bracket.stl and its meshing, wall time", heads, lines


CASES = {
    "distance": signed_distance,
    "width": width,
    "medial axis": medial_axis,
    "inside": inside,
    "complete size": complete_size,
}


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small problems")
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    arguments = parser.parse_args()
    tables = {name: CASES[name](arguments.quick) for name in arguments.only}
    parts = [f"## {title}\n\n{table(heads, rows)}\n" for title, heads, rows in tables.values()]
    report = {name: [dict(zip(heads, row, strict=True)) for row in rows]
              for name, (_, heads, rows) in tables.items()}  # fmt: skip
    text = (
        f"# Geometry\n\n{machine()}; one thread; process time. What is compared: "
        f"`benchmarks/geometry.py`.\n\n" + "\n".join(parts)
    )
    write(arguments.output, "geometry", text, {"machine": machine(), **report})


if __name__ == "__main__":
    main()
