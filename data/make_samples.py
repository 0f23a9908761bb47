"""Make the sample files of this folder, each the same on every run.

Needs, for this script only: ``pip install manifold3d gmsh`` (solids by manifold3d,
the meshes of plane and solid domains by gmsh), and for plate.vtk scikit-fem.

    python data/make_samples.py              # every file, beside this script
    python data/make_samples.py bracket.stl --into /tmp
"""

import argparse
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import meshio
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

ELEMENTS_PER_RADIAN = 4.0  # h0 = R / 4 on the curved boundaries of the samples


# --- bracket.stl ------------------------------------------------------------------


def make_bracket(path: Path) -> None:
    """Write an L-bracket in millimetres, 100 x 60 x 40, as a CAD program exports it.

    Base plate 8 thick with four bolt holes (diameter 9), upright wall 8 thick with a
    boss and a hole, a fillet of radius 10 between them, rounded plate corners of radius
    8, a bored boss on the plate and a rib 1.8 thick.
    """
    from manifold3d import CrossSection, Manifold

    def cylinder(x: float, y: float, low: float, high: float, radius: float, n: int) -> Manifold:
        return Manifold.cylinder(high - low, radius, radius, n).translate([x, y, low])

    def along_x(low: float, high: float, radius: float, n: int) -> Manifold:
        standing = Manifold.cylinder(high - low, radius, radius, n)
        return standing.rotate([0.0, 90.0, 0.0]).translate([low, 14.0, 28.0])

    def along_y(profile: FloatArray, low: float, high: float) -> Manifold:
        # An extrusion goes along z; turning it about x sends (x, y, z) to (x, -z, y).
        solid = Manifold.extrude(CrossSection([profile]), high - low)
        return solid.rotate([90.0, 0.0, 0.0]).translate([0.0, high, 0.0])

    fillet = _arc((18.0, 18.0), 10.0, 270.0, 180.0, 12)
    side = np.vstack([[(0, 0), (100, 0), (100, 8)], fillet, [(8, 40), (0, 40)]])
    corners = [
        _arc((92.0, 8.0), 8.0, -90.0, 0.0, 12),
        _arc((92.0, 52.0), 8.0, 0.0, 90.0, 12),
    ]
    outline = np.vstack([[(0, 0)], *corners, [(0, 60)]])
    body = along_y(side, 0.0, 60.0) ^ Manifold.extrude(CrossSection([outline]), 40.0)
    toe = np.array([(4.0, 4.0), (54.0, 4.0), (54.0, 11.0), (8.0, 36.0), (4.0, 36.0)])
    rib = along_y(toe, 0.0, 1.8)
    body += rib.translate([0.0, 29.1, 0.0])
    body += cylinder(74.0, 30.0, 4.0, 20.0, 12.0, 64)
    body += along_x(4.0, 14.0, 9.0, 56)
    body -= cylinder(74.0, 30.0, -1.0, 21.0, 7.0, 48)
    body -= along_x(-1.0, 15.0, 5.0, 40)
    for x, y in ((30.0, 10.0), (30.0, 50.0), (90.0, 10.0), (90.0, 50.0)):
        body -= cylinder(x, y, -1.0, 9.0, 4.5, 40)

    solid = body.to_mesh()
    _write_binary_stl(path, np.asarray(solid.vert_properties)[:, :3], np.asarray(solid.tri_verts))


def _write_binary_stl(path: Path, points: npt.NDArray[np.float32], cells: IntArray) -> None:
    corners = np.asarray(points, dtype="<f4")[cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(len(cells), facet)
    facets["normal"], facets["corners"] = normals, corners
    header = b"adaptsize sample: bracket, millimetres".ljust(80)
    path.write_bytes(header + struct.pack("<I", len(facets)) + facets.tobytes())


def _arc(centre: Sequence[float], radius: float, start: float, stop: float, n: int) -> FloatArray:
    """Return n + 1 points of an arc, angles in degrees."""
    angle = np.deg2rad(np.linspace(start, stop, n + 1))
    return np.asarray(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


# --- triangles in the plane -------------------------------------------------------


def make_slit(path: Path) -> None:
    """Write a 4 x 3 rectangle with a narrow slit from the top and a small round notch.

    The notch (radius 0.15, tag 1) lies 0.23 to the left of the slit (width 0.04, tag 2);
    the way from it to the right half leads around the lower end of the slit, 2.2 below.
    """
    notch = 0.15 / ELEMENTS_PER_RADIAN
    with _gmsh() as gmsh:
        corners = [
            (0.0, 0.0, 0.13),
            (4.0, 0.0, 0.13),
            (4.0, 3.0, 0.13),
            (2.02, 3.0, 0.06),
            (2.02, 0.8, 0.04),
            (1.98, 0.8, 0.04),
            (1.98, 3.0, 0.06),
            (1.75, 3.0, notch),
            (1.6, 2.85, notch),
            (1.45, 3.0, notch),
            (0.0, 3.0, 0.13),
        ]
        arcs = {7: (1.6, 3.0), 8: (1.6, 3.0)}
        tags = {3: 2, 4: 2, 5: 2, 7: 1, 8: 1}
        _outline(gmsh, corners, arcs, tags)
        points, triangles, segments, segment_tags = _plane_mesh(gmsh)
    h0 = _on_tagged(len(points), segments, segment_tags, {1: notch})
    _write_tagged(path, points, triangles, segments, segment_tags, {"h0": h0})


def make_curved(path: Path) -> None:
    """Write a 10 x 6 rectangle of which three boundaries are arcs of radius 1.5, 0.5 and 4.

    Tag 1: a quarter disc of radius 1.5 cut out of the lower left corner; tag 2: a half
    disc of radius 0.5 cut out of the top; tag 3: a rounded corner of radius 4, upper right.
    """
    radius = {1: 1.5, 2: 0.5, 3: 4.0}
    size = {tag: r / ELEMENTS_PER_RADIAN for tag, r in radius.items()}
    with _gmsh() as gmsh:
        corners = [
            (1.5, 0.0, 0.3),
            (10.0, 0.0, 0.3),
            (10.0, 2.0, 0.3),
            (6.0, 6.0, 0.3),
            (4.5, 6.0, size[2]),
            (4.0, 5.5, size[2]),
            (3.5, 6.0, size[2]),
            (0.0, 6.0, 0.3),
            (0.0, 1.5, 0.3),
        ]
        arcs = {2: (6.0, 2.0), 4: (4.0, 6.0), 5: (4.0, 6.0), 8: (0.0, 0.0)}
        tags = {2: 3, 4: 2, 5: 2, 8: 1}
        _outline(gmsh, corners, arcs, tags)
        points, triangles, segments, segment_tags = _plane_mesh(gmsh)
    h0 = _on_tagged(len(points), segments, segment_tags, size)
    _write_tagged(path, points, triangles, segments, segment_tags, {"h0": h0})


def make_lshape(path: Path) -> None:
    """Write the square (-1, 1)^2 without its lower right quarter, edges of about 0.07."""
    with _gmsh() as gmsh:
        corners = [(-1, -1), (0, -1), (0, 0), (1, 0), (1, 1), (-1, 1)]
        _outline(gmsh, [(x, y, 0.07) for x, y in corners], {}, {})
        points, triangles, _, _ = _plane_mesh(gmsh)
    _write(path, points, [("triangle", triangles)])


def _outline(
    gmsh: object,
    corners: Sequence[tuple[float, float, float]],
    arcs: dict[int, tuple[float, float]],
    tags: dict[int, int],
) -> None:
    """Add the region inside a closed outline of (x, y, size); ``arcs`` gives centres."""
    geo = gmsh.model.geo  # type: ignore[attr-defined]
    ends = [geo.addPoint(x, y, 0.0, size) for x, y, size in corners]
    curves = []
    for i, start in enumerate(ends):
        stop = ends[(i + 1) % len(ends)]
        if i in arcs:
            curves.append(geo.addCircleArc(start, geo.addPoint(*arcs[i], 0.0), stop))
        else:
            curves.append(geo.addLine(start, stop))
    surface = geo.addPlaneSurface([geo.addCurveLoop(curves)])
    geo.synchronize()
    for tag in sorted(set(tags.values())):
        members = [curve for i, curve in enumerate(curves) if tags.get(i) == tag]
        gmsh.model.addPhysicalGroup(1, members, tag)  # type: ignore[attr-defined]
    gmsh.model.addPhysicalGroup(2, [surface], 1)  # type: ignore[attr-defined]


def _plane_mesh(gmsh: object) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Mesh the outline; return points (n, 2), triangles, tagged segments and their tags."""
    gmsh.model.mesh.generate(2)  # type: ignore[attr-defined]
    points, cells, tags = _taken_from(gmsh, {2: 3, 1: 2})
    return points[:, :2], cells[2], cells[1], tags[1]


def make_plate(path: Path) -> None:
    """Write a plate 100 x 60 with a hole and a stiff inlay, pulled at its ends, as a VTK file.

    With the names of a simulation program: cells have ``Material`` 10 (plate) or 20 (inlay) and
    an ``ElementId``; nodes have ``displacement`` in millimetres and ``von_mises`` in MPa,
    for a pull of 100 MPa, plane stress, computed on this mesh with linear elements.
    """
    sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
    from plot_hot_spot import HOLE, RADIUS, stresses, von_mises

    from adaptsize import SimplexMesh

    with _gmsh() as gmsh:
        occ, model = gmsh.model.occ, gmsh.model  # type: ignore[attr-defined]
        plate = occ.addRectangle(0.0, 0.0, 0.0, 100.0, 60.0)
        hole = occ.addDisk(*HOLE, 0.0, RADIUS, RADIUS)
        inlay = occ.addDisk(68.0, 30.0, 0.0, 9.0, 9.0)
        cut, _ = occ.cut([(2, plate)], [(2, hole)])
        occ.fragment(cut, [(2, inlay)])
        occ.synchronize()
        for _, face in model.getEntities(2):
            material = 10 if model.getBoundingBox(2, face)[0] < 1.0 else 20
            model.addPhysicalGroup(2, [face], material)
        away = f"Sqrt((x-{HOLE[0]})^2 + (y-{HOLE[1]})^2) - {RADIUS}"
        _size_by_formula(gmsh, f"Min(4, 1.8 + 0.25 * Fabs({away}))")
        model.mesh.generate(2)
        points, cells, tags = _taken_from(gmsh, {2: 3})
    mesh = SimplexMesh(points[:, :2], cells[2], cell_tags=tags[2])
    moved = np.column_stack([stresses(mesh)[0], np.zeros(mesh.n_points)])
    fields = {"displacement": moved, "von_mises": von_mises(mesh)}
    numbers = {"Material": [tags[2]], "ElementId": [np.arange(1, mesh.n_cells + 1)]}
    _write(path, points[:, :2], [("triangle", cells[2])], fields, numbers)


# --- a surface in space -----------------------------------------------------------


def make_shell(path: Path) -> None:
    """Write a sheet folded like a hairpin: two legs 10 long and 6 wide, 1 apart.

    The fold is a half cylinder of radius 0.5, so the sheet rolls out flat and distances
    along it are distances in the plane.  ``h0`` asks for 0.1 at one node of the upper leg.
    """
    leg, width, radius = 10.0, 6.0, 0.5
    arc = np.pi * radius
    with _gmsh() as gmsh:
        left, right, fine = -leg - arc / 2, leg + arc / 2, 0.14
        corners = [
            (left, 0.0, 0.4),
            (0.0, 0.0, fine),
            (right, 0.0, 0.4),
            (right, width, 0.4),
            (0.0, width, fine),
            (left, width, 0.4),
        ]
        _outline(gmsh, corners, {}, {})
        _size_by_formula(gmsh, f"{fine} + 0.08 * Max(0, Fabs(x) - {arc / 2})")
        flat, triangles, _, _ = _plane_mesh(gmsh)
    s, y = flat.T
    angle = np.clip(s, -arc / 2, arc / 2) / radius  # -90 degrees below, 90 above
    x = radius * np.cos(angle) - np.maximum(np.abs(s) - arc / 2, 0.0)
    points = np.column_stack([x, y, radius * np.sin(angle)])
    h0 = np.full(len(points), np.inf)
    h0[np.argmin(np.linalg.norm(points - (-7.0, 3.0, radius), axis=1))] = 0.1
    _write(path, points, [("triangle", triangles)], {"h0": h0, "rolled_out": flat})


# --- tetrahedra -------------------------------------------------------------------


def make_block(path: Path) -> None:
    """Write a block 40 x 20 x 20 (region 1) with a ball of radius 6 in it (region 2).

    Facet tags: 1 and 2 the ends x = 0 and x = 40, 3 the other four sides, 10 the
    interface.  Nodal data: temperature (a smooth field), displacement (a vector) and h0.
    """
    centre, radius = np.array([14.0, 10.0, 10.0]), 6.0
    with _gmsh() as gmsh:
        occ = gmsh.model.occ
        block = occ.addBox(0.0, 0.0, 0.0, 40.0, 20.0, 20.0)
        ball = occ.addSphere(*centre, radius)
        occ.fragment([(3, block)], [(3, ball)])
        occ.synchronize()
        _tag_block(gmsh, centre)
        _size_by_formula(
            gmsh,
            f"1.7 + 0.16 * Fabs(Sqrt((x-{centre[0]})^2 + (y-{centre[1]})^2 + (z-{centre[2]})^2)"
            f" - {radius})",
        )
        gmsh.model.mesh.generate(3)
        points, cells, tags = _taken_from(gmsh, {3: 4, 2: 3})
    x, _, z = points.T
    away = np.linalg.norm(points - centre, axis=1)
    h0 = np.where(np.abs(away - radius) < 1e-3 * radius, radius / ELEMENTS_PER_RADIAN, np.inf)
    bend = np.column_stack([-2.0 * x * (z - 10.0), np.zeros_like(x), x * x]) * 1e-3
    fields = {
        "temperature": 20.0 + 80.0 * np.exp(-((away / 10.0) ** 2)),
        "displacement": bend,
        "h0": h0,
    }
    _write_tagged(path, points, cells[3], cells[2], tags[2], fields, regions=tags[3])


def _tag_block(gmsh: object, centre: FloatArray) -> None:
    """Name the two volumes and the outer and inner faces by where they lie."""
    model = gmsh.model  # type: ignore[attr-defined]
    groups: dict[tuple[int, int], list[int]] = {}
    for _, volume in model.getEntities(3):
        low_x = model.getBoundingBox(3, volume)[0]
        groups.setdefault((3, 1 if low_x < 1.0 else 2), []).append(volume)
    for _, face in model.getEntities(2):
        box = model.getBoundingBox(2, face)
        if box[0] > 1.0 and box[3] < 39.0:
            tag = 10
        elif box[3] - box[0] > 1.0:
            tag = 3
        else:
            tag = 1 if box[0] < 1.0 else 2
        groups.setdefault((2, tag), []).append(face)
    for (dim, tag), members in sorted(groups.items()):
        model.addPhysicalGroup(dim, members, tag)


# --- gmsh and files ---------------------------------------------------------------


@contextmanager
def _gmsh() -> Iterator[object]:
    """Open a quiet gmsh session on one thread: the same mesh on every run."""
    import gmsh

    gmsh.initialize(["-nopopup"], interruptible=False)
    for option, value in {
        "General.Terminal": 0,
        "General.NumThreads": 1,
        "Mesh.Algorithm": 6,
        "Mesh.Algorithm3D": 1,
        "Mesh.RandomSeed": 1,
    }.items():
        gmsh.option.setNumber(option, value)
    try:
        yield gmsh
    finally:
        gmsh.finalize()


def _size_by_formula(gmsh: object, formula: str) -> None:
    """Let one formula of x, y, z give the edge lengths, and nothing else."""
    field = gmsh.model.mesh.field  # type: ignore[attr-defined]
    number = field.add("MathEval")
    field.setString(number, "F", formula)
    field.setAsBackgroundMesh(number)
    for option in ("Points", "Curvature"):
        gmsh.option.setNumber(f"Mesh.MeshSizeFrom{option}", 0)  # type: ignore[attr-defined]
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)  # type: ignore[attr-defined]


def _taken_from(
    gmsh: object, nodes_per_cell: dict[int, int]
) -> tuple[FloatArray, dict[int, IntArray], dict[int, IntArray]]:
    """Return the nodes that cells use, and by dimension the cells of physical groups and tags."""
    model = gmsh.model  # type: ignore[attr-defined]
    node_tags, xyz, _ = model.mesh.getNodes()
    found: dict[int, IntArray] = {}
    tags: dict[int, IntArray] = {}
    for dim, width in nodes_per_cell.items():
        blocks, numbers = [np.empty((0, width), np.int64)], [np.empty(0, np.int64)]
        for _, group in model.getPhysicalGroups(dim):
            for entity in model.getEntitiesForPhysicalGroup(dim, group):
                for nodes in model.mesh.getElements(dim, entity)[2]:
                    blocks.append(np.asarray(nodes, np.int64).reshape(-1, width))
                    numbers.append(np.full(len(blocks[-1]), group))
        found[dim], tags[dim] = np.vstack(blocks), np.concatenate(numbers)
    used = np.unique(found[max(found)])  # centres of arcs are nodes of no cell
    place = np.full(int(node_tags.max()) + 1, -1)
    place[used] = np.arange(len(used))
    row = np.full(int(node_tags.max()) + 1, -1)
    row[node_tags.astype(np.int64)] = np.arange(len(node_tags))
    points = xyz.reshape(-1, 3)[row[used]]
    return points, {dim: place[cells] for dim, cells in found.items()}, tags


def _on_tagged(
    n: int, segments: IntArray, segment_tags: IntArray, size: dict[int, float]
) -> FloatArray:
    """Return upper bounds of the size: ``size[tag]`` on the tagged curves, inf elsewhere."""
    h0 = np.full(n, np.inf)
    for tag, value in size.items():
        nodes = segments[segment_tags == tag]
        h0[nodes] = np.minimum(h0[nodes], value)
    return h0


def _write_tagged(
    path: Path,
    points: FloatArray,
    cells: IntArray,
    facets: IntArray,
    facet_tags: IntArray,
    point_data: dict[str, FloatArray],
    regions: IntArray | None = None,
) -> None:
    """Write cells and tagged facets; ``region`` counts on cells, ``tag`` on facets."""
    kinds = {3: ("triangle", "line"), 4: ("tetra", "triangle")}[cells.shape[1]]
    inside = np.ones(len(cells), np.int32) if regions is None else regions
    cell_data = {
        "region": [inside, np.zeros(len(facets), np.int32)],
        "tag": [np.zeros(len(cells), np.int32), facet_tags],
    }
    _write(path, points, [(kinds[0], cells), (kinds[1], facets)], point_data, cell_data)


def _write(
    path: Path,
    points: FloatArray,
    blocks: list[tuple[str, IntArray]],
    point_data: dict[str, FloatArray] | None = None,
    cell_data: dict[str, list[IntArray]] | None = None,
) -> None:
    flat = points.shape[1] == 2
    in_space = np.column_stack([points, np.zeros(len(points))]) if flat else points
    narrow = [(kind, cells.astype(np.int32)) for kind, cells in blocks]
    tags = {k: [v.astype(np.int32) for v in rows] for k, rows in (cell_data or {}).items()}
    meshio.write(path, meshio.Mesh(in_space, narrow, point_data or {}, tags))


SAMPLES = {
    "bracket.stl": make_bracket,
    "slit.vtu": make_slit,
    "curved.vtu": make_curved,
    "lshape.vtu": make_lshape,
    "plate.vtk": make_plate,
    "shell.vtu": make_shell,
    "block.vtu": make_block,
}


def main() -> None:
    """Make the files named on the command line, or all."""
    parser = argparse.ArgumentParser(description="Make the sample files of adaptsize.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SAMPLES))
    parser.add_argument("--into", type=Path, default=Path(__file__).parent, help="folder")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - set(SAMPLES))
    if unknown:
        parser.error(f"no such sample: {', '.join(unknown)}")
    for name in arguments.names or SAMPLES:
        SAMPLES[name](arguments.into / name)
        print(f"{name}: {(arguments.into / name).stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
