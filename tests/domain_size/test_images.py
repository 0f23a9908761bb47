"""From images to sizes and meshes."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize import PointSource, mesh_image, size_function
from adaptsize.background import Image
from adaptsize.errors import InputWarning, TooManyElementsError

SHAPE = (100, 80)


def disc(radius, centre=(50.3, 39.6), shape=SHAPE):
    x, y = np.indices(shape)
    return np.hypot(x - centre[0], y - centre[1]) < radius


def block(*part, shape=(40, 30)):
    image = np.zeros(shape, bool)
    image[part] = True
    return image


def voxels(radius, n=24):
    return np.linalg.norm(np.indices((n, n, n)) - 0.5 * (n - 1), axis=0) < radius


def boundary_points(mesh):
    return mesh.points[mesh.boundary().nodes]


# --- sizes ------------------------------------------------------------------------


def test_point_sources_leave_the_scheme_of_voxels_as_it_is():
    options = {"elements_per_radian": 0.0, "elements_across": 0.0, "hmax": 6.0, "g": 0.3}
    free = size_function(voxels(9.0), **options)
    place = np.array([[10.0, 11.0, 12.0]])  # a node: bounds between nodes act on those around
    size = size_function(voxels(9.0), sources=[PointSource(place, 0.5)], **options)
    assert size.report.info.method == free.report.info.method == "fast-marching"
    assert size(place)[0] == pytest.approx(0.5)
    beside = place + np.array([[4.0, 0.0, 0.0], [0.0, -3.0, 2.0]])
    # Marching from one node is 6 % too large after four steps, and relatively less beyond.
    exact = 0.5 + 0.3 * np.linalg.norm(beside - place, axis=1)
    assert_allclose(size(beside), exact, rtol=0.07)
    assert (size(beside) >= exact * (1.0 - 1e-9)).all()
    assert size.report.smallest["sources"] == pytest.approx(0.5)
    assert size.report.domain_shares["sources"] > 0.1


@pytest.mark.parametrize("radius", [10.0, 20.0, 35.0])
@pytest.mark.parametrize("centre", [(50.0, 40.0), (50.3, 39.6), (49.77, 40.5)])
def test_sizes_on_a_disc_are_its_radius_over_k_but_for_the_ripples_of_pixels(radius, centre):
    size = size_function(
        disc(radius, centre), elements_per_radian=2.0, elements_across=0.0, hmin=0.1, hmax=100.0
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    h = size(np.array(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    # The boundary is off by up to a quarter of a pixel over waves of some 10 pixels.
    assert h.min() > 0.6 * radius / 2.0
    assert h.max() < 1.2 * radius / 2.0


def test_a_bar_has_so_many_elements_across():
    bar = block(slice(10, 90), slice(30, 50), shape=SHAPE)  # 20 pixels wide
    size = size_function(bar, elements_per_radian=0.0, elements_across=4.0, hmax=99.0)
    y = np.linspace(31.0, 48.0, 7)
    # Half the width is 10, to half a pixel.
    assert_allclose(size(np.column_stack([np.full(7, 50.0), y])), 5.0, atol=0.25)


# --- what belongs to the objects --------------------------------------------------


def test_bars_of_three_pixels_stay_and_lines_of_two_go():
    image = block(slice(5, 35), slice(5, 8)) | block(slice(5, 35), slice(15, 17))
    with pytest.warns(
        InputWarning, match=r"smoothing removes 1 of 2 objects, the largest of 60 pixels"
    ):
        mesh = mesh_image(image, hmin=1.0)
    assert mesh.points[:, 1].max() < 9.0
    assert mesh.points[:, 0].max() > 32.0


def test_labels_choose_objects_and_become_regions():
    labels = np.where(disc(15.0, (25.0, 40.0)), 3, 0) + np.where(disc(20.0, (70.0, 40.0)), 7, 0)
    mesh = mesh_image(labels)
    assert sorted(set(mesh.cell_tags)) == [3, 7]
    areas = [mesh.measures[mesh.cell_tags == k].sum() for k in (3, 7)]
    assert_allclose(areas, np.pi * np.array([15.0, 20.0]) ** 2, rtol=0.03)
    only = mesh_image(labels, label=7)
    assert only.points[:, 0].min() > 48.0
    assert mesh_image(labels, label=[3, 7]).n_cells == mesh.n_cells


def test_touching_labels_share_nodes():
    labels = np.where(block(slice(5, 20), slice(5, 25)), 1, 0)
    labels[20:35, 5:25] = 2
    mesh = mesh_image(labels)
    left, right = (np.unique(mesh.cells[mesh.cell_tags == k]) for k in (1, 2))
    assert len(np.intersect1d(left, right)) >= 4
    shared = mesh.points[np.intersect1d(left, right)]
    inner = np.abs(shared[:, 1] - 14.5) < 8.0  # away from the rounded corners
    assert np.abs(shared[inner, 0] - 19.5).max() < 0.05
    assert (mesh.signed_measures > 0.0).all()


def facets_named(mesh, name):
    (tag,) = [tag for (_, tag), found in mesh.tag_names.items() if found == name]
    return mesh.points[mesh.tagged_facets[mesh.facet_tags == tag]]


def test_skins_and_interfaces_are_tagged_and_named():
    labels = np.where(block(slice(5, 20), slice(5, 25)), 1, 0)
    labels[20:35, 5:25] = 2
    mesh = mesh_image(labels)
    names = {name for (dim, _), name in mesh.tag_names.items() if dim == 1}
    assert names == {"boundary of 1", "boundary of 2", "interface of 1 and 2"}
    between = facets_named(mesh, "interface of 1 and 2")
    lengths = np.linalg.norm(between[:, 1] - between[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(20.0, abs=1.0)
    left = facets_named(mesh, "boundary of 1").mean(axis=1)
    assert left[:, 0].max() < 20.0
    n_skin = sum(len(facets_named(mesh, f"boundary of {k}")) for k in (1, 2))
    assert n_skin == mesh.boundary().mesh.n_cells


@pytest.mark.parametrize("turn", [0, 1])
def test_objects_at_the_border_end_there_with_a_warning(turn):
    image = np.rot90(block(slice(0, 20), slice(8, 22)), turn)
    with pytest.warns(InputWarning, match="reach the border of the image at 14 pixels"):
        mesh = mesh_image(image)
    assert len({name for name in mesh.tag_names.values() if "image border" in name}) == 1
    # Pixels reach half a pixel beyond their centres, and corners are rounded.
    assert mesh.measures.sum() == pytest.approx(20 * 14, rel=0.04)


# --- meshes -----------------------------------------------------------------------


def test_the_mesh_of_a_disc_has_its_area_and_its_edge():
    mesh = mesh_image(disc(30.0), spacing=0.1)
    assert mesh.measures.sum() == pytest.approx(np.pi * 9.0, rel=0.01)
    off = np.linalg.norm(boundary_points(mesh) - [5.03, 3.96], axis=1) - 3.0
    # A quarter of a pixel at the most, 0.1 in the mean, as the distance is.
    assert np.abs(off).max() < 0.035
    assert np.abs(off).mean() < 0.012
    assert (mesh.point_data["h"] > 0.0).all()


def test_a_ring_keeps_its_hole_and_the_same_seed_gives_the_same_mesh():
    ring = disc(30.0) & ~disc(15.0)
    mesh, again = mesh_image(ring), mesh_image(ring)
    assert mesh.measures.sum() == pytest.approx(np.pi * (30.0**2 - 15.0**2), rel=0.02)
    np.testing.assert_array_equal(mesh.points, again.points)
    distance = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1) - [50.3, 39.6], axis=1)
    assert distance.min() > 14.0


def test_a_volume_becomes_tetrahedra_with_the_labels_as_regions():
    x, y, z = np.indices((30, 30, 20))
    ball = np.sqrt((x - 14.6) ** 2 + (y - 15.2) ** 2 + (2.0 * (z - 9.7)) ** 2) < 12.0
    labels = np.where(ball, np.where(x < 14.6, 1, 2), 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # slivers give a warning
        mesh = mesh_image(labels, spacing=[1.0, 1.0, 2.0], elements_per_radian=2.0, hmax=5.0)
    assert mesh.cell_dim == 3
    assert (mesh.measures > 0.0).all()
    # A polyhedron inscribed in a ball, with edges of a third of the radius.
    assert mesh.measures.sum() == pytest.approx(4.0 / 3.0 * np.pi * 12.0**3, rel=0.07)
    halves = [mesh.measures[mesh.cell_tags == k].sum() for k in (1, 2)]
    assert_allclose(halves, np.sum(halves) / 2.0, rtol=0.15)
    off = np.linalg.norm(boundary_points(mesh) - [14.6, 15.2, 19.4], axis=1) - 12.0
    assert np.abs(off).max() < 1.0


# --- refused ----------------------------------------------------------------------


NOISE = np.random.default_rng(8).integers(1, 255, (40, 30)).astype(np.uint8)


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (block(slice(0, 0)), {}, "a pixel that is not 0, got none"),
        (~block(slice(0, 0)), {}, "pixels outside the objects, got none.*inverted"),
        (
            block(5, 5),
            {},
            "objects at least 4 pixels across, got one object of at most 1 pixels",
        ),
        (
            np.ones(7),
            {},
            r"image must be numbers in a 2-D or 3-D array, got float64 of shape \(7,\)",
        ),
        (np.ones((20, 30, 3), np.uint8), {}, "looks like colours: segment it first"),
        (NOISE, {}, "as in a photo: segment it first, or pass threshold or label"),
        (NOISE / 255.0, {}, "must hold labels.*got float64 from .* pass threshold"),
        (3 * disc(9.0), {"label": 3, "threshold": 1}, "label or threshold must be given, got both"),
    ],
)
def test_bad_input_is_one_clear_line(image, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        mesh_image(image, **options)
    assert "\n" not in str(caught.value)


def test_too_many_elements_are_refused():
    with pytest.raises(TooManyElementsError, match="max_elements"):
        mesh_image(disc(9.0), hmin=1e-3, hmax=1e-3)


def test_sizes_scale_with_the_pixels_and_lie_where_the_image_does():
    options = {"elements_per_radian": 3.0, "elements_across": 3.0}
    plain = size_function(disc(20.0), **options)
    scaled = size_function(Image(disc(20.0), 0.25, [7.0, -2.0]), **options)
    assert_allclose(scaled.values, 0.25 * plain.values, rtol=1e-6)
    assert_allclose(scaled.background.lower, 0.25 * plain.background.lower + [7.0, -2.0])


def test_pixels_need_not_be_squares():
    x, y = np.indices((100, 50))
    ellipse = np.hypot(0.1 * (x - 50.2), 0.2 * (y - 24.7)) < 3.0
    mesh = mesh_image(ellipse, spacing=[0.1, 0.2])
    assert mesh.measures.sum() == pytest.approx(np.pi * 9.0, rel=0.02)
    off = np.linalg.norm(boundary_points(mesh) - [5.02, 4.94], axis=1) - 3.0
    assert np.abs(off).max() < 0.1
