"""Measure a mesh against the surface that it was made from, by nothing of adaptsize.

    python benchmarks/judge.py PART MESH [--tolerance 1e-3] [--python OTHER] [--reference SOLID.npz]

The *reference* is the boundary of the set {winding number > 1/2} of the part.  Its facets first get
consistent orientations: of each piece that is connected by edges of two facets, that of the larger
share of its area; a closed piece that stands inside out on its own is turned.  Facets given twice
count once, unless the part is less open with both.  A point of the part belongs to the reference if
the winding number crosses 1/2 there: the inside of a union does not, nor does a wall of no
thickness.

*Distance*, both ways, over the tolerance: from each sample of the part that belongs to the
reference to the boundary of the mesh, and from each sample of that boundary to those facets of the
part, or pieces of them, that belong to the reference.  In front of an opening, where the winding
number is no integer on either side, the boundary is free: samples there that are further than the
tolerance from the part count for the volume, but not for the distance.

The volume of the reference is exact where the part is closed and encloses each point once or never.
Elsewhere the difference is integrated by points, one at random in each cell of a grid.

A mesh is *met* if it misses none of: the distance (5 % more are allowed), the volume (.5 %, or what
the tolerance times the area explains), the boundary (each edge in two facets, unless the part has
such edges), the cells (none inverted, none over others), the angles (no dihedral angle below 5
degrees, unless facets of the part meet at such an angle), and the number (10 % above a cap).

libigl makes this quick; where it is absent, NumPy does it for small cases.  ``--python`` names the
Python of another environment that has it.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _measures import areas_and_normals, distances, enclosed_volume, fan, samples, winding_numbers
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

#: Where the winding number is compared: so far above and below a facet, over the diagonal.  The
#: quick version of libigl is of single precision.
_NEAR, _VERY_NEAR = 1e-6, 1e-9
#: A corner is looked at a little inside its triangle: so far over the diagonal.
_INSIDE = 5e-5
#: Pieces into which facets that belong to the reference in part are divided at once.
_PIECES = 10_000
#: A winding number that is further from an integer shows an opening.
_FRACTION = 0.05
#: Samples of each surface besides its corners; cells along a side of the grid for volumes.
_COUNT, _GRID = 60_000, 48
_DISTANCE, _VOLUME, _OVERLAP, _NUMBER = 1.05, 0.005, 1e-3, 1.1
#: Of dihedral angles, in degrees.
_LEAST_ANGLE = 5.0
#: An exit code 0 is true to here: *near* is within 10 % of the tolerance.
_NEAR_ENOUGH = 1.1


class Surface(NamedTuple):
    """Triangles."""

    points: np.ndarray
    triangles: np.ndarray


class Mesh(NamedTuple):
    """Tetrahedra, or a surface, and the requested sizes at the nodes if they are known."""

    points: np.ndarray
    cells: np.ndarray
    sizes: np.ndarray | None = None


# --- files ----------------------------------------------------------------------------------------


def read_surface(path):
    """Return the surface in a file of trimesh, PyVista or NumPy (``points``, ``triangles``)."""
    suffix = Path(path).suffix.lower()
    if suffix == ".npz":
        stored = np.load(path)
        return Surface(stored["points"], stored["triangles"])
    if suffix in {".vtp", ".vtk", ".vtu"}:
        import pyvista

        skin = pyvista.read(path).extract_surface(algorithm="dataset_surface").triangulate()
        return Surface(np.array(skin.points, float), skin.faces.reshape(-1, 4)[:, 1:])
    import trimesh

    read = trimesh.load(path, process=False, force="mesh")
    return Surface(np.array(read.vertices, float), np.array(read.faces, np.int64))


def read_mesh(path):
    """Return the tetrahedra in a file of meshio, or its triangles if it has none."""
    if Path(path).suffix == ".npz":
        stored = np.load(path)
        return Mesh(stored["points"], stored["cells"], stored.get("sizes"))
    import meshio

    read = meshio.read(path)
    kinds = read.cells_dict
    cells = kinds["tetra"] if "tetra" in kinds else kinds["triangle"]
    return Mesh(np.array(read.points, float), np.array(cells, np.int64), read.point_data.get("h"))


# --- the reference --------------------------------------------------------------------------------


def repaired(surface):
    """Return the surface with equal points merged, each facet once, consistently oriented."""
    points, number = np.unique(surface.points, axis=0, return_inverse=True)
    triangles = number.ravel()[surface.triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    # Bodies that share facets are closed as they are, facets given twice leave edges open.
    choices = [_oriented(some, points) for some in (triangles, _once(triangles))]
    return Surface(points, min(choices, key=open_edges))


def _once(triangles):
    """Return each facet once; nothing is left of two that face each other."""
    ordered = np.sort(triangles, axis=1)
    a, b, c = (triangles == ordered[:, i, None] for i in range(3))
    place = np.stack([one.argmax(axis=1) for one in (a, b, c)], axis=1)
    even = np.isin(place[:, 0] * 9 + place[:, 1] * 3 + place[:, 2], [5, 15, 19])
    unique, group = np.unique(ordered, axis=0, return_inverse=True)
    net = np.bincount(group.ravel(), np.where(even, 1, -1), len(unique))
    return np.where((net > 0)[:, None], unique, unique[:, ::-1])[net != 0]


def half_edges(triangles):
    """Return the sorted ends of all sides, whether they run upwards, and their triangles."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.sort(sides, axis=1), sides[:, 0] < sides[:, 1], np.tile(np.arange(len(triangles)), 3)


def _oriented(triangles, points):
    if len(triangles) == 0:
        return triangles
    ends, up, owner = half_edges(triangles)
    _, edge, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    pairs = order[(count[edge.ravel()] == 2)[order]].reshape(-1, 2)
    s, t = owner[pairs].T
    odd = up[pairs[:, 0]] == up[pairs[:, 1]]  # both run the same way: one is turned
    n = len(triangles)
    rows = np.concatenate([s, s + n])
    columns = np.concatenate([t + n * odd, t + n * ~odd])
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n))
    _, label = connected_components(graph, directed=False)
    turned = label[:n] > label[n:]
    piece = np.minimum(label[:n], label[n:])
    area, _ = areas_and_normals(points, triangles)
    share = np.bincount(piece, np.where(turned, area, -area), label.max() + 1)
    turned ^= share[piece] > 0.0
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    return _right_side_out(triangles, piece, points)


def _right_side_out(triangles, piece, points):
    """Turn closed pieces with a negative volume that no other piece encloses."""
    turned = np.zeros(len(triangles), bool)
    for one in np.unique(piece):
        own = piece == one
        if enclosed_volume(points, triangles[own]) < 0.0 and not open_edges(triangles[own]):
            place = points[triangles[own][0]].mean(axis=0, keepdims=True)
            rest = triangles[~own]
            if len(rest) == 0 or abs(winding_numbers(points, rest, place)[0]) < 0.5:
                turned |= own
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


def open_edges(triangles):
    """Return the number of edges that the facets do not run along as often in both directions."""
    ends, up, _ = half_edges(triangles)
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    return int(np.count_nonzero(np.bincount(edge.ravel(), np.where(up, 1, -1))))


def crosses_one_half(surface, places, owners, steps=((_NEAR, False), (_VERY_NEAR, True))):
    """Return where the winding number is above 1/2 on one side of the facet only.

    Each step is a distance, and whether the winding number is exact there.  The next step looks
    where the last one has found none.
    """
    points, triangles = surface
    _, normals = areas_and_normals(points, triangles)
    centre = points[triangles[owners]].mean(axis=1)
    away = np.linalg.norm(centre - places, axis=1)
    share = np.minimum(0.05, _INSIDE / np.maximum(away, 1e-300))
    places = places + share[:, None] * (centre - places)
    found = np.zeros(len(places), bool)
    left = np.arange(len(places))
    for near, exact in steps:
        step = near * normals[owners[left]]
        both = np.concatenate([places[left] + step, places[left] - step])
        above, below = np.split(winding_numbers(points, triangles, both, exact) > 0.5, 2)
        found[left] = above != below
        left = left[above == below]
        if len(left) == 0:
            break
    return found


def facets_of_reference(surface, owners, belongs, finest):
    """Return the facets, and pieces of facets, that belong to the reference.

    Facets of which some samples belong to it are divided until their pieces do or do not, or are
    smaller than ``finest``; such a piece belongs to it if a corner or its middle does.
    """
    points, triangles = surface
    n = len(triangles)
    seen = np.bincount(owners, minlength=n)
    inside = np.bincount(owners[belongs], minlength=n)
    whole = triangles[(inside == seen) & (seen > 0)]
    kept = [np.stack(fan(points, whole), axis=1)]
    mixed = np.flatnonzero((inside > 0) & (inside < seen))
    parts, owner = np.stack(fan(points, triangles[mixed]), axis=1), mixed
    area, _ = areas_and_normals(points, triangles[mixed])
    first = max(finest, 2.0 * np.sqrt(area.sum() / _PIECES))
    while len(parts) > 0:
        longest = np.linalg.norm(parts - np.roll(parts, 1, axis=1), axis=2).max(axis=1)
        centre = parts.mean(axis=1, keepdims=True)
        seen_at = np.concatenate([centre, 0.98 * parts + 0.02 * centre], axis=1)
        small = (longest <= first) | (len(parts) > _PIECES)
        is_in = np.zeros((len(parts), 4), bool)
        places, owners = seen_at[small].reshape(-1, 3), np.repeat(owner[small], 4)
        is_in[small] = crosses_one_half(surface, places, owners, ((_NEAR, False),)).reshape(-1, 4)
        mixed = is_in.any(axis=1) & ~is_in.all(axis=1)
        left = ~small | (mixed & (longest > finest) & (len(parts) <= _PIECES))
        kept.append(parts[~left & is_in.any(axis=1)])
        parts, owner = _halved(parts[left]), np.tile(owner[left], 2)
    corners = np.concatenate(kept)
    return Surface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _halved(parts):
    """Divide the longest side of each triangle, so that slivers become few pieces."""
    sides = np.linalg.norm(np.roll(parts, -1, axis=1) - parts, axis=2)
    order = (sides.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(parts, order[..., None], axis=1).transpose(1, 0, 2)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack(t, axis=1) for t in ((a, middle, c), (middle, b, c))])


# --- the mesh -------------------------------------------------------------------------------------

_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
_SIDES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def volumes(points, cells):
    """Return the volumes of tetrahedra, those of most of them positive."""
    a, b, c, d = points[cells].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
    return volume if (volume > 0.0).sum() * 2 >= len(volume) else -volume


def dihedral_angles(points, cells):
    """Return the least dihedral angle of each tetrahedron, in degrees."""
    corners = points[cells]
    normals = []
    for face in _FACES:
        a, b, c = corners[:, face].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        normals.append(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])
    cosines = [np.einsum("ij,ij->i", normals[i], normals[j]) for i, j in _SIDES]
    return np.degrees(np.pi - np.arccos(np.clip(cosines, -1.0, 1.0))).min(axis=0)


def boundary_of(points, cells):
    """Return the faces of one tetrahedron only, normals outwards; triangles as they are."""
    if cells.shape[1] == 3:
        return Surface(points, cells)
    a, b, c, d = points[cells].transpose(1, 0, 2)
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    cells = np.where(turned[:, None], cells[:, [1, 0, 2, 3]], cells)
    faces = cells[:, _FACES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return Surface(points, faces[first[count == 1]])


def least_angle_between(surface, least_height):
    """Return the least angle in degrees at which two facets meet that are high enough."""
    points, triangles = surface
    if len(triangles) == 0:
        return 180.0
    ends, _, owner = half_edges(triangles)
    ends, edge, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    sides = owner[order[(count[edge.ravel()] == 2)[order]].reshape(-1, 2)]
    a, b = points[ends[count == 2]].transpose(1, 0, 2)
    along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1), 1e-300)[:, None]
    across = []
    for side in sides.T:
        apex = points[triangles[side].sum(axis=1) - ends[count == 2].sum(axis=1)] - a
        across.append(apex - np.einsum("ij,ij->i", apex, along)[:, None] * along)
    low = np.minimum(*(np.linalg.norm(one, axis=1) for one in across)) <= least_height
    sine = np.linalg.norm(np.cross(*across), axis=1)
    angles = np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", *across)))
    return float(np.where(low, 180.0, angles).min(initial=180.0))


def edges_not_manifold(triangles):
    """Return the number of edges that are not in two facets."""
    _, count = np.unique(half_edges(triangles)[0], axis=0, return_counts=True)
    return int(np.count_nonzero(count != 2))


def components(cells):
    """Return the number of parts whose cells are connected by facets (edges of triangles)."""
    n = cells.shape[1]
    sides = np.sort(np.concatenate([np.delete(cells, i, axis=1) for i in range(n)]), axis=1)
    _, side = np.unique(sides, axis=0, return_inverse=True)
    own = np.tile(np.arange(len(cells)), n)
    total = len(cells) + side.max() + 1
    graph = coo_array((np.ones(len(own)), (own, len(cells) + side.ravel())), shape=(total, total))
    return int(connected_components(graph, directed=False)[0])


def share_in_band(mesh):
    """Return the share of edges within a factor sqrt 2 of the mean of the sizes at their ends."""
    n = mesh.cells.shape[1]
    pairs = _SIDES if n == 4 else _SIDES[[0, 1, 3]]
    a, b = np.unique(np.sort(mesh.cells[:, pairs].reshape(-1, 2), axis=1), axis=0).T
    ratio = np.linalg.norm(mesh.points[a] - mesh.points[b], axis=1)
    ratio /= 0.5 * (mesh.sizes[a] + mesh.sizes[b])
    return float(np.mean((ratio >= np.sqrt(0.5)) & (ratio <= np.sqrt(2.0))))


# --- the comparison -------------------------------------------------------------------------------


def judge(part, mesh, tolerance, count=_COUNT, grid=_GRID):
    """Return the measures of a mesh, a dictionary.

    Parameters
    ----------
    part : Surface
    mesh : Mesh or None
        If there is none, the measures are those of the part.
    tolerance : float
        Over the diagonal of the part.
    count : int
        Samples of each surface, besides its corners.
    grid : int
        Cells along a side of the grid for volumes and overlaps.
    """
    begin, rng = time.process_time(), np.random.default_rng(20261126)
    used = part.points[part.triangles].reshape(-1, 3)
    low, diagonal = used.min(axis=0), float(np.linalg.norm(np.ptp(used, axis=0)))
    surface = repaired(Surface((part.points - low) / diagonal, part.triangles))
    found = {"tolerance": tolerance, **_of_part(surface, grid, rng)}
    if mesh is None:
        return found
    points = (mesh.points - low) / diagonal
    new = boundary_of(points, mesh.cells)
    found |= _of_cells(mesh._replace(points=points), diagonal)
    found["least_of_part"] = least_angle_between(surface, tolerance)
    found["edges_not_manifold"] = edges_not_manifold(new.triangles)
    found |= _of_volume(surface, new, found["open_edges_of_part"] == 0, grid, rng)
    found |= _of_distance(surface, new, tolerance, count, rng)
    for name in ("place_from_part", "place_from_mesh"):
        found[name] = (np.array(found[name]) * diagonal + low).tolist() if found[name] else None
    area, _ = areas_and_normals(*surface)
    allowed = tolerance * area.sum() / max(found["volume_of_part"], 1e-30)
    found["volume_allowed"] = max(_VOLUME, float(allowed))
    for name in ("volume", "volume_of_part"):
        found[name] *= diagonal**3
    return found | {"seconds": round(time.process_time() - begin, 1)}


def _of_cells(mesh, diagonal):
    """Return the measures of the cells, whose points are over the diagonal."""
    used = np.unique(mesh.cells)
    found = {"cells": len(mesh.cells), "nodes": len(used), "components": components(mesh.cells)}
    if mesh.cells.shape[1] == 4:
        angles = dihedral_angles(mesh.points, mesh.cells)
        found |= {"least": float(angles.min()), "inverted": 0}
        found |= {f"below_{limit}": int((angles < limit).sum()) for limit in (8, 10, 15)}
        found["inverted"] = int((volumes(mesh.points, mesh.cells) <= 0.0).sum())
    if mesh.sizes is not None:
        sizes = np.ravel(mesh.sizes) / diagonal
        found["band"] = share_in_band(mesh._replace(sizes=sizes))
    return found


def _places(corners, n, rng):
    """Return one random point in each cell of a grid around points, and the volume of the grid."""
    low, sides = corners.min(axis=0), np.ptp(corners, axis=0)
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return low + (cells + rng.random(cells.shape)) * sides / n, float(np.prod(sides))


def _of_part(surface, grid, rng):
    """Return how open the part is, and whether it means a solid: openings are small beside it."""
    places, whole = _places(surface.points[surface.triangles.ravel()], grid, rng)
    around = winding_numbers(*surface, places, exact=False)
    inside = np.count_nonzero(around > 0.5)
    fractions = np.count_nonzero(np.abs(around - np.round(around)) > _FRACTION)
    return {
        "facets": len(surface.triangles),
        "odd_edges_of_part": edges_not_manifold(surface.triangles),
        "open_edges_of_part": open_edges(surface.triangles),
        "encloses": bool(inside * whole > 1e-9 * len(places) and fractions <= 0.1 * inside),
    }


def _of_volume(surface, new, is_closed, grid, rng):
    """Return the volumes, and the share of the mesh that lies over itself."""
    corners = [points[triangles.ravel()] for points, triangles in (surface, new)]
    places, whole = _places(np.concatenate(corners), grid, rng)
    old = winding_numbers(*surface, places, exact=False)
    made = np.round(winding_numbers(*new, places, exact=False))
    volume = enclosed_volume(*new)
    if is_closed:
        old = np.round(old)
        reference = enclosed_volume(*surface) + whole * float(np.mean((old > 0.5) - old))
    else:
        reference = volume + whole * float(np.mean((old > 0.5) * 1.0 - (made > 0.5)))
    return {
        "volume": volume,
        "volume_of_part": reference,
        "volume_change": volume / reference - 1.0 if reference > 1e-12 else None,
        "overlap": float(np.sum(made > 1.5) / max(np.sum(made > 0.5), 1)),
    }


def _of_distance(surface, new, tolerance, count, rng):
    places, owners = samples(*surface, count, rng)
    belongs = crosses_one_half(surface, places, owners)
    found = {"hidden": 1.0 - float(belongs.mean())}
    reference = surface
    if not belongs.all():
        reference = facets_of_reference(surface, owners, belongs, tolerance)
    far = distances(*new, places[belongs]) / tolerance
    found |= {"from_part": None, "place_from_part": None}
    if len(far) > 0:
        worst = int(far.argmax())
        found |= {
            "from_part": float(far[worst]),
            "place_from_part": places[belongs][worst].tolist(),
        }
    at, owners = samples(*new, count, rng)
    found |= {"from_mesh": None, "place_from_mesh": None, "free": 0.0}
    if len(reference.triangles) > 0:
        far = distances(*reference, at) / tolerance
        off = np.flatnonzero(far > 1.0)
        normals = areas_and_normals(*new)[1][owners[off]]
        free = off[_is_in_opening(surface, at[off], 0.1 * tolerance * normals)]
        found["free"] = len(free) / len(at)
        far[free] = 0.0
        worst = int(far.argmax())
        found |= {"from_mesh": float(far[worst]), "place_from_mesh": at[worst].tolist()}
    both = [found["from_part"], found["from_mesh"]]
    found["H"] = max(both) if None not in both else None
    return found


def _is_in_opening(surface, places, steps):
    """Return where the winding number is no integer a step away, on both sides."""
    if len(places) == 0:
        return np.zeros(0, bool)
    both = np.concatenate([places + steps, places - steps])
    around = winding_numbers(*surface, both, exact=False)
    return (np.abs(around - np.round(around)) > _FRACTION).reshape(2, -1).all(axis=0)


def missed(found, cap=None, distance=_DISTANCE):
    """Return the names of the requirements that a mesh does not meet."""
    too_far = found["H"] is None or found["H"] > distance
    change = found["volume_change"]
    off = change is None or abs(change) > found["volume_allowed"]
    requirements = {
        "distance": too_far,
        "volume": off,
        "boundary": found["edges_not_manifold"] > found["odd_edges_of_part"],
        "cells": found.get("inverted", 0) > 0 or found["overlap"] > _OVERLAP,
        "angles": found.get("least", 180.0) < _LEAST_ANGLE <= found.get("least_of_part", 180.0),
        "number": cap is not None and found["cells"] > _NUMBER * cap,
    }
    return [name for name, is_missed in requirements.items() if is_missed]


def is_true(code, found, cap=None):
    """Return whether an exit code agrees with the measures; None where no mesh was written.

    0 allows what is *near*, 10 % more than the tolerance; 1 needs something that is missed.
    """
    if found is None:
        return None if code != 0 else False
    if code == 0:
        return not missed(found, cap, _NEAR_ENOUGH)
    return bool(missed(found, cap, 1.0))


def judged(part, mesh, tolerance, python=sys.executable, count=_COUNT, grid=_GRID):
    """Return the measures, by the Python of another environment if that is wanted."""
    if python == sys.executable:
        return judge(part, mesh, tolerance, count, grid)
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / "part.npz"]
        np.savez(files[0], points=part.points, triangles=part.triangles)
        if mesh is not None:
            files.append(Path(folder) / "mesh.npz")
            sizes = {} if mesh.sizes is None else {"sizes": mesh.sizes}
            np.savez(files[1], points=mesh.points, cells=mesh.cells, **sizes)
        command = [python, __file__, *map(str, files), "--tolerance", repr(tolerance), "--json"]
        command += ["--samples", str(count), "--grid", str(grid)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"the measures failed: {done.stderr[-2000:]}")
        return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("part", help="the surface")
    add(
        "mesh",
        nargs="?",
        help="tetrahedra, or a new surface, with a nodal field h if there are sizes",
    )
    add("--tolerance", type=float, default=1e-3, help="over the diagonal")
    add("--cap", type=float, help="largest number of cells")
    add("--reference", help="the solid that is meant, .npz, instead of the part")
    add("--python", default=sys.executable, help="of an environment with libigl")
    add("--samples", type=int, default=_COUNT, help="of each surface, besides its corners")
    add("--grid", type=int, default=_GRID, help="cells along a side, for volumes and overlaps")
    add("--json", action="store_true", help="print one JSON object only")
    given = parser.parse_args()
    part = read_surface(given.reference or given.part)
    mesh = read_mesh(given.mesh) if given.mesh else None
    found = judged(part, mesh, given.tolerance, given.python, given.samples, given.grid)
    if given.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:20}{value:.4g}" if isinstance(value, float) else f"{name:20}{value}")
    if mesh is not None:
        print(f"{'missed':20}{', '.join(missed(found, given.cap)) or 'nothing'}")


if __name__ == "__main__":
    main()
