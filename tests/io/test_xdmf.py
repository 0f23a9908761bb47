"""XDMF as DOLFINx writes it: a mesh, functions at several times, and tags, with HDF5."""

import h5py
import numpy as np
import pytest
from meshes import jittered_cube, random_square
from numpy.testing import assert_array_equal

from adaptsize import read
from adaptsize.errors import InputWarning, MeshFileError

TYPES = {2: "PolyLine", 3: "Triangle", 4: "Tetrahedron"}
WHOLE = "xpointer(/Xdmf/Domain/Grid[@GridType='Uniform'][1]/*[self::Topology or self::Geometry])"


class Writer:
    """Grids of an XDMF file whose numbers are in a file of HDF5."""

    def __init__(self, folder, namespace):
        self.path, self.namespace = folder / "a.xdmf", namespace
        self.h5 = h5py.File(folder / "a.h5", "w")
        self.grids = []

    def item(self, place, values):
        self.h5[place] = values
        kind = "Float" if values.dtype.kind == "f" else "Int"
        shape = " ".join(map(str, values.shape))
        return (
            f'<DataItem Dimensions="{shape}" NumberType="{kind}" Precision="{values.itemsize}" '
            f'Format="HDF">a.h5:{place}</DataItem>'
        )

    def topology(self, place, cells):
        n, k = cells.shape
        return (
            f'<Topology TopologyType="{TYPES[k]}" NumberOfElements="{n}" NodesPerElement="{k}">'
            f"{self.item(place, cells)}</Topology>"
        )

    def mesh(self, points, cells, name="mesh"):
        kind = "XY" if points.shape[1] == 2 else "XYZ"
        geometry = self.item(f"/Mesh/{name}/geometry", points)
        self.grids.append(
            f'<Grid Name="{name}" GridType="Uniform">{self.topology(f"/Mesh/{name}/t", cells)}'
            f'<Geometry GeometryType="{kind}">{geometry}</Geometry></Grid>'
        )

    def include(self, pointer):
        return f'<xi:include xpointer="{pointer}" />'

    def function(self, name, steps, center="Node"):
        kind = "Scalar" if steps[0].shape[1] == 1 else "Vector"
        text = "".join(
            f'<Grid Name="{name}" GridType="Uniform">{self.include(WHOLE)}<Time Value="{t}" />'
            f'<Attribute Name="{name}" AttributeType="{kind}" Center="{center}">'
            f"{self.item(f'/Function/{name}/{t}', values)}</Attribute></Grid>"
            for t, values in enumerate(steps)
        )
        self.grids.append(
            f'<Grid Name="{name}" GridType="Collection" CollectionType="Temporal">{text}</Grid>'
        )

    def tags(self, name, cells, values):
        self.grids.append(
            f'<Grid Name="{name}" GridType="Uniform">'
            f"{self.include('xpointer(/Xdmf/Domain/Grid/Geometry)')}"
            f"{self.topology(f'/MeshTags/{name}/topology', cells)}"
            f'<Attribute Name="{name}" AttributeType="Scalar" Center="Cell">'
            f"{self.item(f'/MeshTags/{name}/Values', values)}</Attribute></Grid>"
        )

    def write(self):
        self.h5.close()
        self.path.write_text(
            '<?xml version="1.0"?>\n<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>\n'
            f'<Xdmf Version="3.0" xmlns:xi="{self.namespace}"><Domain>{"".join(self.grids)}'
            "</Domain></Xdmf>"
        )
        return self.path


NAMESPACES = ["https://www.w3.org/2001/XInclude", "http://www.w3.org/2001/XInclude"]


@pytest.mark.parametrize("namespace", NAMESPACES)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n_steps", [1, 3])
def test_functions_are_on_the_mesh_that_they_include(tmp_path, namespace, dim, n_steps):
    mesh = random_square(15, 5211) if dim == 2 else jittered_cube(3, 5212)
    file = Writer(tmp_path, namespace)
    file.mesh(mesh.points, mesh.cells.astype(np.int64))
    file.function("u", [mesh.points[:, :1] + t for t in range(n_steps)])
    vectors = np.pad(mesh.points, ((0, 0), (0, 3 - dim)))
    file.function("flow", [vectors])
    file.function("eta", [np.arange(mesh.n_cells, dtype=float)[:, None]], "Cell")
    path = file.write()
    if n_steps > 1:
        with pytest.warns(InputWarning, match="of the 3 time steps of 'u' the last is kept"):
            found = read(path)
    else:
        found = read(path)
    assert_array_equal(found.points, mesh.points)
    assert_array_equal(found.cells, mesh.cells)
    assert_array_equal(found.point_data["u"], mesh.points[:, 0] + (n_steps - 1))
    assert_array_equal(found.point_data["flow"], vectors)
    assert_array_equal(found.cell_data["eta"], np.arange(mesh.n_cells))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", [5213, 5214])
def test_tags_are_those_of_their_cells_and_facets(tmp_path, dim, seed):
    mesh = random_square(15, seed) if dim == 2 else jittered_cube(3, seed)
    rng = np.random.default_rng(seed)
    some = rng.permutation(mesh.n_cells)[:9]
    facets = mesh.facets[rng.permutation(len(mesh.facets))[:7]]
    tags, facet_tags = rng.integers(1, 5, 9), rng.integers(1, 5, 7)
    file = Writer(tmp_path, NAMESPACES[0])
    file.mesh(mesh.points, mesh.cells.astype(np.int64))
    file.tags("subdomains", rng.permuted(mesh.cells[some], axis=1).astype(np.int64), tags)
    file.tags("walls", facets.astype(np.int64), facet_tags)
    found = read(file.write())
    wanted = np.zeros(mesh.n_cells, int)
    wanted[some] = tags
    assert_array_equal(found.cell_tags, wanted)
    assert_array_equal(found.tagged_facets, facets)
    assert_array_equal(found.facet_tags, facet_tags)


def test_what_a_pointer_names_is_taken_from_that_grid(tmp_path):
    mesh = random_square(15, 5216)
    values = np.arange(1, 6)
    file = Writer(tmp_path, NAMESPACES[0])
    file.mesh(mesh.points, mesh.cells.astype(np.int64))
    lines = mesh.facets[:5]
    points = file.include("xpointer(/Xdmf/Domain/Grid[@Name='mesh']/Geometry)")
    file.grids.append(
        f'<Grid Name="lines" GridType="Uniform">{points}'
        f"{file.topology('/lines/topology', lines.astype(np.int64))}</Grid>"
    )
    own = file.include("xpointer(/Xdmf/Domain/Grid[@Name='lines']/Topology)")
    file.grids.append(
        f'<Grid Name="walls" GridType="Uniform">{points}{own}'
        '<Attribute Name="walls" AttributeType="Scalar" Center="Cell">'
        f"{file.item('/walls/values', values)}</Attribute></Grid>"
    )
    found = read(file.write())
    assert_array_equal(found.cells, mesh.cells)
    assert_array_equal(found.tagged_facets, lines)
    assert_array_equal(found.facet_tags, values)


def test_several_meshes_are_refused(tmp_path):
    mesh = random_square(15, 5215)
    file = Writer(tmp_path, NAMESPACES[0])
    for name in ("one", "other"):
        file.mesh(mesh.points, mesh.cells.astype(np.int64), name)
    with pytest.raises(MeshFileError, match="holds several meshes \\('one', 'other'\\)"):
        read(file.write())


def test_zones_of_su2_are_refused_in_words(tmp_path):
    (tmp_path / "a.su2").write_text(
        "NZONE= 2\nIZONE= 1\nNDIME= 2\nNELEM= 1\n5 0 1 2\nNPOIN= 3\n0 0\n1 0\n0 1\n"
        "IZONE= 2\nNDIME= 2\nNELEM= 1\n5 0 1 2\nNPOIN= 3\n0 0\n1 0\n0 1\n"
    )
    with pytest.raises(MeshFileError, match="2 zones of SU2"):
        read(tmp_path / "a.su2")
