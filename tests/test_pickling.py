"""Objects outlive pickling and deep copies, as process pools and caches need them to."""

import copy
import pickle
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from shapes import block, two_region_rectangle

import adaptsize as ads
from adaptsize.adaptation.report import AdaptReport
from adaptsize.adaptation.transfer import TransferredFields
from adaptsize.background.simplex import Boundary
from adaptsize.geometry.medial.fronts import MedialAxis
from adaptsize.quality.conformity import Conformity
from adaptsize.quality.summary import MeshSummary, summarize
from adaptsize.remeshing import available_backends


def tagged_square():
    mesh = two_region_rectangle(3)
    return mesh.with_data(
        point_data={"h": 0.1 + mesh.points[:, 0]}, cell_data={"rho": mesh.measures}
    )


def masked_grid():
    active = np.ones((6, 5), bool)
    active[0, 0] = False
    return ads.CartesianGrid([0, 0], 0.25, (6, 5), active=active)


def a_tree():
    return ads.Octree([0, 0], [1, 1], (1, 1), [1, 1, 1, 2, 2, 2, 2])


def limited(background):
    h0 = np.full(background.nodal_shape, 1.0)
    h0.flat[7] = 0.05
    return ads.limit_gradient.with_info(background, h0, 0.3, method="exact")


def size_with_sources():
    mesh = tagged_square()
    h, info = limited(mesh)
    return ads.SizeFunction(mesh, h, sources=info.sources)


def a_transfer():
    transfer = ads.FieldTransfer(two_region_rectangle(3), two_region_rectangle(4))
    transfer.cells(np.ones(transfer.old.n_cells))
    return transfer


def a_size_report():
    boundary = block(2).boundary().mesh
    return ads.size_function(boundary, hmax=0.4).report


def an_adaptation():
    if not available_backends()["mmg"].installed:
        pytest.skip("needs Mmg")
    mesh = two_region_rectangle(4)
    return ads.adapt(mesh, h0=0.2, fields={"x": mesh.points[:, 0]})


MAKE = {
    "SimplexMesh": tagged_square,
    "Boundary": lambda: tagged_square().boundary(),
    "ElementField": lambda: ads.ElementField(np.arange(9.0), 2, continuous=False, log=True),
    "CartesianGrid": masked_grid,
    "Octree": a_tree,
    "Image": lambda: ads.background.Image([[True, False], [False, True]], spacing=0.5),
    "SignedDistance": lambda: ads.SignedDistance([[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]]),
    "SizeFunction": size_with_sources,
    "SizeFunction on a grid": lambda: ads.SizeFunction(masked_grid(), np.full((6, 5), 0.5)),
    "SizeFunction on an octree": lambda: ads.SizeFunction(a_tree(), np.full(16, 0.5)),
    "LimitingInfo": lambda: limited(a_tree())[1],
    "SizeSources": lambda: limited(tagged_square())[1].sources,
    "FieldTransfer": a_transfer,
    "MedialAxis": lambda: ads.medial_axis(
        masked_grid().with_active(None), np.minimum(np.arange(6) - 2.0, 2.0 - np.arange(6))[:, None]
        + np.zeros(5),
    ),
    "SizeReport": a_size_report,
    "AdaptResult": an_adaptation,
    "Conformity": lambda: ads.size_conformity(tagged_square(), 0.2),
    "Metric": lambda: ads.Metric.isotropic([0.1, 0.2], 2),
    "MetricFunction": lambda: ads.MetricFunction(
        tagged_square(), ads.Metric.isotropic(np.full(tagged_square().n_points, 0.1), 2)
    ),
    "MeshSummary": lambda: summarize(tagged_square()),
    "PointSource": lambda: ads.PointSource([0.0, 0.0], 0.1),
}  # fmt: skip
WAYS = {"pickle": lambda value: pickle.loads(pickle.dumps(value)), "deepcopy": copy.deepcopy}
READ_ONLY = (
    ads.SimplexMesh, ads.CartesianGrid, ads.Octree, ads.background.Image,
    MedialAxis, ads.Metric,
)  # fmt: skip


def assert_same(new, old):
    """Compare two objects field by field; arrays of backgrounds must be read-only."""
    assert type(new) is type(old)
    if isinstance(old, np.ndarray):
        assert new.dtype == old.dtype
        assert_array_equal(new, old)
    elif isinstance(old, Mapping):
        assert list(new) == list(old)
        for key in old:
            assert_same(new[key], old[key])
    elif isinstance(old, tuple | list):
        assert len(new) == len(old)
        for one, other in zip(new, old, strict=True):
            assert_same(one, other)
    elif is_dataclass(old):
        for field in fields(old):
            value = getattr(new, field.name)
            assert_same(value, getattr(old, field.name))
            if isinstance(old, READ_ONLY) and isinstance(value, np.ndarray):
                assert not value.flags.writeable, field.name
    elif isinstance(old, int | float | str | np.generic):
        assert_array_equal(new, old)  # nan equals nan


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", MAKE)
def test_objects_come_back_the_same(name, way):
    old = MAKE[name]()
    new = WAYS[way](old)
    assert repr(new) == repr(old) or isinstance(old, ads.FieldTransfer)
    assert_same(new, old)


@pytest.mark.parametrize("way", WAYS)
def test_a_mesh_that_came_back_is_read_only_and_works(way):
    old = tagged_square()
    assert len(old.edges)
    new = WAYS[way](old)
    with pytest.raises(ValueError, match="read-only"):
        new.points[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        new.point_data["h"][0] = 1.0
    with pytest.raises(TypeError):
        new.point_data["k"] = np.zeros(new.n_points)
    assert_array_equal(new.edges, old.edges)
    assert_array_equal(ads.limit_gradient(new, new.point_data["h"], 0.2),
                       ads.limit_gradient(old, old.point_data["h"], 0.2))  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_a_size_function_that_came_back_gives_the_same_sizes(way):
    old = size_with_sources()
    points = np.random.default_rng(90817).uniform(0.0, [2.0, 1.0], (50, 2))
    new = WAYS[way](old)
    assert new.sources.background is new.background
    assert_array_equal(new(points), old(points))


def test_every_public_class_that_holds_data_is_tested_here():
    held = {
        Boundary, TransferredFields, AdaptReport, Conformity, MeshSummary,
        *(getattr(ads, name) for name in ads.__all__ if isinstance(getattr(ads, name), type)),
    }  # fmt: skip
    names = {cls.__name__ for cls in held}
    inside = {"AdaptReport", "TransferredFields"}  # a part of AdaptResult; a plain named tuple
    sources = {n for n in names if n.endswith("Source")}
    assert names - inside - sources - {name.split()[0] for name in MAKE} == set()


def test_eight_threads_use_one_mesh_at_once():
    points = np.random.default_rng(3312).uniform(0.0, [2.0, 1.0], (200, 2))
    fresh = two_region_rectangle(12)
    copies = [pickle.loads(pickle.dumps(fresh)) for _ in range(3)]

    def work(number):
        mesh = copies[number % len(copies)]
        h = ads.limit_gradient(mesh, 0.05 + mesh.points[:, 0], 0.2)
        return len(mesh.edges), mesh.boundary().mesh.n_cells, ads.SizeFunction(mesh, h)(points)

    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(work, range(24)))
    for n_edges, n_sides, sizes in results:
        assert (n_edges, n_sides) == results[0][:2]
        assert_array_equal(sizes, results[0][2])
