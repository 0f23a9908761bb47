"""Time the warm start: limiting again after the bounds of few nodes have changed.

    python benchmarks/warm_start.py [--quick] [--output benchmarks/results]

Sixty balls of small sizes in a domain that asks for 6, so that a full solution has work
everywhere.  Then the bounds of 0.1, 1 and 10 % of the nodes change: in a ball (a spot, 20 % finer
than what was asked for), scattered (by up to 20 %), and back; and a spot moves away, so that
half of the changed bounds fall and half rise.  Every call begins from what the one before
returned, and has ``full_output=True``; the full solution is timed on the same mesh without it.
Seconds are processor time on one thread; kernels are compiled beforehand.  Writes
`warm_start.md` and `warm_start.json`.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from _timing import machine, write

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient

G = 0.25
SHARES = (0.001, 0.01, 0.1)
METHODS = ("source-tracking", "fast-marching")
FREE = 6.0
SAME = 1e-12


def triangles(n_side):
    """Return triangles of a grid on (-50, 50)^2 whose inner nodes are moved."""
    axis = np.linspace(-50.0, 50.0, n_side)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    corner = np.arange(n_side**2).reshape(n_side, n_side)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    cells = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    inner = (np.abs(points) < 49.99).all(axis=1)
    move = np.random.default_rng(20281).uniform(-0.3, 0.3, points.shape) * (axis[1] - axis[0])
    return SimplexMesh(points + inner[:, None] * move, cells)


def tetrahedra(n_side):
    """Return the Delaunay tetrahedra of a jittered grid on (-50, 50)^3."""
    from _problems import jittered_tetrahedra

    return jittered_tetrahedra(n_side**3)


def grid(n_side):
    """Return a grid on (-50, 50)^2."""
    return CartesianGrid([-50.0, -50.0], 100.0 / (n_side - 1), (n_side, n_side))


BACKGROUNDS = {
    "triangles": (triangles, 801, 101),
    "tetrahedra": (tetrahedra, 59, 15),
    "grid": (grid, 801, 101),
}


def base_bounds(points):
    """Return the sixty balls."""
    rng = np.random.default_rng(20282)
    dim = points.shape[1]
    h0 = np.full(len(points), FREE)
    radius = 1.0 if dim == 2 else 4.0
    for centre, size in zip(rng.uniform(-48, 48, (60, dim)), rng.uniform(0.3, 1, 60), strict=True):
        h0[np.linalg.norm(points - centre, axis=1) < radius] = size
    return h0


def ball(points, share, centre):
    """Return the nodes nearest to a centre, a share of all."""
    away = ((points - centre) ** 2).sum(axis=1)
    return np.argpartition(away, int(share * len(points)))[: int(share * len(points))]


def changes(points, base, share):
    """Yield the name of a change and the new bounds; each is made to the ones before."""
    rng = np.random.default_rng(20283)
    dim = points.shape[1]
    here, there = np.full(dim, 14.0), np.full(dim, -17.0)
    spot = base.copy()
    spot[ball(points, share, here)] *= 0.8
    yield "spot, lowered", spot
    yield "spot, raised", base
    first, second = base.copy(), base.copy()
    first[ball(points, 0.5 * share, here)] *= 0.8
    second[ball(points, 0.5 * share, there)] *= 0.8
    yield None, first
    yield "spot, moved", second
    yield None, base
    nodes = rng.choice(len(points), int(share * len(points)), replace=False)
    scattered = base.copy()
    scattered[nodes] *= rng.uniform(0.8, 1.0, len(nodes))
    yield "scattered, lowered", scattered
    yield "scattered, raised", base


def timed(*arguments, **options):
    """Return what limiting returns, and seconds."""
    start = time.process_time()
    result = limit_gradient(*arguments, **options)
    return result, time.process_time() - start


def measure(name, quick):
    """Return one row per method, share and change."""
    make, n_side, n_quick = BACKGROUNDS[name]
    warm_up(make(n_quick))
    background = make(n_quick if quick else n_side)
    points, shape = background.points, background.nodal_shape
    base = base_bounds(points)
    rows = []
    for method in METHODS:
        info = None
        for share in SHARES:
            known = {}
            for change, bounds in [(None, base), *changes(points, base, share)]:
                before = info and info.record.bound.ravel()
                given = bounds.reshape(shape), G
                if bounds is not base or "base" not in known:
                    full, seconds = timed(background, *given, method=method)
                    known["base" if bounds is base else "now"] = full, seconds
                full, seconds = known["base" if bounds is base else "now"]
                options = {"method": method, "full_output": True}
                (h, after), warm = timed(background, *given, initial=info, **options)
                if change:
                    difference = h / full - 1.0
                    rows.append(
                        {
                            "background": name,
                            "n_points": background.n_points,
                            "method": method,
                            "share": share,
                            "change": change,
                            "bounds_changed": float(np.mean(bounds != before)),
                            "sizes_changed": float(
                                np.mean(np.abs(full / info.record.h.reshape(shape) - 1) > SAME)
                            ),
                            "full_seconds": seconds,
                            "warm_seconds": warm,
                            "differing": float(np.mean(np.abs(difference) > SAME)),
                            "most_above": float(difference.max()),
                            "most_below": float(-difference.min()),
                        }
                    )
                info = after
            print(f"{time.strftime('%X')} {name}, {method}, {share:.1%}", file=sys.stderr)
    return rows


def warm_up(background):
    """Have all kernels compiled."""
    base = base_bounds(background.points)
    lower = base.copy()
    lower[::50] *= 0.9
    shape = background.nodal_shape
    for method in METHODS:
        info = None
        for bounds in (base, lower, base):
            _, info = limit_gradient(
                background, bounds.reshape(shape), G, method=method, initial=info, full_output=True
            )


def table(rows):
    """Return the rows as a markdown table."""
    lines = [
        "| background | nodes | method | change | bounds changed | sizes changed | full, s "
        "| warm, s | share | nodes that differ | by at most |",
        "|---|" + "---|" * 10,
    ]
    for row in rows:
        most = max(row["most_above"], row["most_below"])
        lines.append(
            f"| {row['background']} | {row['n_points']} | {row['method']} | {row['change']} "
            f"| {row['bounds_changed']:.2%} | {row['sizes_changed']:.1%} "
            f"| {row['full_seconds']:.3f} | {row['warm_seconds']:.3f} "
            f"| {row['warm_seconds'] / row['full_seconds']:.1%} "
            f"| {row['differing']:.1e} | {most:.1e} |"
        )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small backgrounds only")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    arguments = parser.parse_args()
    rows = [row for name in BACKGROUNDS for row in measure(name, arguments.quick)]
    text = (
        f"# Warm start\n\n{machine()}; one thread; processor time; g = {G}.  "
        "Full: without `initial`; warm: from the call before, with `full_output`.  "
        f"Nodes differ by more than {SAME:g} relative.\n\n{table(rows)}\n"
    )
    write(arguments.output, "warm_start", text, json.loads(json.dumps({"rows": rows})))


if __name__ == "__main__":
    main()
