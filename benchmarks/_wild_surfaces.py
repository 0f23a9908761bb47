"""Parts with two to four details or defects each, fixed by a seed and a number.

A part is a solid (a block with bores, a flange, a ring, a gear, a bent sheet or a smooth body) with
*details* that are hard to mesh, as CAD programs make them, and *defects* that files have.  Details,
bodies that cross or nearly touch, and holes change the reference; the other defects change the
triangles only.  The part is stored as OFF or STL, and the reference beside it as
``NAME.reference.npz``: consistently oriented, its solid is where its winding number is above 1/2.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from _shapes import Surface, off, stl, together, used, with_doubled, with_flipped, with_slivers
from manifold3d import CrossSection, Manifold

REFERENCE = ".reference.npz"

Solid = Manifold
Random = np.random.Generator


def write_parts(folder: Path, count: int, seed: int) -> list[Path]:
    """Write the parts of a seed, ``NNN-defect-defect.off`` or ``.stl``, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    present = {path.name[:3]: path for path in folder.glob("[0-9]*") if path.suffix != ".npz"}
    files = []
    for number in range(count):
        if f"{number:03d}" in present:
            files.append(present[f"{number:03d}"])
            continue
        names, part, reference, as_stl = part_of(number, seed)
        path = folder / f"{number:03d}-{'-'.join(names)}{'.stl' if as_stl else '.off'}"
        if as_stl:
            path.write_bytes(stl(part))
        else:
            path.write_text(off(part), encoding="utf-8")
        arrays = {"points": reference.points, "triangles": reference.cells}
        np.savez_compressed(path.with_suffix(REFERENCE), **arrays)
        files.append(path)
    return files


def part_of(number: int, seed: int) -> tuple[list[str], Surface, Surface, bool]:
    """Return the names of the defects, the part, the reference, and whether it is stored as STL."""
    rng = np.random.default_rng([20261126, seed, number])
    kinds = [*_DETAILS, *_BODIES, *_DEFECTS]
    chosen = rng.choice(len(kinds), int(rng.integers(2, 5)), replace=False)
    names = [kinds[i] for i in sorted(chosen)]
    solid = list(_SOLIDS.values())[number % len(_SOLIDS)](rng)
    for name in names:
        if name in _DETAILS:
            solid = _DETAILS[name](solid, rng)
    reference = _surface(solid)
    for name in names:
        if name in _BODIES:
            reference = _BODIES[name](reference, rng)
    reference = _placed(reference, rng)
    as_stl = bool(rng.random() < 0.5)
    if as_stl:
        reference = Surface(reference.points.astype(np.float32).astype(float), reference.cells)
    part = reference
    for name in names:
        if name in _DEFECTS:
            part = _DEFECTS[name](part, rng)
    return names, part, reference, as_stl


def _placed(surface: Surface, rng: Random) -> Surface:
    """Return the surface turned, in other units, and sometimes off the origin."""
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation[:, 0] *= np.sign(np.linalg.det(rotation))
    points = surface.points @ rotation if rng.random() < 0.5 else surface.points
    offset = rng.choice([0.0, 0.0, 5.0]) * rng.normal(size=3)
    return Surface(
        10.0 ** rng.choice([-3.0, 0.0, 0.0, 1.0, 3.0]) * (points + offset), surface.cells
    )


def _surface(solid: Solid) -> Surface:
    mesh = solid.to_mesh64()
    points, cells = np.array(mesh.vert_properties, float)[:, :3], np.array(mesh.tri_verts, int)
    merged = np.arange(len(points))
    merged[np.array(mesh.merge_from_vert, int)] = np.array(mesh.merge_to_vert, int)
    return used(Surface(points, merged[cells]))


def _box(x: float, y: float, z: float) -> Solid:
    return Manifold.cube((x, y, z), True)


def _polygon(corners: object) -> CrossSection:
    return CrossSection([np.asarray(corners, float)])


# --- solids, about as large as 1 ------------------------------------------------------------------


def _block(rng: Random) -> Solid:
    solid = _box(1.0, rng.uniform(0.4, 0.9), rng.uniform(0.2, 0.5))
    for _ in range(int(rng.integers(1, 4))):
        segments = int(rng.integers(16, 64))
        bore = Manifold.cylinder(2.0, rng.uniform(0.03, 0.12), -1.0, segments, True)
        solid -= bore.translate((*rng.uniform(-0.35, 0.35, 2), 0.0))
    return solid


def _flange(rng: Random) -> Solid:
    segments = int(rng.integers(32, 96))
    solid = Manifold.cylinder(0.12, 0.5, 0.5, segments)
    solid += Manifold.cylinder(rng.uniform(0.3, 0.8), 0.25, 0.25, segments)
    solid -= Manifold.cylinder(3.0, 0.18, 0.18, segments, True)
    for turn in np.arange(6) * np.pi / 3.0:
        bolt = Manifold.cylinder(1.0, 0.04, 0.04, 16, True)
        solid -= bolt.translate((0.38 * np.cos(turn), 0.38 * np.sin(turn), 0.0))
    return solid


def _ring(rng: Random) -> Solid:
    circle = CrossSection.circle(rng.uniform(0.06, 0.16), int(rng.integers(12, 32)))
    return circle.translate((0.4, 0.0)).revolve(int(rng.integers(32, 80)))


def _gear(rng: Random) -> Solid:
    teeth = int(rng.integers(10, 24))
    turn = 2.0 * np.pi * np.arange(4 * teeth) / (4 * teeth)
    far = np.where(np.arange(4 * teeth) % 4 < 2, 0.5, 0.5 - rng.uniform(0.04, 0.1))
    outline = _polygon(np.column_stack([far * np.cos(turn), far * np.sin(turn)]))
    hole = CrossSection.circle(0.12, 40)
    return (outline - hole).extrude(0.2, int(rng.integers(0, 8)), float(rng.choice([0.0, 20.0])))


def _bent_sheet(rng: Random) -> Solid:
    t = rng.uniform(0.01, 0.03)
    corners = [(0, 0), (0.9, 0), (0.9, t), (t, t), (t, 0.5), (0, 0.5)]
    solid = _polygon(corners).extrude(0.6).translate((-0.45, -0.25, -0.3))
    return solid - _box(0.3, 0.5, 0.2).translate((0.1, -0.25, 0.0))


def _body(rng: Random) -> Solid:
    """Return a smooth body."""
    waves, phases = rng.normal(size=(4, 3)) * 4.0, rng.uniform(0.0, 2.0 * np.pi, 4)

    def deform(points: np.ndarray) -> np.ndarray:
        points = np.asarray(points, float)
        wave = np.sin(points @ waves.T + phases).sum(axis=1)
        return points * (1.0 + 0.08 * wave)[:, None]

    return Manifold.sphere(0.5, int(rng.integers(40, 80))).warp_batch(deform)


_SOLIDS: dict[str, Callable[[Random], Solid]] = {
    "block": _block,
    "flange": _flange,
    "ring": _ring,
    "gear": _gear,
    "bent-sheet": _bent_sheet,
    "body": _body,
}

# --- details of the solid -------------------------------------------------------------------------

#: Strokes of letters on a grid of 3 x 5 points.
_LETTERS = {
    "A": "0014 1444 4440 0242",
    "E": "0004 0444 0242 0040",
    "H": "0004 4044 0242",
    "K": "0004 0244 0240",
    "N": "0004 0440 4044",
    "T": "0444 2420",
    "X": "0044 0440",
    "Z": "0444 4400 0040",
}


def _text(solid: Solid, rng: Random) -> Solid:
    """Engrave letters into the top, or raise them on it."""
    height = rng.uniform(0.05, 0.12)
    width, depth = rng.uniform(0.08, 0.2) * height, rng.uniform(0.003, 0.03)
    strokes = CrossSection()
    for place, letter in enumerate(rng.choice(list(_LETTERS), int(rng.integers(2, 6)))):
        for stroke in _LETTERS[letter].split():
            a, b = np.array([*map(float, stroke)]).reshape(2, 2) * height / 4.0
            along = width * (b - a) / np.linalg.norm(b - a)
            across = np.array([-along[1], along[0]])
            sides = [a - along - across, b + along - across, b + along + across, a - along + across]
            strokes += _polygon(sides).translate((1.4 * height * place, 0.0))
    x, y, z = _on_top(solid, rng)
    raised = rng.random() < 0.5
    letters = strokes.extrude(2.0 * depth).translate((x - height, y, z - depth))
    return solid + letters if raised else solid - letters


def _on_top(solid: Solid, rng: Random) -> np.ndarray:
    """Return a highest point."""
    points = _surface(solid).points
    top = points[points[:, 2] > points[:, 2].max() - 1e-6]
    return top[int(rng.integers(0, len(top)))]


def _lattice(solid: Solid, rng: Random) -> Solid:
    """Put struts on the top."""
    n, cell, radius = int(rng.integers(2, 4)), rng.uniform(0.08, 0.14), rng.uniform(0.008, 0.02)
    ends = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    struts = []
    for axis in range(3):
        strut = Manifold.cylinder(cell, radius, radius, 6)
        if axis < 2:
            strut = strut.rotate((-90.0, 0.0, 0.0) if axis == 1 else (0.0, 90.0, 0.0))
        starts = ends[ends[:, axis] < n]
        struts += [strut.translate(tuple(cell * start)) for start in starts]
    balls = [Manifold.sphere(1.3 * radius, 8).translate(tuple(cell * end)) for end in ends]
    lattice = sum([*struts, *balls], Manifold())
    return solid + lattice.translate(tuple(_on_top(solid, rng) - [0.0, 0.0, radius]))


def _thread(solid: Solid, rng: Random) -> Solid:
    """Put a screw on the top."""
    radius, turns = rng.uniform(0.05, 0.12), int(rng.integers(3, 8))
    profile = CrossSection.circle(radius, 32).translate((rng.uniform(0.1, 0.2) * radius, 0.0))
    screw = profile.extrude(0.5 * radius * turns, 16 * turns, 360.0 * turns)
    return solid + screw.translate(tuple(_on_top(solid, rng) - [0.0, 0.0, 0.02]))


def _sheet_metal(solid: Solid, rng: Random) -> Solid:
    """Put a thin plate with slots through the middle."""
    low, high = np.reshape(solid.bounding_box(), (2, 3))
    t = float(rng.choice([0.003, 0.008, 0.02]))
    plate = _box(*(high - low)[:2] * 1.3, t)
    for x in np.linspace(-0.4, 0.4, int(rng.integers(2, 6))):
        plate -= _box(0.03, 0.3, 1.0).translate((x * (high - low)[0], 0.0, 0.0))
    return solid + plate.translate(tuple(0.5 * (low + high)))


def _thin_tip(solid: Solid, rng: Random) -> Solid:
    """Put a needle or a blade on the top."""
    radius, height = rng.uniform(0.02, 0.08), rng.uniform(0.2, 0.6)
    tip = Manifold.cylinder(height, radius, 0.0, int(rng.integers(6, 32)))
    if rng.random() < 0.5:
        wedge = _polygon([(-radius, 0.0), (radius, 0.0), (0.0, height)])
        tip = wedge.extrude(0.3).rotate((90.0, 0.0, 0.0))
    return solid + tip.translate(tuple(_on_top(solid, rng) - [0.0, 0.0, 0.01]))


def _rims(solid: Solid, rng: Random) -> Solid:
    """Put a bush with a thin wall, a narrow rim and small chamfers on the top."""
    r, wall, n = rng.uniform(0.1, 0.2), rng.uniform(0.006, 0.03), int(rng.integers(24, 64))
    c = rng.uniform(0.1, 0.5) * wall
    profile = [
        *[(r, -0.05), (r + wall - c, -0.05), (r + wall, -0.05 + c), (r + wall, 0.2)],
        *[(r + 2 * wall, 0.2 + c), (r + 2 * wall, 0.2 + 2 * c), (r + wall, 0.2 + 3 * c)],
        *[(r + wall - c, 0.25), (r, 0.25)],
    ]
    bush = _polygon(profile).revolve(n)
    return solid + bush.translate(tuple(_on_top(solid, rng)))


_DETAILS: dict[str, Callable[[Solid, Random], Solid]] = {
    "text": _text,
    "lattice": _lattice,
    "thread": _thread,
    "sheet": _sheet_metal,
    "tip": _thin_tip,
    "rims": _rims,
}

# --- bodies that are not united, and holes --------------------------------------------------------


def _other(rng: Random) -> Surface:
    segments = int(rng.integers(16, 40))
    size = rng.uniform(0.15, 0.4)
    solids = [
        _box(size, 1.3 * size, 0.8 * size),
        Manifold.sphere(0.5 * size, segments),
        Manifold.cylinder(size, 0.4 * size, -1.0, segments, True),
    ]
    return _surface(solids[int(rng.integers(0, 3))])


def _beside(surface: Surface, other: Surface, gap: float) -> Surface:
    """Return both, the other one so far from the point of the first with the largest x."""
    most = surface.points[surface.points[:, 0].argmax()]
    least = other.points[other.points[:, 0].argmin()]
    return together(surface, Surface(other.points + most - least + [gap, 0.0, 0.0], other.cells))


def _crossing(surface: Surface, rng: Random) -> Surface:
    """Add bodies that go through others, some of them hardly."""
    for _ in range(int(rng.integers(1, 4))):
        depth = float(rng.choice([3e-5, 1e-3, 0.03, 0.1]))
        surface = _beside(surface, _other(rng), -depth)
    return surface


def _near_contact(surface: Surface, rng: Random) -> Surface:
    """Add a body that nearly touches."""
    return _beside(surface, _other(rng), float(rng.choice([1e-5, 1e-4, 1e-3, 5e-3])))


def _several_bodies(surface: Surface, rng: Random) -> Surface:
    """Add bodies at some distance."""
    for _ in range(int(rng.integers(1, 5))):
        surface = _beside(surface, _other(rng), rng.uniform(0.02, 0.2))
    return surface


def _holes(surface: Surface, rng: Random) -> Surface:
    """Leave out a few facets."""
    gone = rng.choice(len(surface.cells), int(rng.integers(1, 5)), replace=False)
    return used(Surface(surface.points, np.delete(surface.cells, gone, axis=0)))


_BODIES: dict[str, Callable[[Surface, Random], Surface]] = {
    "crossing": _crossing,
    "near": _near_contact,
    "bodies": _several_bodies,
    "holes": _holes,
}

# --- defects of the triangles ---------------------------------------------------------------------


def _slivers(surface: Surface, rng: Random) -> Surface:
    """Divide edges very close to an end."""
    return with_slivers(surface, 40, rng)


def _split_on_one_side(surface: Surface, rng: Random, filled: bool) -> Surface:
    """Divide edges in one of their facets; a triangle of no area may fill what is between."""
    points, cells = list(surface.points), surface.cells.tolist()
    for number in rng.choice(len(cells), min(30, len(cells)), replace=False).tolist():
        a, b, c = np.roll(cells[number], int(rng.integers(0, 3))).tolist()
        share = rng.uniform(0.05, 0.95)
        points.append((1.0 - share) * points[a] + share * points[b])
        new = len(points) - 1
        cells[number] = [a, new, c]
        cells.append([new, b, c])
        if filled:
            cells.append([a, b, new])
    return Surface(np.array(points), np.array(cells))


def _zero_areas(surface: Surface, rng: Random) -> Surface:
    return _split_on_one_side(surface, rng, filled=True)


def _t_joints(surface: Surface, rng: Random) -> Surface:
    return _split_on_one_side(surface, rng, filled=False)


def _doubled_points(surface: Surface, rng: Random) -> Surface:
    """Give nodes twice, perhaps a little apart, so that facets do not share them."""
    points, cells = surface.points, surface.cells.copy()
    chosen = rng.choice(len(points), max(1, len(points) // 10), replace=False)
    corner = np.isin(cells, chosen) & (rng.random(cells.shape) < 0.5)
    twin = np.full(len(points), -1)
    twin[chosen] = len(points) + np.arange(len(chosen))
    cells[corner] = twin[cells[corner]]
    apart = rng.choice([0.0, 1e-12, 1e-8]) * np.linalg.norm(np.ptp(points, axis=0))
    return Surface(
        np.concatenate([points, points[chosen] + apart * rng.normal(size=(len(chosen), 3))]), cells
    )


def _doubled(surface: Surface, rng: Random) -> Surface:
    share = float(rng.choice([0.01, 0.1]))
    return with_doubled(surface, rng.random(len(surface.cells)) < share, rng)


def _flipped(surface: Surface, rng: Random) -> Surface:
    share = float(rng.choice([0.005, 0.1, 0.3]))
    return with_flipped(surface, rng.random(len(surface.cells)) < share)


_DEFECTS: dict[str, Callable[[Surface, Random], Surface]] = {
    "slivers": _slivers,
    "zero": _zero_areas,
    "tjoints": _t_joints,
    "twins": _doubled_points,
    "doubled": _doubled,
    "flipped": _flipped,
}
