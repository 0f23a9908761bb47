"""Meshes from a surface, a CAD model and an image, with two named faces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads

DATA = Path(__file__).parents[2] / "data"


def of_surface(folder):
    """The bracket, with the faces between its feature edges."""
    mesh = ads.remesh(ads.read(DATA / "bracket.stl").tag_faces(), 5.0)
    tags = np.unique(mesh.facet_tags)
    areas = [ads.SimplexMesh(mesh.points, mesh.tagged_facets[mesh.facet_tags == tag]).measures.sum()
             for tag in tags]  # fmt: skip
    low, high = tags[np.argsort(areas)[-2:]].tolist()
    return replace(mesh, tag_names={(2, low): "fixed end", (2, high): "1st pressed face"})


def of_cad(folder):
    """A plate with a hole from a STEP file."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        occ.cut(
            [(3, occ.addBox(0, 0, 0, 40, 20, 5))], [(3, occ.addCylinder(15, 10, 0, 0, 0, 5, 4))]
        )
        occ.synchronize()
        gmsh.write(str(folder / "plate.step"))
    finally:
        gmsh.finalize()
    mesh = ads.remesh(ads.read_cad(folder / "plate.step"), 3.0)
    return with_ends(mesh)


def of_image(folder):
    """Two labels in a block of voxels."""
    labels = np.zeros((24, 16, 16), np.uint8)
    labels[2:12, 3:13, 3:13], labels[12:22, 3:13, 3:13] = 1, 2
    return with_ends(ads.mesh_image(labels, hmax=4.0))


def with_ends(mesh):
    """A mesh with the parts of its boundary that are farthest to the left and right as faces."""
    boundary = mesh.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    x = mesh.points[facets][:, :, 0]
    low, high = mesh.points[:, 0].min(), mesh.points[:, 0].max()
    near = 0.1 * (high - low)
    tags = np.where((x < low + near).all(axis=1), 1, np.where((x > high - near).all(axis=1), 2, 3))
    regions = {key: name for key, name in mesh.tag_names.items() if key[0] == 3}
    names = {(2, 1): "fixed end", (2, 2): "1st pressed face", (2, 3): "sides"}
    return replace(mesh, tagged_facets=facets, facet_tags=tags, tag_names=regions | names)


@pytest.fixture(scope="session", params=[of_surface, of_cad, of_image])
def solid(request, tmp_path_factory):
    """Tetrahedra with the faces "fixed end" and "1st pressed face"."""
    return request.param(tmp_path_factory.mktemp("solid"))


@pytest.fixture(scope="session")
def plane():
    """Triangles in the plane with two regions and named sides."""
    mesh = ads.read(DATA / "slit.vtu")
    boundary = mesh.boundary()
    edges = boundary.nodes[boundary.mesh.cells]
    x = mesh.points[edges][:, :, 0]
    tags = np.where((x == x.min()).all(axis=1), 1, np.where((x == x.max()).all(axis=1), 3, 2))
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > x.mean()
    names = {(1, 1): "inlet", (1, 2): "wall", (1, 3): "outlet", (2, 1): "left", (2, 2): "right"}
    return ads.SimplexMesh(
        mesh.points, mesh.cells, cell_tags=np.where(right, 2, 1), tagged_facets=edges,
        facet_tags=tags, tag_names=names,
    )  # fmt: skip


def face(mesh, name):
    """The area vector and the area of a named face, with normals out of the mesh."""
    tag = next(tag for (dim, tag), held in mesh.tag_names.items() if held == name and dim == 2)
    boundary = mesh.boundary()
    facets = boundary.mesh.cells[boundary.mesh.cell_tags == tag]
    a, b, c = boundary.mesh.points[facets].transpose(1, 0, 2)
    vectors = 0.5 * np.cross(b - a, c - a)
    return vectors.sum(axis=0), np.linalg.norm(vectors, axis=1).sum()
