"""Unknowns, memory and parts before there is a mesh, against assembled matrices and real meshes."""

import numpy as np
import pytest
import skfem
from command_line import call
from numpy.testing import assert_allclose
from skfem.helpers import dot

from adaptsize import PointSource, SimplexMesh, read, remesh, size_function, write
from adaptsize.domain_size.unknowns import matrix_of, nonzeros_of, unknowns_of, unknowns_on
from adaptsize.sizes import predict
from adaptsize.sizes.prediction import Prediction

ELEMENTS = {
    (2, 1): skfem.ElementTriP1, (2, 2): skfem.ElementTriP2, (2, 3): skfem.ElementTriP3,
    (3, 1): skfem.ElementTetP1, (3, 2): skfem.ElementTetP2,
}  # fmt: skip


def mass_matrix(mesh, element, fields):
    """The matrix of scikit-fem, all fields coupled; coinciding fields make no entry zero."""
    if fields == 1:
        return skfem.BilinearForm(lambda u, v, w: u * v).assemble(skfem.Basis(mesh, element))
    basis = skfem.Basis(mesh, skfem.ElementVector(element, fields))

    def coupled(u, v, w):
        return dot(u, v) + 0.5 * sum(u) * sum(v)

    return skfem.BilinearForm(coupled).assemble(basis)


@pytest.mark.parametrize(("dim", "degree"), list(ELEMENTS))
@pytest.mark.parametrize("is_vector", [False, True])
def test_unknowns_and_memory_are_those_of_an_assembled_matrix(dim, degree, is_vector):
    fields = dim if is_vector else 1
    mesh = skfem.MeshTri().refined(3) if dim == 2 else skfem.MeshTet().refined(2)
    matrix = mass_matrix(mesh, ELEMENTS[dim, degree](), fields)
    inner = [mesh.edges.shape[1]] if dim == 3 else []
    simplices = [mesh.nvertices, *inner, mesh.facets.shape[1], mesh.nelements]
    assert fields * unknowns_of(simplices, degree) == matrix.shape[0]
    nonzeros = fields**2 * nonzeros_of(simplices, degree)
    assert nonzeros == matrix.nnz
    boundary = len(mesh.boundary_facets())
    predicted = Prediction(mesh.nelements, boundary, mesh.nvertices)
    found = matrix_of(dim, predicted, degree, fields)
    used = matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes
    # In space, Euler's constant is left out: one edge.
    assert_allclose(found, [matrix.shape[0], used], rtol=0 if dim == 2 else 2e-3)


def disc(n=80):
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    k = np.arange(n)
    cells = np.column_stack([np.full(n, n), k, (k + 1) % n])
    facets = np.column_stack([k, (k + 1) % n])
    mesh = SimplexMesh(
        [*rim, [0, 0]], cells, tagged_facets=facets, facet_tags=1 + (k >= n // 2),
        tag_names={(1, 1): "upper", (1, 2): "lower"},
    )  # fmt: skip
    return remesh(mesh, size_function(mesh, hmax=0.1), tolerance=1e-3)


def test_a_requested_number_of_unknowns_is_that_of_the_mesh():
    size = size_function(disc(), dofs=20_000, degree=2, components=2)
    assert_allclose(size.cost(degree=2, components=2).n_unknowns, 20_000, rtol=0.02)


def test_the_command_makes_a_mesh_with_the_requested_number_of_unknowns(tmp_path):
    write(tmp_path / "disc.vtu", disc())
    words = ["--dofs", "20000", "--degree", "2", "--components", "2"]
    assert call("remesh", tmp_path / "disc.vtu", "-o", tmp_path / "new.vtu", *words) == 0
    assert_allclose(unknowns_on(read(tmp_path / "new.vtu"), 2, 2), 20_000, rtol=0.05)


def test_a_larger_memory_allows_smaller_sizes_up_to_that_memory():
    sizes = [size_function(disc(), max_memory=m, degree=2, hmin=1e-4) for m in ("50kB", "0.2MB")]
    used = [size.cost(degree=2).matrix_bytes for size in sizes]
    assert used[0] < 1.03 * 50e3 < used[1] < 1.03 * 200e3
    with pytest.raises(ValueError, match=r"such as .8GB. .*got '8 apples'"):
        size_function(disc(), max_memory="8 apples")
    with pytest.raises(ValueError, match="dofs and max_memory exclude each other"):
        size_function(disc(), max_memory="8GB", dofs=1000)


def test_faces_of_a_disc_have_its_radius_and_half_of_the_elements_each():
    size = size_function(disc(), elements_per_radian=8.0, tolerance=np.inf)
    upper, lower = size.parts(speed=2.0)
    assert (upper.name, lower.name) == ("upper", "lower")
    assert_allclose(upper.measure, np.pi, rtol=1e-2)
    assert_allclose([upper.radius, lower.radius], 1.0, rtol=0.03)
    assert_allclose(upper.tolerance, upper.size**2 / 6 / upper.radius)
    assert upper.time_step == upper.size / 2.0
    assert_allclose(upper.element_share, lower.element_share, rtol=0.1)
    assert upper.element_share + lower.element_share <= 1.0


def strip():
    """A strip of height 1 and length 8 with a region and a named end."""
    x, y = np.meshgrid(np.linspace(0, 8, 65), np.linspace(0, 1, 9), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    corner = (np.arange(64)[:, None] * 9 + np.arange(8)).ravel()
    cells = np.concatenate(
        [np.column_stack([corner, corner + 9, corner + 10]),
         np.column_stack([corner, corner + 10, corner + 1])]
    )  # fmt: skip
    tags = 1 + (points[cells].mean(axis=1)[:, 0] > 6.0)
    end = np.column_stack([np.arange(8), np.arange(8) + 1])
    return SimplexMesh(
        points, cells, cell_tags=tags, tagged_facets=end, facet_tags=np.full(8, 5),
        tag_names={(2, 1): "long", (2, 2): "short", (1, 5): "inlet"},
    )  # fmt: skip


def test_regions_have_the_width_of_the_strip_and_share_all_elements():
    size = size_function(strip(), hmax=0.5, elements_per_radian=0.0, elements_between=0.0)
    long, short, inlet = size.parts()
    assert_allclose([long.width, short.width, inlet.width], 1.0, rtol=1e-9)
    assert_allclose([long.measure, short.measure, inlet.measure], [6.0, 2.0, 1.0])
    assert_allclose(long.element_share + short.element_share, 1.0)
    assert_allclose(long.element_share, 0.75, rtol=1e-6)


def test_parts_are_shown_as_a_table_with_a_row_for_each():
    parts = size_function(strip(), hmax=0.5).parts()
    head, *rows = repr(parts).splitlines()
    assert head.split()[:2] == ["part", "measure"]
    assert [row.split()[:2] for row in rows] == [
        [part.name, f"{part.measure:.4g}"] for part in parts
    ]
    assert str(parts) == repr(parts)


def test_shares_of_regions_are_those_of_predicted_elements():
    source = PointSource([0.3, 0.5], 0.004)
    size = size_function(strip(), sources=[source], elements_per_radian=0.0, hmax=2.0, g=1.0)
    mesh, h = size.background, size.values
    assert (h[mesh.cells].max(axis=1) > 1.4 * h[mesh.cells].min(axis=1)).any()
    long = SimplexMesh(mesh.points, mesh.cells[mesh.cell_tags == 1])
    expected = predict(long, h).cells / predict(mesh, h).cells
    assert_allclose(size.parts()[0].element_share, expected, rtol=1e-12)


def test_a_prescribed_size_of_a_part_replaces_that_of_its_shape_and_no_other():
    plain = size_function(strip(), hmax=2.0)
    freed = size_function(strip(), hmax=2.0, size_of={"short": 2.0, "inlet": 0.05})
    x = strip().points[:, 0]
    assert plain.values[x == 8.0].max() < 0.6
    # The width of the other region still acts at x = 6, from where sizes grow by g.
    assert_allclose(freed.values[x == 8.0].max(), 0.5 + 0.25 * np.hypot(2, 0), rtol=0.1)
    assert_allclose(freed.values[x == 0.0], 0.05)
    assert freed.report.bounds["width"][x == 3.0] == pytest.approx(
        plain.report.bounds["width"][x == 3.0]
    )
    with pytest.raises(ValueError, match=r"size_of must name parts among .*long, short.*; got 'x'"):
        size_function(strip(), size_of={"x": 1.0})
    with pytest.raises(ValueError, match=r"size_of must name each part once, got \[1, '1'\]"):
        size_function(strip(), size_of={1: 0.1, "1": 0.2})


def test_the_five_smallest_places_are_apart_and_name_their_bound():
    size = size_function(strip(), hmax=0.5, size_of={"inlet": 0.01})
    cost = size.cost(speed=340.0)
    first, second = cost.places[:2]
    assert (first.size, first.bound) == (0.01, "size_of")
    assert first.point[0] == 0.0
    assert np.hypot(*np.subtract(second.point, first.point)) > 0.05 * strip().diagonal
    assert cost.time_step == 0.01 / 340.0
    assert sum(cost.element_shares.values()) == pytest.approx(1.0)
    lines = str(cost).splitlines()
    assert [line.partition(" costs ")[0] for line in lines[1:3]] == sorted(
        cost.element_shares, key=cost.element_shares.__getitem__, reverse=True
    )
    assert lines[3] == f"size 0.01 at ({', '.join(f'{x:.4g}' for x in first.point)}), from size_of"
