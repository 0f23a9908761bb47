"""The requirements on a mesh: each is missed by a mesh made to miss it, and by no other."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import random_sphere
from numpy.testing import assert_array_equal
from shapes import block, joined, moved

from adaptsize import SimplexMesh, check_mesh
from adaptsize.background.simplex import cut_out
from adaptsize.quality.by_place import is_in_band
from adaptsize.quality.certificate import LEAST_ANGLE
from adaptsize.quality.conformity import edge_ratios
from adaptsize.quality.walls import across_walls

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
CUBE = block(2)


def without_cells(mesh, keep):
    return SimplexMesh(mesh.points, mesh.cells[keep(mesh.points[mesh.cells].mean(axis=1))])


def missed(mesh, **arguments):
    return [requirement.name for requirement in check_mesh(mesh, **arguments).failures]


@pytest.mark.parametrize("mesh", [SQUARE, CUBE, CUBE.boundary().mesh])
def test_a_mesh_meets_all_requirements_of_itself(mesh):
    check = check_mesh(mesh, original=mesh, size=np.median(mesh.edge_lengths), tolerance=1e-9)
    assert check.is_met, check
    assert [requirement.name for requirement in check.requirements if requirement.places] == []


def test_a_volume_mesh_is_compared_with_the_surface_that_it_fills():
    surface = CUBE.boundary().mesh
    assert check_mesh(CUBE, original=surface).is_met
    assert check_mesh(moved(CUBE, 0.01), original=surface, tolerance=0.02).is_met
    assert missed(moved(CUBE, 0.01), original=surface, tolerance=1e-3) == ["boundary"]


def test_inverted_cells_are_listed_with_their_places():
    cells = CUBE.cells.copy()
    cells[[3, 7], :2] = cells[[3, 7], 1::-1]
    check = check_mesh(SimplexMesh(CUBE.points, cells))
    (requirement,) = check.failures
    assert requirement.name == "cells"
    assert requirement.text == f"2 of {CUBE.n_cells} inverted or flat"
    centroids = CUBE.points[CUBE.cells[[3, 7]]].mean(axis=1)
    assert sorted(place.point for place in requirement.places) == sorted(
        map(tuple, centroids.tolist())
    )
    assert all(place.value < 0.0 for place in requirement.places)


def test_a_facet_of_three_cells_is_a_fault():
    points = np.vstack([np.zeros(3), np.eye(3), [-1, 0, 0], [-2, -1, 0]])
    fan = SimplexMesh(points, [[0, 1, 2, 3], [0, 2, 4, 3], [0, 2, 5, 3]])
    (requirement,) = check_mesh(fan).failures
    assert requirement.name == "facets"
    assert requirement.places[0].point == (0.0, 1 / 3, 1 / 3)
    assert requirement.places[0].value == 3.0


def test_edges_of_three_triangles_are_no_fault_of_a_surface():
    sheets = SimplexMesh(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    )
    assert [requirement.name for requirement in check_mesh(sheets).requirements] == ["cells"]


def test_a_missing_piece_and_a_lost_component_are_noticed():
    two = joined(CUBE, moved(CUBE, [3.0, 0.0, 0.0]))
    assert missed(CUBE, original=two) == ["boundary", "measure", "topology"]
    # Whatever is smaller than the tolerance is not missed by distance, but by topology.
    speck = joined(CUBE, moved(CUBE, [0.5, 0.5, 1.002], scale=1e-3))
    assert missed(CUBE, original=speck, tolerance=5e-3) == ["topology"]


@pytest.mark.parametrize(
    ("n_axes", "text"),
    [(2, "1 component(s) with Euler number 0"), (3, "2 component(s) with Euler number 4")],
)
def test_a_handle_and_a_cavity_change_the_topology(n_axes, text):
    solid = block(3)
    other = without_cells(solid, lambda c: (np.abs(c[:, :n_axes] - 0.5) > 1 / 6).any(axis=1))
    failures = check_mesh(other, original=solid).failures
    assert [requirement.name for requirement in failures] == ["boundary", "measure", "topology"]
    assert failures[-1].text == f"{text}; original: 1 component(s) with Euler number 2"


def test_a_volume_is_compared_within_what_the_tolerance_allows():
    sphere = random_sphere(400, 7331)
    diagonal, area = sphere.diagonal, sphere.measures.sum()
    for move, tolerance, failures in [(1e-3, 1.1e-3, []), (1e-2, 1e-3, ["boundary", "measure"])]:
        larger = moved(sphere, 0.0, scale=1.0 + move * diagonal)
        assert missed(larger, original=sphere, tolerance=tolerance) == failures
    # In all directions by d: the distance is at most d, and d at nodes.
    d = 1e-3 * diagonal
    check = check_mesh(moved(sphere, 0.0, scale=1.0 + d), original=sphere, tolerance=0.9)
    volume = np.linalg.det(sphere.points[sphere.cells]).sum() / 6.0
    text = next(
        requirement.text for requirement in check.requirements if requirement.name == "measure"
    )
    change, allowed = (float(part.split("%")[0]) / 100 for part in text.split("by ")[1].split(", "))
    assert change == pytest.approx((1.0 + d) ** 3 - 1.0, rel=5e-3)
    assert allowed == pytest.approx(2.0 * d * area / volume, rel=0.05)


def test_edges_off_their_size_are_a_fault_with_the_worst_places():
    check = check_mesh(SQUARE, size=1.0, share_in_band=1.0)
    assert check.is_met
    check = check_mesh(SQUARE, size=lambda x: np.where(x[:, 1] > 0.9, 0.1, 1.0), share_in_band=0.9)
    requirement, served = check.failures
    assert served.name == "served"
    assert requirement.text == "80.0% within a factor sqrt 2 of the size, 90% required"
    assert requirement.places[0].point == (0.5, 1.0)
    assert requirement.places[0].value == pytest.approx(10.0)


def sheet(thickness):
    """One layer of cells with edges of 1/8 along both sides."""
    whole = block(8)
    layer = (whole.points[whole.cells][:, :, 2] <= 0.125).all(axis=1)
    part, _ = cut_out(whole.points * [1.0, 1.0, 8.0 * thickness], whole.cells[layer])
    return part


def edges_of_check(mesh, size):
    check = check_mesh(mesh, size=size, share_in_band=0.93)
    return next(one for one in check.requirements if one.name == "edges")


def test_edges_across_a_wall_thinner_than_the_size_do_not_count():
    thin, size = sheet(0.02), 0.15
    found = edges_of_check(thin, size)
    assert found.status == "met"
    assert "; without " in found.text
    assert is_in_band(edge_ratios(thin, size)).mean() < 0.9
    # Those that are too long do, and so do short edges along the sides.
    for mesh, size in ((sheet(0.5), 0.15), (thin, 0.3)):
        assert edges_of_check(mesh, size).status == "missed"


def test_across_walls_are_edges_between_opposite_sides():
    thin = sheet(0.02)
    across = across_walls(thin)
    ends = thin.points[thin.edges]
    is_inside = ((ends[:, :, :2] > 0.0) & (ends[:, :, :2] < 1.0)).all(axis=(1, 2))
    from_below = ends[:, 0, 2] != ends[:, 1, 2]
    assert_array_equal(across[is_inside], from_below[is_inside])
    assert not across_walls(thin.boundary().mesh).any()
    assert not across_walls(block(2))[np.isclose(block(2).edge_lengths, 0.5)].any()


def test_of_an_open_surface_only_its_own_distance_counts():
    surface = CUBE.boundary().mesh
    lid = surface.points[surface.cells][..., 2].min(axis=1) == 1.0
    opened = SimplexMesh(surface.points, surface.cells[~lid])
    check = check_mesh(CUBE, original=opened)
    assert check.is_met
    assert [requirement.name for requirement in check.requirements] == [
        "cells",
        "facets",
        "overlaps",
        "boundary",
    ]
    assert len(check.notes) == 2


def test_the_volume_of_an_inconsistently_oriented_surface_is_compared():
    surface = CUBE.boundary().mesh
    cells = surface.cells.copy()
    cells[0, :2] = cells[0, 1::-1]
    flipped = SimplexMesh(surface.points, cells)
    check = check_mesh(CUBE, original=flipped)
    assert check.is_met
    assert "measure" in [requirement.name for requirement in check.requirements]
    assert "measure" in missed(moved(CUBE, 0.0, scale=1.1), original=flipped)
    # No orientation is repaired where a surface is compared with a surface.
    check = check_mesh(surface, original=flipped)
    assert "not consistently oriented" in check.notes[0]


def test_a_mesh_is_compared_with_the_union_of_bodies():
    boxes = [moved(CUBE, shift) for shift in (0.0, [0.3, 0.0, 0.0])]
    surface = joined(*(box.boundary().mesh for box in boxes))
    union = SimplexMesh(CUBE.points * [1.3, 1.0, 1.0], CUBE.cells)
    check = check_mesh(union, original=surface)
    assert check.is_met
    assert "topology" in [requirement.name for requirement in check.requirements]
    (measure,) = (
        requirement for requirement in check.requirements if requirement.name == "measure"
    )
    assert float(measure.text.split("by ")[1].split("%")[0]) == pytest.approx(0.0, abs=1e-9)
    check = check_mesh(joined(*boxes), original=surface)
    assert [requirement.name for requirement in check.failures] == [
        "overlaps", "boundary", "measure", "topology",
    ]  # fmt: skip
    assert "cells overlap others, by a volume of 0.7" in check.failures[0].text


def test_facets_inside_of_the_original_are_not_compared():
    core = moved(CUBE, 0.3, scale=0.4).boundary().mesh
    half = SimplexMesh(CUBE.points * [0.5, 1.0, 1.0], CUBE.cells).boundary().mesh
    halves = joined(half, moved(half, [0.5, 0.0, 0.0]))
    for surface in (joined(CUBE.boundary().mesh, core), halves):
        check = check_mesh(CUBE, original=surface)
        assert check.is_met
        assert "facets of the original are inside of it" in check.notes[0]


def test_edges_between_coincident_nodes_are_the_worst():
    points = [*SQUARE.points, SQUARE.points[2]]
    mesh = SimplexMesh(points, [*SQUARE.cells, [1, 2, 4]])
    requirement = next(d for d in check_mesh(mesh, size=5.0).failures if d.name == "edges")
    assert requirement.places[0].point == (1.0, 1.0)
    assert requirement.places[0].value == 0.0


def test_cells_that_fill_a_thin_plate_twice_are_noticed_at_a_tolerance_of_its_thickness():
    plate = SimplexMesh(CUBE.points * [1.0, 1.0, 0.01], CUBE.cells)
    assert missed(joined(plate, plate), original=plate, tolerance=0.01) == [
        "overlaps",
        "measure",
        "topology",
    ]


def with_tagged_sides(mesh):
    """Return a unit cube with its sides x = 0 and x = 1 tagged 4 and 5, and the sheet x = .5, 6."""
    x = mesh.points[mesh.facets][:, :, 0]
    sides = [mesh.facets[(np.abs(x - at) < 1e-9).all(axis=1)] for at in (0.0, 1.0, 0.5)]
    return SimplexMesh(
        mesh.points,
        mesh.cells,
        tagged_facets=np.concatenate(sides),
        facet_tags=np.repeat([4, 5, 6], [len(side) for side in sides]),
        tag_names={(2, 6): "sheet"},
    )


@pytest.mark.parametrize("scale", [1e-3, 7.0])
def test_tags_of_facets_that_vanish_or_change_their_place_are_noticed(scale):
    old = with_tagged_sides(CUBE)
    old = old.moved(scale * old.points)
    (tags,) = [one for one in check_mesh(old, original=old).requirements if one.name == "tags"]
    assert (tags.is_met, tags.value) == (True, 0.0)
    kept = old.facet_tags != 6
    lost = replace(old, tagged_facets=old.tagged_facets[kept], facet_tags=old.facet_tags[kept])
    (failure,) = check_mesh(lost, original=old).failures
    assert (failure.name, failure.text) == ("tags", '1 of 3 missing: 6 "sheet"')
    bare = replace(old, tagged_facets=None, facet_tags=None)
    (failure,) = check_mesh(bare, original=old).failures
    assert failure.text == '3 of 3 missing: 4, 5, 6 "sheet"'
    assert check_mesh(old, original=bare).is_met  # more tags than before are no fault
    swapped = replace(old, facet_tags=np.where(old.facet_tags == 6, 6, 9 - old.facet_tags))
    (failure,) = check_mesh(swapped, original=old).failures
    assert failure.value == pytest.approx(1.0 / np.sqrt(3.0))
    assert failure.text.startswith(f"3; 4 within {scale:.3g} (0.577 of the diagonal)")
    assert failure.places[0].value == pytest.approx(scale)


def test_tags_of_a_surface_are_compared_with_those_of_the_boundary_of_its_volume():
    volume = with_tagged_sides(CUBE)
    skin = CUBE.boundary().mesh
    x = skin.points[skin.cells][:, :, 0]
    left, right = ((x == at).all(axis=1) for at in (0.0, 1.0))
    surface = replace(skin, cell_tags=np.where(left, 4, np.where(right, 5, 8)))
    (failure,) = check_mesh(volume, original=surface).failures
    assert failure.text == "1 of 3 missing: 8"
    surface = replace(skin, cell_tags=np.where(left, 4, 5))
    (failure,) = check_mesh(volume, original=surface).failures
    assert failure.text.startswith("2; 5 within 1 (0.577 of the diagonal)")
    check = check_mesh(CUBE, original=surface)
    assert check.is_met
    assert check.notes == ("tags of the surface are not compared: the mesh has none",)
    edges = skin.edges[(np.abs(skin.points[skin.edges][:, :, :2]) < 1e-9).all(axis=(1, 2))]
    rims = replace(skin, tagged_facets=edges, facet_tags=np.full(len(edges), 3))
    assert check_mesh(rims, original=rims).is_met
    assert missed(skin, original=rims) == ["tags"]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0])
@pytest.mark.parametrize(
    ("move", "status"),
    [
        (0.99, "met"),
        (1.0, "met"),
        (1.05, "near"),
        (1.09, "near"),
        (1.11, "missed"),
        (1.2, "missed"),
    ],
)
def test_a_boundary_beyond_the_tolerance_by_a_tenth_of_it_is_near(move, status, scale):
    surface = CUBE.boundary().mesh
    surface = surface.moved(scale * surface.points)
    tolerance = 0.01
    shift = [0.0, 0.0, move * tolerance * surface.diagonal]
    check = check_mesh(
        SimplexMesh(scale * CUBE.points + shift, CUBE.cells), original=surface, tolerance=tolerance
    )
    boundary = next(
        requirement for requirement in check.requirements if requirement.name == "boundary"
    )
    assert (boundary.status, check.status) == (status, status)
    assert check.is_met == boundary.is_met == (status == "met")
    assert (boundary.value, boundary.limit) == pytest.approx((move * tolerance, tolerance))
    assert [requirement.name for requirement in check.missed] == ["boundary"] * (status == "missed")
    assert [requirement.name for requirement in check.failures] == ["boundary"] * (status != "met")
    assert bool(boundary.places) == (status != "met")
    (row,) = (one for one in check.as_dict()["requirements"] if one["name"] == "boundary")
    assert (row["status"], row["is_met"]) == (status, status == "met")
    assert f"boundary  {'MISSED' if status == 'missed' else status}" in str(check)


@pytest.mark.parametrize(
    ("change", "status"),
    [(0.0049, "met"), (-0.0049, "met"), (-0.0053, "near"), (0.0056, "missed"), (-0.02, "missed")],
)
def test_the_volume_is_a_requirement_of_half_a_percent_where_the_tolerance_explains_less(
    change, status
):
    # A slab is made thicker, which the tolerance does not explain: it is far smaller.
    slab = block(2)
    mesh = slab.moved(slab.points * [1.0, 1.0, 1.0 + change])
    check = check_mesh(mesh, original=slab.boundary().mesh, tolerance=1e-6)
    measure = next(
        requirement for requirement in check.requirements if requirement.name == "measure"
    )
    assert measure.status == status
    assert (measure.value, measure.limit) == pytest.approx((change, 0.005))
    assert "by the tolerance" not in measure.text


def test_a_larger_change_of_the_volume_is_allowed_where_the_tolerance_explains_it():
    # A plate of .05 whose sides both move by the tolerance: 4 % more volume.
    plate = CUBE.moved(CUBE.points * [1.0, 1.0, 0.05])
    thicker = CUBE.moved(CUBE.points * [1.0, 1.0, 0.052] - [0.0, 0.0, 0.001])
    check = check_mesh(thicker, original=plate, tolerance=1e-3 / plate.diagonal)
    measure = next(
        requirement for requirement in check.requirements if requirement.name == "measure"
    )
    assert measure.is_met
    assert measure.value == pytest.approx(0.04)
    assert measure.text.endswith("allowed by the tolerance")
    # Of a plate ten times as thick, half of a percent is allowed, and more is missed.
    block_ = CUBE.moved(CUBE.points * [1.0, 1.0, 0.5])
    other = CUBE.moved(CUBE.points * [1.0, 1.0, 0.51])
    assert "measure" in missed(other, original=block_, tolerance=1e-3)


@pytest.mark.parametrize(
    ("required", "status"), [(0.8, "met"), (0.85, "near"), (0.88, "near"), (0.9, "missed")]
)
def test_shares_of_at_least_nine_tenths_of_the_required_ones_are_near(required, status):
    def size(x):  # that of four of the five edges
        return np.where(x[:, 1] > 0.9, 0.1, 1.0)

    check = check_mesh(SQUARE, size=size, share_in_band=required, share_served=0.0)
    edges = next(requirement for requirement in check.requirements if requirement.name == "edges")
    assert (edges.status, edges.value, edges.limit) == (status, pytest.approx(0.8), required)


def test_faults_that_have_no_degree_are_missed():
    two = joined(CUBE, moved(CUBE, [0.5, 0.5, 1.002], scale=1e-3))
    check = check_mesh(CUBE, original=two, tolerance=5e-3)
    assert [(requirement.name, requirement.status) for requirement in check.failures] == [
        ("topology", "missed")
    ]
    assert check.missed[0].value is None


def flattened(mesh, middle, top):
    """Return a mesh with the node at ``middle`` moved to ``top``."""
    points = mesh.points.copy()
    points[(points == middle).all(axis=1)] = top
    return mesh.moved(points)


FLAT = flattened(CUBE, [0.5, 0.5, 0.5], [0.5, 0.5, 0.98])


def test_tetrahedra_with_small_dihedral_angles_are_missed_with_number_least_and_place():
    check = check_mesh(FLAT, original=CUBE, size=0.5)
    angles = check.requirements[-1]
    below = FLAT.minimum_angles() < LEAST_ANGLE
    least = FLAT.minimum_angles().min()
    assert (angles.name, angles.status) == ("angles", "missed")
    assert angles.text == f"{below.sum()} of {FLAT.n_cells} below 5 degrees, the least {least:.2g}"
    assert angles.places[0].value == pytest.approx(least)
    centroids = FLAT.points[FLAT.cells[below]].mean(axis=1)
    assert all(np.isclose(centroids, place.point).all(axis=1).any() for place in angles.places)
    assert check.status == "missed"
    assert "angles" not in missed(CUBE, original=CUBE, size=0.5)


def test_small_angles_are_no_fault_of_cells_without_sizes_nor_of_triangles():
    assert missed(FLAT, original=CUBE) == []
    flat = SimplexMesh([[0, 0], [1, 0], [0.5, 1e-2]], [[0, 1, 2]])
    assert "angles" not in missed(flat, size=1.0)


@pytest.mark.parametrize(
    ("angle", "tolerance", "status"),
    [(3.0, 1e-3, "met"), (4.9, 1e-3, "met"), (10.0, 1e-3, "missed"), (3.0, 1.0, "missed")],
)
def test_small_angles_that_the_domain_has_are_met_unless_the_tolerance_hides_them(
    angle, tolerance, status
):
    height = np.tan(np.radians(angle))
    triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, height, 0.0]])
    points = np.vstack([triangle, triangle + np.array([0.0, 0.0, 1.0])])
    inside = np.array([0.01, 0.33, 0.33, 0.33]) @ points[:4]  # close to a facet
    cells = [[1, 2, 3, 4], [2, 3, 4, 5]] + [np.r_[np.delete(range(4), i), 6] for i in range(4)]
    wedge = SimplexMesh(np.vstack([points, inside]), cells)
    for original in (wedge, wedge.boundary().mesh):
        check = check_mesh(wedge, original=original, size=0.5, tolerance=tolerance)
        assert wedge.minimum_angles().min() < LEAST_ANGLE
        angles = next(one for one in check.requirements if one.name == "angles")
        assert angles.status == status
        assert ("facets of the original meet" in angles.text) == (status == "met")
