"""Make deer.ply, what a scan of a figurine looks like: triangles of all sorts, some noise.

Needs ``pip install adaptsize[mmg]``.

    python data/make_deer.py               # beside this script
    python data/make_deer.py --into /tmp
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyvista
import trimesh

import adaptsize as ads

FloatArray = npt.NDArray[np.float64]

#: Round cones, in millimetres: both ends, and the radius at each.
BODY = (
    (((0, 0, 52), (38, 0, 54)), (13, 11)),  # trunk
    (((-2, 0, 56), (-16, 0, 84)), (8, 4.5)),  # neck
    (((-16, 0, 85), (-31, 0, 79)), (5.2, 2.6)),  # head
    (((48, 0, 60), (55, 0, 55)), (2.2, 1.2)),  # tail
)
#: The same on its right-hand side, to be mirrored.
SIDE = (
    (((-1, 7, 46), (-5, 7.5, 27)), (4.6, 2.6)),  # foreleg
    (((-5, 7.5, 27), (-2, 7.5, 4)), (2.4, 1.7)),
    (((-2, 7.5, 3), (-5.5, 7.5, 1.5)), (2.2, 1.5)),
    (((38, 6.5, 48), (33, 7.5, 31)), (6.5, 3.6)),  # hind leg
    (((33, 7.5, 31), (42, 7.5, 22)), (3.2, 2.2)),
    (((42, 7.5, 22), (39, 7.5, 4)), (2.2, 1.7)),
    (((39, 7.5, 3), (35.5, 7.5, 1.5)), (2.2, 1.5)),
    (((-13, 3.5, 88), (-9, 11, 92)), (1.9, 0.7)),  # ear
    (((-17, 2.5, 89), (-11, 9, 103)), (1.5, 1.1)),  # antler
    (((-11, 9, 103), (-15, 17, 117)), (1.1, 0.6)),
    (((-14, 6, 97), (-23, 9, 107)), (1.1, 0.55)),
    (((-11, 9, 103), (-2, 12, 113)), (1.0, 0.55)),
)
BLEND = 1.2
SPACING = 0.7
NOISE = 0.04
#: Edges of the scan, from the antlers to the trunk.
FINEST, COARSEST = 0.8, 2.2
SEED = 20060120


def cones() -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return all cones: first end, last end, radii."""
    found = []
    for part, signs in ((BODY, (1.0,)), (SIDE, (1.0, -1.0))):
        for ends, radii in part:
            for sign in signs:
                a, b = np.array(ends, np.float64) * (1.0, sign, 1.0)
                found.append((a, b, np.array(radii, np.float64)))
    return found


def implicit(x: FloatArray) -> FloatArray:
    """Return a function that is negative inside, (n,), of points (n, 3): cones that blend."""
    distances = []
    for a, b, radii in cones():
        along = b - a
        t = np.clip((x - a) @ along / (along @ along), 0.0, 1.0)
        apart = np.linalg.norm(x - a - t[:, None] * along, axis=1)
        distances.append(apart - (radii[0] + t * (radii[1] - radii[0])))
    every = np.array(distances)
    least = every.min(axis=0)
    return np.asarray(least - BLEND * np.log(np.exp((least - every) / BLEND).sum(axis=0)))


def make_deer(path: Path) -> None:
    """Write the figurine, 117 mm tall, antlers 1.5 to 3 thick."""
    ends = np.array([end for a, b, _ in cones() for end in (a, b)])
    reach = max(radii.max() for _, _, radii in cones()) + 2.0
    lower, upper = ends.min(axis=0) - reach, ends.max(axis=0) + reach
    shape = np.ceil((upper - lower) / SPACING).astype(int) + 1
    axes = [lower[d] + SPACING * np.arange(shape[d]) for d in range(3)]
    x, y, z = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    grid = pyvista.ImageData(dimensions=shape, spacing=(SPACING,) * 3, origin=lower)
    grid["f"] = implicit(np.column_stack([x, y, z])).reshape(shape).ravel(order="F")
    contour = grid.contour([0.0], "f").triangulate().clean()
    raw = ads.SimplexMesh(contour.points, contour.faces.reshape(-1, 4)[:, 1:])
    width = ads.size_from_feature(raw, elements_across=3.0)
    h0 = width.clip(FINEST, COARSEST)
    size = ads.SizeFunction(raw, ads.limit_gradient(raw, h0, 0.3))
    scan = ads.remesh(raw, size, target="triangles")
    surface = trimesh.Trimesh(scan.points, scan.cells, process=False)
    noise = np.random.default_rng(SEED).normal(0.0, NOISE, (scan.n_points, 1))
    noisy = trimesh.Trimesh(scan.points + noise * surface.vertex_normals, scan.cells, process=False)
    noisy.export(path, vertex_normal=False)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--into", type=Path, default=Path(__file__).parent, help="folder")
    path = parser.parse_args().into / "deer.ply"
    make_deer(path)
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
