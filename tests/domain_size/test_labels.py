"""Labels in images: their volumes, interfaces, the border of the image, and sizes by label."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from adaptsize import BoundarySource, RegionSource, mesh_image, size_function
from adaptsize._kernels.label_fields import interpolate_field
from adaptsize.errors import InputWarning


def head(dim, outer, skull, brain, ball=4.5):
    """Four labels: 1 a ball, 2 a shell in it, 3 what that encloses, 4 a small ball in this."""
    n = 2 * int(outer) + 6
    x = np.stack(np.meshgrid(*dim * [np.arange(n)], indexing="ij")) - (n / 2 - 0.3)
    r = np.linalg.norm(x, axis=0)
    labels = np.select([r < brain, r < skull, r < outer], [3, 2, 1], 0)
    x[0] -= 0.9 * (brain - ball) - 2.0
    labels[np.linalg.norm(x, axis=0) < ball] = 4
    return labels


def mosaic(shape, n, seed, n_outside):
    """Cells of random points, some of them outside."""
    rng = np.random.default_rng(seed)
    centres = rng.random((n, len(shape))) * shape
    pixels = np.stack(np.indices(shape), axis=-1).reshape(-1, len(shape))
    labels = cKDTree(centres).query(pixels)[1] + 1
    labels[labels <= n_outside] = 0
    return labels.reshape(shape), centres


def changes(mesh, labels, spacing=1.0):
    """Return the relative change of the volume of each label: cells against voxels."""
    pixel = np.prod(np.broadcast_to(spacing, labels.ndim))
    return {
        int(k): mesh.measures[mesh.cell_tags == k].sum() / (pixel * (labels == k).sum()) - 1.0
        for k in np.unique(labels[labels != 0])
    }


def mesh_of(labels, **options):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "objects reach the border", InputWarning)
        return mesh_image(labels, **options)


def sizes_of(labels, **options):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "objects reach the border", InputWarning)
        return size_function(labels, **options)


# --- volumes ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dim", "radii", "options"),
    [
        (2, (40.0, 30.0, 26.0), {}),
        (3, (13.5, 10.5, 6.5), {"elements_across": 1.0, "hmin": 5.5}),
    ],
)
def test_a_shell_of_four_pixels_and_a_ball_of_nine_keep_their_volume(dim, radii, options):
    labels = head(dim, *radii)
    mesh = mesh_of(labels, spacing=2.0, **options)
    off = changes(mesh, labels, 2.0)
    assert set(off) == {1, 2, 3, 4}
    assert max(map(abs, off.values())) < 0.005, off
    assert (mesh.signed_measures > 0.0).all()


@pytest.mark.parametrize("n_outside", [0, 2])
@pytest.mark.parametrize("seed", [3018, 7729, 5501])
def test_random_labels_keep_their_area_and_their_interfaces(seed, n_outside):
    labels, centres = mosaic((50, 44), 7, seed, n_outside)
    spacing = np.array([0.5, 0.7])
    mesh = mesh_of(labels, spacing=spacing)
    off = changes(mesh, labels, spacing)
    assert max(map(abs, off.values())) < 0.01, off
    assert (mesh.signed_measures > 0.0).all()
    if n_outside == 0:  # they fill the image, which is a rectangle
        assert mesh.measures.sum() == pytest.approx(np.prod(spacing * labels.shape), rel=1e-12)
    # Nodes between labels are as far from both centres, in pixels, but where a third one is near.
    cells = [mesh.cell_tags[(mesh.cells == node).any(axis=1)] for node in range(mesh.n_points)]
    near, which = cKDTree(centres).query(mesh.points / spacing, k=3)
    several = np.array([len(np.unique(tags)) for tags in cells]) > 1
    away = np.linalg.norm(centres[which[:, 0]] - centres[which[:, 1]], axis=1)
    from_edge = (near[:, 1] ** 2 - near[:, 0] ** 2) / (2.0 * away)
    apart = np.linalg.norm(centres[which[:, 0]] - centres[which[:, 2]], axis=1)
    alone = (near[:, 2] ** 2 - near[:, 0] ** 2) / (2.0 * apart) > 4.0
    assert from_edge[several & alone].max() < 0.75
    assert from_edge[several].max() < 4.0


def test_the_line_where_three_labels_meet_is_a_line_of_the_mesh():
    x, y, _ = np.indices((25, 25, 9)) - 12.3
    angle = np.arctan2(y, x)
    labels = 1 + (angle > -np.pi / 3) + (angle > np.pi / 3)
    mesh = mesh_of(labels, hmin=3.0, hmax=3.0)
    touched = [np.unique(mesh.cells[mesh.cell_tags == k]) for k in (1, 2, 3)]
    line = mesh.points[np.intersect1d(np.intersect1d(*touched[:2]), touched[2])]
    assert len(line) >= 4
    off = np.hypot(*(line[:, :2] - 12.3).T)
    assert np.median(off) < 0.5
    assert off.max() < 1.5  # half a size: a node too far away stays between two labels
    assert_allclose([line[:, 2].min(), line[:, 2].max()], [-0.5, 8.5], atol=1e-12)


def test_parts_that_the_filter_removes_are_reported_and_thicken_no_others():
    labels = np.zeros((60, 40), int)
    labels[5:35, 5:35] = 1
    labels[35:55, 19:21] = 1  # a line of two pixels
    with pytest.warns(InputWarning, match=r"smoothing removes thin parts: 3\.6% of the pixels"):
        mesh = mesh_image(np.where(labels, 1, 0))
    assert mesh.measures.sum() == pytest.approx(900.0, rel=0.02)


# --- the border of the image ------------------------------------------------------


@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_inlets_are_plane_and_keep_their_area(slope):
    x, y, z = np.indices((16, 34, 26))
    tube = np.hypot(y - 13.3 - slope * x, z - 12.8) < 9.0
    mesh = mesh_of(tube, elements_across=2.0, elements_per_radian=2.5)
    for name, at, plane in (("x low", 0, -0.5), ("x high", -1, 15.5)):
        (tag,) = [
            tag for (_, tag), found in mesh.tag_names.items() if found == f"image border, {name}"
        ]
        corners = mesh.points[mesh.tagged_facets[mesh.facet_tags == tag]]
        assert (corners[:, :, 0] == plane).all()
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert 0.5 * np.linalg.norm(sides, axis=1).sum() == pytest.approx(tube[at].sum(), rel=0.03)
    assert mesh.measures.sum() == pytest.approx(tube.sum(), rel=0.005)


def test_labels_that_fill_the_image_make_a_box():
    x, y, _ = np.indices((14, 12, 13))
    labels = np.where(np.hypot(x - 6.0, y - 6.0) < 4.0, 2, 1)
    mesh = mesh_of(labels, spacing=[1.0, 1.0, 1.5], hmin=2.5, hmax=2.5)
    assert mesh.measures.sum() == pytest.approx(14 * 12 * 13 * 1.5, rel=1e-12)
    skin = mesh.boundary().mesh
    assert skin.measures.sum() == pytest.approx(2 * (14 * 12 + (14 + 12) * 19.5), rel=1e-12)
    assert max(map(abs, changes(mesh, labels, [1.0, 1.0, 1.5]).values())) < 0.01
    names = set(mesh.tag_names.values())
    assert names == {f"image border, {d} {s}" for d in "xyz" for s in ("low", "high")} | {
        "interface of 1 and 2"
    }


# --- sizes ------------------------------------------------------------------------


def test_sizes_follow_the_width_of_each_label():
    labels = np.zeros((80, 60), int)
    labels[10:70, 10:50] = 1
    labels[10:70, 26:32] = 2  # 6 wide
    size = size_function(labels, elements_per_radian=0.0, elements_across=2.0, hmax=20.0, g=0.5)
    x = np.linspace(25.0, 55.0, 9)
    assert_allclose(size(np.column_stack([x, np.full(9, 28.5)])), 3.0, atol=0.3)
    # Label 1 is 16 and 18 wide beside it, where sizes have grown for some pixels.
    assert size([[40.0, 40.0]]) == pytest.approx(3.0 + 0.5 * 8.5, abs=0.6)


def test_sizes_follow_the_curvature_of_interfaces():
    labels = head(2, 40.0, 30.0, 10.0, ball=0.0)
    size = size_function(labels, elements_per_radian=2.0, elements_across=0.0, hmax=50.0, g=0.2)
    centre = 86 / 2 - 0.3
    assert size([[centre + 10.0, centre]]) == pytest.approx(5.0, rel=0.15)


@pytest.mark.parametrize(
    "options",
    [
        {"size_of": {"2": 1.0}},
        {"size_of": {2: 1.0}},
        {"size_of": {"region 2": 1.0}},
        {"sources": RegionSource(2, 1.0)},
        {"sources": BoundarySource(1.0, tags=2)},
    ],
)
def test_sizes_by_label_arrive_and_leave_other_labels_their_least_size(options):
    labels = head(2, 40.0, 30.0, 24.0)
    size = size_function(labels, g=0.25, **options)
    centre = 86 / 2 - 0.3
    shell = centre + np.column_stack([[24.5, -27.0, 29.5], [0.0, 0.0, 0.0]])
    away = 3.0 if isinstance(options.get("sources"), BoundarySource) else 0.25  # to a node of it
    assert (size(shell) <= 1.0 + 0.25 * away).all()
    assert size(shell).min() == pytest.approx(1.0, abs=0.1)
    before = size_function(labels)
    outer = [[centre - 38.0, centre]]
    assert_allclose(size(outer), np.minimum(before(outer), 1.0 + 0.25 * 8.0), rtol=0.06)
    assert size.report.smallest.get("curvature", 2.0) >= 2.0


def test_a_larger_size_of_a_label_replaces_that_of_its_shape():
    labels = np.zeros((60, 60), int)
    labels[5:55, 5:55] = 1
    labels[10:50, 27:33] = 2
    of_shape = {"elements_per_radian": 0.0, "elements_across": 2.0, "hmax": 8.0}
    free = size_function(labels, **of_shape)
    given = size_function(labels, size_of={"2": 6.0}, **of_shape)
    assert free([[29.5, 29.5]]) == pytest.approx(3.0, abs=0.3)
    assert given([[29.5, 29.5]]) == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size_of": {"9": 1.0}}, r"size_of must be labels of the image, 1, 2, 3, 4; got '9'"),
        ({"sources": RegionSource(9, 1.0)}, r"tags must be labels of the image, 1, .*got '9'"),
        ({"label": [0, 1]}, r"label must not hold 0, the outside, with others"),
    ],
)
def test_labels_that_do_not_occur_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        mesh_image(head(2, 20.0, 15.0, 11.0), **options)


# --- the kernel -------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(7, 9), (6, 8, 5)])
def test_fields_are_interpolated_with_their_gradients(shape):
    rng = np.random.default_rng(60)
    values = rng.random(shape).astype(np.float32)
    place = rng.random((300, len(shape))) * (np.array(shape) - 1)

    def at(points, room):
        found, slope = np.empty(len(points)), np.empty((room, len(shape)))
        interpolate_field(values.reshape(-1), np.array(shape), points, found, slope)
        return found, slope

    found, slope = at(place, 300)
    assert_allclose(found, map_coordinates(values.astype(float), place.T, order=1), atol=1e-14)
    for d in range(len(shape)):
        ahead = place.copy()
        ahead[:, d] = np.floor(place[:, d]) + np.where(place[:, d] % 1 < 0.5, 0.9, 0.1)
        rise = (at(ahead, 0)[0] - found) / (ahead - place)[:, d]
        assert_allclose(rise, slope[:, d], atol=1e-10)
