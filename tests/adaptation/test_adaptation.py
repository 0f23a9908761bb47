"""One cycle of an adaptive loop with generators, and bad input."""

from dataclasses import replace

import numpy as np
import pytest
from adaptive_loops import SEED, indicator, to_circle
from meshes import random_sphere, slit_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from shapes import facet_areas, two_region_block, two_region_rectangle

from adaptsize import SimplexMesh, adapt
from adaptsize.errors import ResolutionWarning

# ---- with generators


@pytest.mark.parametrize("dim", [2, 3])
def test_mmg_keeps_number_fields_tags_and_boundary(dim):
    pytest.importorskip("mmgpy")
    mesh, target = (two_region_rectangle(8), 1500) if dim == 2 else (two_region_block(3), 2000)
    a = np.array([[0.3, 1.0], [-2.0, 0.7], [0.1, 0.4]])[:dim]
    heat = np.random.default_rng(SEED).random(mesh.n_cells)
    result = adapt(
        mesh, indicator(mesh), elements=target, backend="mmg",
        fields={"u": mesh.points @ a}, cell_fields={"heat": heat, "region": mesh.cell_tags},
    )  # fmt: skip
    new = result.mesh
    assert abs(new.n_cells / target - 1.0) <= 0.15
    assert_allclose(result.fields["u"], new.points @ a, atol=1e-12)
    assert_allclose(new.measures @ result.cell_fields["heat"], mesh.measures @ heat, rtol=1e-11)
    assert_array_equal(result.cell_fields["region"], new.cell_tags)
    assert_array_equal(new.point_data["u"], result.fields["u"])
    assert_array_equal(new.cell_data["heat"], result.cell_fields["heat"])
    tags = (30, 31) if dim == 2 else (40, 41, 42)
    assert [facet_areas(new, tag) for tag in tags] == pytest.approx([1.0] * dim, rel=1e-12)
    assert result.report.boundary_distance <= 1e-15 * mesh.diagonal
    assert result.report.lost_tags == ()
    text = str(result)
    for part in (
        "budget met",
        "tags: all kept",
        "field u: projected in bounds",
        "heat: conservative",
    ):
        assert part in text
    if dim == 2:
        once_more = adapt(new, h0=result.size, fields=result.fields)
        assert not once_more.remeshed
        assert once_more.mesh is new


def test_tetrahedra_by_tetwild_within_the_tolerance():
    mesh = two_region_block(2)
    heat = np.random.default_rng(SEED).random(mesh.n_cells)
    result = adapt(mesh, h0=0.35, enough=2.0, backend="tetwild", cell_fields={"heat": heat},
                   keep_integral=True, boundary_tolerance=5e-3)  # fmt: skip
    new, slack = result.mesh, 5e-3 * mesh.diagonal
    assert result.report.backend == "tetwild"
    assert result.report.boundary_distance <= slack
    assert result.report.lost_tags == ()
    assert set(np.unique(new.cell_tags)) == {7, -3}
    assert_allclose(new.measures @ result.cell_fields["heat"], mesh.measures @ heat, rtol=1e-12)


def test_triangles_in_space_are_adapted():
    pytest.importorskip("mmgpy")
    mesh = random_sphere(400, SEED)
    result = adapt(mesh, h0=0.12, backend="mmg", fields={"x": mesh.points}, project=to_circle)
    assert result.remeshed
    assert_allclose(np.linalg.norm(result.mesh.points, axis=1), 1.0, rtol=1e-12)
    assert np.linalg.norm(result.fields["x"] - result.mesh.points, axis=1).max() < 0.2


def test_a_slit_stays_one_and_values_stay_on_their_sides():
    pytest.importorskip("mmgpy")
    mesh = slit_square(12)
    middle = mesh.points[mesh.cells].mean(axis=1)
    upper = np.zeros(mesh.n_points)
    upper[mesh.cells[(middle > 0.0).all(axis=1)]] = 1.0
    result = adapt(
        mesh, indicator(mesh), elements=1500, fields={"upper": upper}, method="interpolate"
    )
    new = result.mesh
    assert new.boundary().mesh.measures.sum() == pytest.approx(8.0 + 2.0, rel=1e-12)
    on_slit = (np.abs(new.points[:, 1]) < 1e-12) & (new.points[:, 0] > 0.2)
    above = np.zeros(new.n_points, bool)
    above[new.cells[new.points[new.cells].mean(axis=1)[:, 1] > 0.0]] = True
    assert_allclose(result.fields["upper"][on_slit], above[on_slit], atol=1e-6)


# ---- bad input and warnings


MESH = structured_square(3, half_width=1.0)
ETA = np.ones(MESH.n_cells)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "indicator or h0 must be given, got neither"),
        ({"indicator": ETA}, "an indicator needs tolerance, elements or nodes, got none"),
        ({"h0": 0.1, "tolerance": 1.0}, "tolerance needs an indicator"),
        ({"h0": np.full(16, np.inf)}, "h0 must be finite at one node at least"),
        ({"h0": np.full(16, np.inf), "g": None}, "must be finite after limiting"),
        ({"h0": 0.1, "backend": "tetwild"}, "backend 'tetwild' cannot make this mesh"),
        ({"h0": 0.1, "cell_fields": {"q": np.full(18, np.nan)}}, r"cell_fields\['q'\] must be"),
        ({"h0": 0.1, "project": {1: "wall"}}, "project must be a callable .* mapping"),
        ({"h0": 0.1, "project": {"wall": to_circle}}, r"tags of facets of the mesh \(none\)"),
    ],
)
def test_bad_arguments_are_named_before_any_work(generator, arguments, message):
    with pytest.raises(ValueError, match=message):
        adapt(MESH, **arguments)
    assert generator.calls == 0


def test_wrong_meshes_are_refused():
    with pytest.raises(ValueError, match="mesh must be a SimplexMesh of triangles or tetra"):
        adapt(SimplexMesh([[0.0], [1.0]], [[0, 1]]), h0=0.1)
    with pytest.raises(ValueError, match=r"mesh must be a SimplexMesh or a PartitionedMesh, got"):
        adapt("mesh.vtu", h0=0.1)
    sphere = random_sphere(30, SEED)
    with pytest.raises(ValueError, match="conservative must be False for triangles in space"):
        adapt(sphere, h0=0.1, cell_fields={"q": sphere.measures})


@pytest.mark.parametrize(("h", "n_cells"), [(0.3, 1), (0.3, 12), (0.1, 1)])
def test_tags_vanish_only_with_parts_that_are_narrower_than_the_sizes(generator, h, n_cells):
    order = MESH.points[MESH.cells].mean(axis=1)[:, 0].argsort()  # columns from the left
    tags = np.zeros(MESH.n_cells, int)
    tags[order[:n_cells]] = 1
    tagged = SimplexMesh(MESH.points, MESH.cells, cell_tags=tags)
    is_narrow = h == 0.3 and n_cells == 1  # triangles of width .195
    text = "has lost cell tag 1: parts smaller" if is_narrow else "cell tag 1, though not for its"
    with pytest.warns(ResolutionWarning, match=text) as caught:
        result = adapt(tagged, h0=h)
    assert len([one for one in caught if "has lost" in str(one.message)]) == 1
    assert result.report.lost_tags == ("cell tag 1",)
    assert result.report.dropped_tags == (() if is_narrow else ("cell tag 1",))
    assert "tags lost: cell tag 1" in str(result)


def test_tagged_lines_inside_a_region_are_not_lost_in_a_loop():
    pytest.importorskip("mmgpy")
    mesh = structured_square(8, half_width=1.0)
    on_line = (mesh.points[mesh.edges][:, :, 1] == 0.0).all(axis=1)
    line = mesh.edges[on_line & (np.abs(mesh.points[mesh.edges]).max(axis=(1, 2)) < 0.6)]
    mesh = replace(mesh, tagged_facets=line, facet_tags=np.full(len(line), 3))
    for h in (0.1, 0.3):
        mesh = adapt(mesh, h0=h).mesh
        assert facet_areas(mesh, 3) == pytest.approx(1.0, rel=1e-9)
