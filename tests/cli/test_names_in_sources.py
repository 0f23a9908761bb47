"""Sources on regions and boundaries by the names of their tags."""

import numpy as np
import pytest
from command_line import call

import adaptsize as ads
from adaptsize import BoundarySource, CartesianGrid, RegionSource, SimplexMesh, size_function
from adaptsize.cli.sources import parse_source
from adaptsize.sizes import size_from_sources

PLATE = SimplexMesh(
    [[0, 0], [1, 0], [1, 1], [0, 1]],
    [[0, 1, 2], [0, 2, 3]],
    cell_tags=[4, 7],
    tagged_facets=[[0, 1], [2, 3]],
    facet_tags=[1, 2],
    tag_names={(2, 4): "hub", (1, 1): "inlet, low"},
)


@pytest.mark.parametrize(
    ("text", "by_number"),
    [
        ("region:hub=0.1", RegionSource(4, 0.1)),
        ("region:region 7=0.1", RegionSource(7, 0.1)),
        ("region:7=0.1", RegionSource(7, 0.1)),
        ("boundary:inlet, low=0.1", BoundarySource(0.1, tags=1)),
        ("boundary:face 2=0.1", BoundarySource(0.1, tags=2)),
    ],
)
def test_a_name_stands_for_its_tag(text, by_number):
    found = size_from_sources(PLATE, parse_source(text))
    np.testing.assert_array_equal(found, size_from_sources(PLATE, by_number))
    assert np.isfinite(found).any()


def test_names_and_numbers_may_be_mixed():
    both = size_from_sources(PLATE, RegionSource(["hub", 7], 0.1))
    np.testing.assert_array_equal(both, np.full(4, 0.1))


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (RegionSource("hubs", 0.1), "among the cell_tags hub, region 7, got hubs"),
        (BoundarySource(0.1, tags="hub"), "among the facet_tags inlet, low, face 2, got hub"),
    ],
)
def test_an_unknown_name_is_refused_with_the_names(source, expected):
    with pytest.raises(ValueError, match=expected):
        size_function(PLATE, sources=source)


@pytest.fixture
def box(tmp_path):
    """An STL file of a box, whose faces have no names."""
    ads.write(tmp_path / "box.stl", CartesianGrid([0.0] * 3, 1.0, (2, 2, 2)).mesh.boundary().mesh)
    return tmp_path / "box.stl"


@pytest.mark.parametrize("kind", ["boundary", "region"])
def test_the_faces_of_an_stl_file_have_the_names_that_the_option_faces_gives(box, kind):
    """The same by ``--faces`` and without it, since a name asks for the faces."""
    output = box.with_name("h.vtu")
    words = ["--hmax", "0.5", "--source", f"{kind}:face 2=0.05", "-q"]
    assert call("size", box, "-o", output, *words) == 0
    mesh = ads.read(output)
    h, on_face = mesh.point_data["h"], np.unique(mesh.cells[mesh.cell_tags == 2])
    np.testing.assert_allclose(h[on_face], 0.05)
    away = np.ptp(mesh.points[on_face], axis=0).argmin()  # the normal of the face
    far = np.abs(mesh.points[:, away] - mesh.points[on_face[0], away]) > 0.5
    assert h[far].min() > 0.1


def test_remesh_takes_names_of_faces(box):
    output = box.with_name("new.vtu")
    words = ["--faces", "--target", "triangles", "--hmax", "0.5"]
    assert call("remesh", box, "-o", output, *words, "--source", "boundary:face 2=0.1") in (0, 1)
    mesh = ads.read(output)
    counts = np.bincount(mesh.cell_tags)
    assert counts[2] > 1.5 * np.delete(counts, [0, 2]).mean()
