"""Measure by how much tracking from earlier solutions differs from tracking from nothing.

    python docs/measurements/warm_start.py

Twenty changes in a row on each mesh, each call from what the one before returned: a tenth of
point sources moved, 3 % of bounds at all nodes drawn anew, and a spot with waves that moves.
Prints a line per mesh and kind for docs/limiting.md; takes some minutes.
"""

import sys
from pathlib import Path

import numpy as np

import adaptsize as ads

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
import domains
from meshes import jittered_cube, jittered_square, random_square

G = 0.3
SEED = 7
STEPS = 20
SAME = 1e-10
MESHES = {
    "random triangles": lambda: random_square(3000, 17, half_width=50.0),
    "jittered triangles": lambda: jittered_square(60, 18),
    "jittered tetrahedra": lambda: jittered_cube(12, 19),
    "slit": lambda: domains.slit_square(3000)[0],
    "star holes": lambda: domains.star_holes(3000)[0],
    "maze": lambda: domains.maze(3000)[0],
    "round holes": lambda: domains.round_holes(3000)[0],
}


def bounds(mesh, kind, rng):
    """Yield bounds, each a little different from those before."""
    x, n = mesh.points, mesh.n_points
    length = np.ptp(x[:, 0])
    centre = x[rng.integers(n)]
    h0 = rng.uniform(0.01, 0.1, n) * length
    if kind == "points":
        h0 = np.where(rng.random(n) < 0.01, rng.uniform(0.01, 0.3, n) * length * G, np.inf)
    for _ in range(STEPS + 1):
        if kind == "smooth":
            away = np.maximum(np.linalg.norm(x - centre, axis=1) - 0.1 * length, 0.0)
            waves = np.sin(40.0 * x[:, 0] / length) * np.cos(37.0 * x[:, 1] / length)
            steep = 0.8 * (1.0 + 0.3 * np.sin(30.0 * x[:, 1] / length))
            h0 = (0.02 + 0.01 * waves) * length + steep * away
            centre = centre + rng.normal(size=mesh.dim) * 0.01 * length
        h0[0] = min(h0[0], 0.2 * length)
        yield h0.copy()
        if kind == "points":
            bounded = np.flatnonzero(np.isfinite(h0))
            gone = rng.choice(bounded, max(1, len(bounded) // 10), replace=False)
            h0[gone] = np.inf
            h0[rng.choice(n, len(gone))] = rng.uniform(0.01, 0.3, len(gone)) * length * G
        elif kind == "rough":
            nodes = rng.choice(n, max(1, int(0.03 * n)), replace=False)
            h0[nodes] = rng.uniform(0.01, 0.1, len(nodes)) * length


def main():
    """Print the table."""
    print("| mesh | nodes | kind | nodes that differ | from | to |\n|---|---|---|---|---|---|")
    for name, make in MESHES.items():
        mesh = make()
        for kind in ("points", "rough", "smooth"):
            info, share, lowest, highest = None, 0.0, 0.0, 0.0
            for h0 in bounds(mesh, kind, np.random.default_rng(SEED)):
                h, info = ads.limit_gradient(mesh, h0, G, initial=info, full_output=True)
                full = ads.limit_gradient(mesh, h0, G)
                difference = h / full - 1.0
                share += np.mean(np.abs(difference) > SAME) / STEPS
                lowest = min(lowest, float(difference.min()))
                highest = max(highest, float(difference.max()))
            print(
                f"| {name} | {mesh.n_points} | {kind} | {share:.1e} "
                f"| {lowest:.1e} | {highest:.1e} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
