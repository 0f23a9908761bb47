"""Sources smaller than the cells: the size function has their sizes, in any mesh."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
    SimplexMesh,
    size_function,
)
from adaptsize.errors import TooManyElementsError
from adaptsize.sizes.cones import cone_of, lowest_of

G = 0.25
SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
FREE = {"elements_per_radian": 0.0, "elements_across": 0.0, "elements_between": 0.0, "hmax": 0.3}


def kuhn_cube(n=1):
    """Return the unit cube in n^3 boxes of six tetrahedra."""
    from adaptsize import CartesianGrid

    return CartesianGrid([0.0] * 3, 1.0 / n, (n + 1,) * 3).mesh


def l_solid():
    """Return a cube without an octant, where exact sizes are interpolated between the nodes."""
    cube = kuhn_cube(2)
    middle = cube.points[cube.cells].mean(axis=1)
    kept = ~(middle > 0.5).all(axis=1)
    nodes, cells = np.unique(cube.cells[kept], return_inverse=True)
    return SimplexMesh(cube.points[nodes], cells.reshape(-1, 4))


def interval():
    return SimplexMesh([[0.0], [0.4], [1.0]], [[0, 1], [1, 2]])


MESHES = {"interval": interval, "square": lambda: SQUARE, "cube": kuhn_cube, "L": l_solid}


def sources_at(place, size):
    """Return sources around a place with their size, smaller than any cell."""
    step = 4.0 * size * np.ones(len(place))
    along = np.array([place - step, place + step])
    return {
        "point": PointSource(place, size),
        "curve": CurveSource(along, size),
        "box": BoxSource(*along, size),
        "ball": BallSource(place, 4.0 * size, size),
        "function": lambda x: size + G * np.linalg.norm(x - place, axis=1),
    }


@pytest.mark.parametrize("kind", ["point", "curve", "box", "ball", "function"])
@pytest.mark.parametrize("name", list(MESHES))
@pytest.mark.parametrize("size", [0.05, 1e-3])
def test_the_size_at_a_source_is_its_size(name, kind, size):
    mesh = MESHES[name]()
    place = np.array([0.31, 0.23, 0.42])[: mesh.dim]
    found = size_function(mesh, sources=[sources_at(place, size)[kind]], g=G, **FREE)
    # Linear sizes between nodes at a cone are too large by at most the growth over a cell.
    assert found([place])[0] == pytest.approx(size, rel=0.4 if kind == "function" else 0.15)
    assert found([place])[0] >= size * (1.0 - 1e-12)
    assert (found.background.points[: mesh.n_points] == mesh.points).all()
    # Growing at g, and nowhere smaller than straight lines allow.
    away = found.background.points
    assert (found.values <= 0.3).all()
    edges = found.background.edges
    lengths = found.background.edge_lengths
    assert (np.abs(np.diff(found.values[edges])[:, 0]) <= G * lengths + 1e-12).all()
    reach = 4.0 * size * np.sqrt(mesh.dim)
    lowest = size + G * np.maximum(np.linalg.norm(away - place, axis=1) - reach, 0.0)
    assert (found.values >= np.minimum(lowest, 0.3) * (1.0 - 1e-9)).all()


def test_a_source_on_a_wall_of_a_solid_that_is_not_convex_keeps_its_size():
    mesh, wall = l_solid(), np.array([0.5, 0.7, 0.8])
    size = size_function(mesh, sources=[PointSource(wall, 0.03)], g=G, **FREE)
    assert size([wall])[0] == pytest.approx(0.03, rel=0.15)


@pytest.mark.parametrize("kind", ["boundary", "region"])
def test_tagged_sources_are_resolved_where_they_are(kind):
    mesh = SimplexMesh(
        SQUARE.points, SQUARE.cells, cell_tags=[7, 8], tagged_facets=[[0, 1]], facet_tags=[5]
    )
    source = BoundarySource(0.01, tags=5) if kind == "boundary" else RegionSource(7, 0.01)
    size = size_function(mesh, sources=[source], g=G, **FREE)
    inside = [[0.4, 0.0], [0.83, 0.0]] if kind == "boundary" else [[0.6, 0.2], [0.9, 0.8]]
    assert_allclose(size(inside), 0.01, rtol=0.01)
    beyond = [[0.3, 0.2]] if kind == "boundary" else [[0.3, 0.7]]
    distance = 0.2 if kind == "boundary" else 0.4 / np.sqrt(2.0)
    assert_allclose(size(beyond), 0.01 + G * distance, rtol=0.02)


def test_without_small_sources_the_background_is_the_mesh_itself():
    mesh = kuhn_cube(4)
    size = size_function(mesh, sources=[PointSource([0.5, 0.5, 0.5], 0.6)], hmax=1.0)
    assert size.background is mesh


def test_sources_that_need_more_elements_than_allowed_are_refused():
    source = BoxSource([0.3, 0.3], [0.7, 0.7], 2e-3)
    message = "more than max_elements = 10000: sources controls .*, given parameters: .*sources"
    with pytest.raises(TooManyElementsError, match=message):
        size_function(SQUARE, sources=[source], max_elements=1e4, **FREE)


def test_sizes_of_functions_are_not_raised_unless_hmin_is_given():
    def tiny(x):
        return 1e-5 + G * np.linalg.norm(x - 0.37, axis=1)

    assert size_function(SQUARE, sources=[tiny], g=G, **FREE)([[0.37, 0.37]])[0] < 1.5e-5
    raised = size_function(SQUARE, sources=[tiny], g=G, hmin=1e-3, **FREE)
    assert raised([[0.37, 0.37]])[0] == pytest.approx(1e-3)


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("n", [3, 200])
def test_cones_are_minima_over_all_points_of_the_sources(dim, n):
    rng = np.random.default_rng(100 * dim + n)
    mesh = MESHES[{1: "interval", 2: "square", 3: "cube"}[dim]]()
    points, x = rng.random((n, dim)), rng.random((50, dim))
    sizes = rng.uniform(0.01, 0.5, n)
    away = np.linalg.norm(x[:, None] - points, axis=2)
    expected = (sizes + G * away).min(axis=1)
    assert_allclose(cone_of(PointSource(points, sizes), mesh, G)(x), expected, rtol=1e-12)
    # On a polyline, the minimum over many points of it.
    t = np.linspace(0.0, 1.0, 2001)[:, None, None]
    on = ((1 - t) * points[:2] + t * points[1:3]).reshape(-1, dim)
    h = ((1 - t[..., 0]) * sizes[:2] + t[..., 0] * sizes[1:3]).ravel()
    dense = (h + G * np.linalg.norm(x[:, None] - on, axis=2)).min(axis=1)
    found = cone_of(CurveSource(points[:3], sizes[:3]), mesh, G)(x)
    assert_allclose(found, dense, rtol=1e-3)
    assert (found <= dense * (1.0 + 1e-12)).all()
    both = lowest_of([PointSource(points, sizes), CurveSource(points[:3], sizes[:3])], mesh, G)
    assert_allclose(both(x), np.minimum(expected, found), rtol=1e-12)
    assert lowest_of([lambda x: x[:, 0]], mesh, G) is None
