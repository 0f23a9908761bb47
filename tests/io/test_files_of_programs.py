"""Files that other programs have written are read by content: nodes, cells, regions and data.

Fields and regions are functions of the place, so that each value is compared where it belongs,
however a program orders nodes and cells.
"""

from itertools import product

import meshio
import numpy as np
import pytest
import pyvista
import trimesh
from meshes import jittered_cube, jittered_square
from numpy.testing import assert_allclose

from adaptsize import read

SEEDS = range(4)


def plane(seed):
    return jittered_square(4 + seed, seed, half_width=1.0)


def solid(seed):
    return jittered_cube(3 + seed % 2, seed, half_width=1.0)


def skin(seed):
    return solid(seed).boundary().mesh


KINDS = {"plane": plane, "solid": solid, "skin": skin}


def value(points):
    """A nodal field."""
    return points @ np.array([1.0, 2.0, 4.0])[: points.shape[1]]


def region(centroids):
    return 1 + (centroids[:, 0] > 0.1).astype(np.int32)


def with_content(mesh):
    """The points in space, the cells, their type, a nodal field, a cell field and regions."""
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    centroids = points[mesh.cells].mean(axis=1)
    kind = "tetra" if mesh.cell_dim == 3 else "triangle"
    return points, mesh.cells, kind, value(points), value(centroids), region(centroids)


def in_order(points):
    return points[np.lexsort(points.round(6).T)]


def check(found, mesh, holds, rtol=1e-12):
    """Compare a mesh that was read with the one that was written."""
    assert (found.cell_dim, found.dim) == (mesh.cell_dim, mesh.dim)
    assert (found.n_points, found.n_cells) == (mesh.n_points, mesh.n_cells)
    assert_allclose(in_order(found.points), in_order(mesh.points), rtol=0, atol=10 * rtol)
    new, old = (m.points[m.cells].mean(axis=1) for m in (found, mesh))
    assert_allclose(in_order(new), in_order(old), rtol=0, atol=10 * rtol)
    assert found.measures.sum() == pytest.approx(mesh.measures.sum(), rel=100 * rtol)
    if "nodes" in holds:
        assert_allclose(found.point_data["u"], value(found.points), rtol=0, atol=100 * rtol)
    if "cells" in holds:
        assert_allclose(found.cell_data["e"], value(new), rtol=0, atol=100 * rtol)
    if "tags" in holds:
        assert np.array_equal(found.cell_tags, region(new))


#: In text, meshio writes data to files of Gmsh as "np.float64(1.0)", which is refused.
#: Of meshio: the suffix, what the format holds, the name of regions, options, the accuracy.
MESHIO = {
    "vtu": (".vtu", "nodes cells tags", "cell_tags", {"binary": True}, 1e-12),
    "vtu ascii": (".vtu", "nodes cells tags", "cell_tags", {"binary": False}, 1e-9),
    "vtk": (".vtk", "nodes cells tags", "cell_tags", {"binary": True}, 1e-12),
    "vtk ascii": (".vtk", "nodes cells tags", "cell_tags", {"binary": False}, 1e-9),
    "vtk 4.2": (".vtk", "nodes cells tags", "cell_tags", {"file_format": "vtk42"}, 1e-12),
    "gmsh 2.2": (".msh", "nodes cells tags", "gmsh:physical", {"file_format": "gmsh22"}, 1e-12),
    "gmsh 2.2 ascii": (
        ".msh", "tags", "gmsh:physical", {"file_format": "gmsh22", "binary": False},
        1e-9,
    ),
    "gmsh 4.1": (".msh", "nodes cells", "", {"file_format": "gmsh"}, 1e-12),
    "gmsh 4.1 ascii": (
        ".msh", "", "", {"file_format": "gmsh", "binary": False}, 1e-9
    ),
    "medit": (".mesh", "tags", "medit:ref", {}, 1e-9),
    "medit binary": (".meshb", "tags", "medit:ref", {}, 1e-12),
    "xdmf": (".xdmf", "nodes cells tags", "cell_tags", {}, 1e-12),
    "xdmf xml": (".xdmf", "nodes cells tags", "cell_tags", {"data_format": "XML"}, 1e-9),
    "abaqus": (".inp", "", "", {}, 1e-9),
    "nastran": (".bdf", "", "", {}, 1e-6),
}  # fmt: skip
#: For surfaces only.
MESHIO_OF_SKINS = {
    "ply": (".ply", "", "", {"binary": True}, 1e-12),
    "ply ascii": (".ply", "", "", {"binary": False}, 1e-9),
    "off": (".off", "", "", {}, 1e-9),
    "obj": (".obj", "", "", {}, 1e-9),
    "stl": (".stl", "", "", {"binary": True}, 1e-6),
    "stl ascii": (".stl", "", "", {"binary": False}, 1e-6),
}


def _write_meshio(path, mesh, holds, tags, options):
    points, cells, kind, u, e, regions = with_content(mesh)
    if mesh.dim == 2 and path.suffix in (".mesh", ".meshb"):
        points = points[:, :2]
    if path.suffix == ".bdf":  # meshio has 16 characters for a number
        points = points.round(6)
    data = {tags: [regions]} if tags else {}
    if tags == "gmsh:physical":
        data["gmsh:geometrical"] = [regions]
    if "cells" in holds:
        data["e"] = [e]
    nodal = {"u": u} if "nodes" in holds else {}
    content = meshio.Mesh(points, [(kind, cells)], point_data=nodal, cell_data=data)
    content.write(path, **options)


CASES = [
    (name, kind, seed)
    for name, kind, seed in product(MESHIO, KINDS, SEEDS)
] + [(name, "skin", seed) for name, seed in product(MESHIO_OF_SKINS, SEEDS)]  # fmt: skip


@pytest.mark.parametrize(("name", "kind"), sorted({case[:2] for case in CASES}))
def test_files_of_meshio(name, kind, tmp_path):
    suffix, holds, tags, options, rtol = (MESHIO | MESHIO_OF_SKINS)[name]
    for seed in SEEDS:
        mesh, path = KINDS[kind](seed), tmp_path / f"{seed}{suffix}"
        _write_meshio(path, mesh, holds, tags, options)
        check(read(path), mesh, holds, rtol)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".vtp", ".ply", ".stl"])
@pytest.mark.parametrize("binary", [True, False])
def test_files_of_vtk(kind, suffix, binary, tmp_path):
    is_surface = suffix in (".vtp", ".ply", ".stl")
    if is_surface and kind != "skin":
        kind = "skin"
    for seed in SEEDS:
        mesh, path = KINDS[kind](seed + 4 * is_surface), tmp_path / f"{seed}{suffix}"
        points, cells, name, u, e, regions = with_content(mesh)
        number = {"triangle": pyvista.CellType.TRIANGLE, "tetra": pyvista.CellType.TETRA}[name]
        data = pyvista.UnstructuredGrid({number: cells}, points)
        data.point_data["u"], data.cell_data["e"], data.cell_data["cell_tags"] = u, e, regions
        if is_surface:
            data = _poly_data(points, cells, data)
        data.save(path, binary=binary)
        holds = "nodes cells tags" if suffix.startswith(".vt") else ""
        check(read(path), mesh, holds, 1e-12 if holds and binary else 1e-6)


def _poly_data(points, cells, data):
    surface = pyvista.PolyData.from_regular_faces(points, cells)
    surface.point_data.update(dict(data.point_data.items()))
    surface.cell_data.update(dict(data.cell_data.items()))
    return surface


TRIMESH = {
    "stl": (".stl", 1e-6), "stl_ascii": (".stl", 1e-6), "ply": (".ply", 1e-6),
    "off": (".off", 1e-7), "obj": (".obj", 1e-7),
}  # fmt: skip


@pytest.mark.parametrize("kind", TRIMESH)
def test_files_of_trimesh(kind, tmp_path):
    suffix, rtol = TRIMESH[kind]
    for seed in range(8):
        mesh, path = skin(seed), tmp_path / f"{seed}{suffix}"
        surface = trimesh.Trimesh(mesh.points, mesh.cells, process=False)
        surface.export(path, file_type=kind)
        check(read(path), mesh, "", rtol)


GMSH = {
    "2.2": (".msh", {"Mesh.MshFileVersion": 2.2}, "tags", 1e-12),
    "2.2 binary": (".msh", {"Mesh.MshFileVersion": 2.2, "Mesh.Binary": 1}, "tags", 1e-12),
    "4.0": (".msh", {"Mesh.MshFileVersion": 4.0}, "tags", 1e-12),
    "4.1": (".msh", {"Mesh.MshFileVersion": 4.1}, "tags", 1e-12),
    "4.1 binary": (".msh", {"Mesh.MshFileVersion": 4.1, "Mesh.Binary": 1}, "tags", 1e-12),
    "vtk": (".vtk", {}, "", 1e-12),
    "medit": (".mesh", {"Mesh.SaveElementTagType": 2}, "tags", 1e-12),
    "nastran": (".bdf", {"Mesh.BdfFieldFormat": 1}, "", 1e-3),
    "nastran long": (".bdf", {"Mesh.BdfFieldFormat": 2}, "", 1e-8),
    "abaqus": (".inp", {}, "", 1e-12),
    "su2": (".su2", {}, "", 1e-12),
}


@pytest.mark.parametrize("name", GMSH)
@pytest.mark.parametrize("kind", ["plane", "solid"])
def test_files_of_gmsh(name, kind, tmp_path):
    gmsh = pytest.importorskip("gmsh")
    suffix, options, holds, rtol = GMSH[name]
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        for option, number in options.items():
            gmsh.option.setNumber(option, number)
        for seed in SEEDS:
            mesh, path = KINDS[kind](seed), tmp_path / f"{seed}{suffix}"
            _write_gmsh(gmsh, path, mesh)
            check(read(path), mesh, holds, rtol)
    finally:
        gmsh.finalize()


def _write_gmsh(gmsh, path, mesh):
    gmsh.clear()
    points, cells, kind, *_, regions = with_content(mesh)
    dim, number = mesh.cell_dim, {"triangle": 2, "tetra": 4}[kind]
    entities = [gmsh.model.addDiscreteEntity(dim) for _ in range(2)]
    gmsh.model.mesh.addNodes(dim, entities[0], np.arange(1, len(points) + 1), points.ravel())
    for k, entity in enumerate(entities, start=1):
        rows = np.flatnonzero(regions == k)
        gmsh.model.mesh.addElementsByType(entity, number, rows + 1, cells[rows].ravel() + 1)
        gmsh.model.addPhysicalGroup(dim, [entity], k)
    gmsh.write(str(path))
