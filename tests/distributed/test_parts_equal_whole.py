"""Functions on a mesh in parts: the results are those on the whole mesh, for any partition."""

import warnings
from types import SimpleNamespace

import domains
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import (
    jittered_cube,
    jittered_square,
    random_sphere,
    random_square,
    slit_square,
    structured_square,
)
from partitions import BOUNDS, FIGURES, KINDS, SIZE, bounds, on_ranks, partition
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation
from shapes import joined, moved
from simulated_ranks import SimulatedCommunicator
from solids_of_cubes import solid_of_cubes

import adaptsize as ads
from adaptsize import SimplexMesh, limit_gradient
from adaptsize.background.migration import whole_boundary
from adaptsize.distributed import PartitionedMesh
from adaptsize.errors import InputWarning
from adaptsize.limiting import Exact
from adaptsize.sizes import predict, recovered_hessian


def beside_each_other():
    """Return two squares that touch without common nodes, and a node in no cell."""
    one, two = structured_square(4), structured_square(6)
    one = SimplexMesh([*one.points, [500.0, 0.0]], one.cells)
    return joined(one, moved(two, [100.0, 0.0]))


def intervals():
    """Return two intervals, one of them folded, and a node in no cell."""
    rng = np.random.default_rng(853)
    points = np.concatenate([rng.permutation(30) / 7.0, [9.0], 10.0 + rng.random(5)])[:, None]
    order = np.argsort(points[:30, 0])
    more = [[31, 32], [32, 33], [33, 34], [34, 35]]
    return SimplexMesh(points, np.concatenate([np.column_stack([order[:-1], order[1:]]), more]))


def square_ring(seed):
    """Return a frame of unit cubes whose nodes are at integers, so that many sizes are equal."""
    around = solid_of_cubes(lambda x: np.abs(x[:, :2] - 2.5).max(axis=1) > 1.0, (5, 5, 2), seed)
    return SimplexMesh(np.round(around.points), around.cells)


def without_some_cells(seed):
    """Return a cube without a fifth of its cells: pinched edges and nodes, several components."""
    cube = jittered_cube(5, seed)
    cells = cube.cells[np.random.default_rng(seed).random(cube.n_cells) < 0.8]
    used, cells = np.unique(cells, return_inverse=True)
    return SimplexMesh(cube.points[used], cells.reshape(-1, 4))


def rounded_wall(seed):
    """Return a solid with oblique faces that are plane but for their rounding."""
    wall = domains.wall_box(200, seed=seed)[0]
    turn = Rotation.random(random_state=seed).as_matrix()
    return SimplexMesh(np.round(wall.points @ turn, 6), wall.cells)


def tagged(mesh, seed):
    """Return a mesh with regions, tagged facets, a node in no cell, and cells turned around."""
    rng = np.random.default_rng(seed)
    facets = mesh.facets[rng.random(len(mesh.facets)) < 0.1]
    cells = mesh.cells.copy()
    if mesh.cell_dim == mesh.dim:
        cells[::3] = cells[::3, ::-1]
    return SimplexMesh(
        np.concatenate([mesh.points, mesh.points[:1] - 100.0]),
        cells,
        cell_tags=rng.integers(1, 3, mesh.n_cells),
        tagged_facets=facets,
        facet_tags=rng.integers(4, 6, len(facets)),
    )


def ball():
    points = np.concatenate([random_sphere(80, 882).points, [[0.0, 0.0, 0.0]]])
    return SimplexMesh(points, Delaunay(points).simplices)


FLAT = {
    "square": jittered_square(8, 821),
    "structured": structured_square(6),
    "slivers": random_square(60, 822),
    "cube": jittered_cube(4, 823),
    "slit": slit_square(6),
    "stars": domains.star_holes(10, seed=824)[0],
    "blocks": domains.blocks(10, seed=825)[0],
    "holes": domains.holes(14, 3, 6, seed=826)[0],
    "wall": domains.wall_box(200, seed=871)[0],
    "window": domains.window_box(250, seed=872)[0],
    "rounded": rounded_wall(875),
    "ring": square_ring(873),
    "pinched": without_some_cells(874),
    "squares": beside_each_other(),
    "intervals": intervals(),
}
SURFACE = random_sphere(80, 873)


def between_nodes(mesh, rng):
    """Return points at nodes, on edges, in cells and outside, and bounds there."""
    used = mesh.cells[rng.integers(0, mesh.n_cells, 6)]
    weights = np.zeros(used.shape)
    weights[:2, 0] = 1.0
    weights[2:4, :2] = 0.5
    weights[4:] = rng.dirichlet(np.ones(used.shape[1]), 2)
    points = np.einsum("iv,ivd->id", weights, mesh.points[used])
    sizes = mesh.diagonal * rng.uniform(0.005, 0.1, 8)
    sizes[5] = np.inf
    return np.concatenate([points, points[:1] + 900.0, points[:1]]), sizes


def assert_limits_equal(mesh, h0, rank_of, g=0.3, **options):
    """Compare sizes bit by bit, and the figures of the info; return the info."""
    whole, expected = limit_gradient.with_info(mesh, h0, g, **options)
    results, parts = on_ranks(
        mesh,
        rank_of,
        SIZE,
        lambda part: limit_gradient.with_info(part, h0[part.global_ids], g, **options),
    )
    for (h, info), part in zip(results, parts, strict=True):
        np.testing.assert_array_equal(h, whole[part.global_ids])
        for name in FIGURES:
            assert getattr(info, name) == getattr(expected, name), name
        assert (info.iterations, repr(info)) == (results[0][1].iterations, repr(expected))
    return info


@pytest.mark.parametrize("kind", [*BOUNDS, "none"])
@pytest.mark.parametrize("domain", FLAT)
def test_exact_limits_and_figures(domain, kind, request):
    mesh, rng = FLAT[domain], np.random.default_rng(830)
    if mesh.dim == 1 and kind == "smooth":
        return
    h0 = np.full(mesh.n_points, np.inf) if kind == "none" else bounds(mesh, kind, rng)
    number = list(FLAT).index(domain) + BOUNDS.index(kind) if kind != "none" else 0
    points = between_nodes(mesh, rng) if kind == "none" or number % 3 == 1 else None
    rank_of = partition(mesh, KINDS[number % len(KINDS)], SIZE, rng)
    options = {"point_sources": points, "method": Exact(number % 2 == 0)}
    _, info = limit_gradient.with_info(mesh, h0, 0.3, **options)
    if "propagated" not in info.method:  # which follows cells through the whole mesh
        request.getfixturevalue("nothing_is_collected")
    assert_limits_equal(mesh, h0, rank_of, **options)


@given(data=st.data())
@settings(deadline=None, max_examples=25)
def test_exact_limits_of_drawn_problems(data):
    seed = data.draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    make = {
        "random": lambda: random_square(data.draw(st.integers(5, 40)), seed),
        "removed": lambda: domains.with_removed_cells(jittered_square(7, seed), seed, 6)[0],
        "ring": lambda: square_ring(seed),
        "pinched": lambda: without_some_cells(seed),
        "known": lambda: FLAT[data.draw(st.sampled_from(list(FLAT)))],
    }
    mesh = make[data.draw(st.sampled_from(list(make)))]()
    h0 = bounds(
        mesh, data.draw(st.sampled_from([kind for kind in BOUNDS if kind != "smooth"])), rng
    )
    if data.draw(st.booleans()):  # sources that allow the same sizes
        h0 = 1.0 + np.round(h0 / mesh.diagonal, 1) * mesh.diagonal
    rank_of = partition(mesh, data.draw(st.sampled_from(KINDS)), SIZE, rng)
    g = data.draw(st.sampled_from([0.0, 0.05, 0.3, 2.0, lambda h: 0.1 + 0.3 * h / (1.0 + h)]))
    options = {"method": Exact(data.draw(st.booleans()))}
    if data.draw(st.booleans()):
        options["point_sources"] = between_nodes(mesh, rng)
    assert_limits_equal(mesh, h0, rank_of, g, **options)


def test_the_part_of_a_single_rank_is_solved_like_a_whole_mesh():
    mesh = domains.holes(30, 5, 24)[0]
    h0 = bounds(mesh, "two", np.random.default_rng(884))
    h, info = limit_gradient.with_info(mesh, h0, 0.3)
    alone, found = limit_gradient.with_info(PartitionedMesh.from_serial(mesh), h0, 0.3)
    assert found.method == info.method == "exact"
    np.testing.assert_array_equal(alone, h)


@pytest.mark.parametrize("shift", [None, 0.0, 1e-13, 1e-11])
def test_cells_without_measure_and_doubled_cells_are_collected(shift):
    rng = np.random.default_rng(861)
    square = structured_square(3)
    meshes = [
        SimplexMesh(square.points, np.concatenate([square.cells, [[0, 4, 8]]])),
        SimplexMesh(square.points, np.concatenate([square.cells, square.cells[:4]])),
    ]
    if shift is not None:  # a fifth of the cells are flat, or nearly so between parts
        lattice = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
        points = lattice + shift * rng.uniform(-1.0, 1.0, lattice.shape)
        meshes = [SimplexMesh(points, Delaunay(points).simplices)]
    for mesh in meshes:
        h0 = bounds(mesh, "noise", rng)
        for kind in ("random", "strips"):
            assert_limits_equal(mesh, h0, partition(mesh, kind, SIZE, rng))


# Sizes: functions of a mesh, whole or in parts, and of fields at its nodes and in its cells.  They
# agree to the tolerance: bit by bit where it is 0.
SIZES = {
    "curvature": (
        lambda m, f: ads.size_from_curvature(m, crease_angle=50.0, hmax=30.0), 0.0
    ),
    "feature": (lambda m, f: ads.size_from_feature(m, crease_angle=50.0, hmax=30.0), 0.0),
    "error": (
        lambda m, f: ads.size_from_error(m, f.eta, order=1.0, tolerance=0.5, hmax=40.0), 1e-12
    ),
    "error, elements": (
        lambda m, f: ads.size_from_error(
            m, f.eta, order=1.0, elements=500.0, g=0.3, max_coarsen=3.0
        ),
        1e-12,
    ),
    "hessian": (lambda m, f: ads.size_from_hessian(m, f.u, tolerance=0.02), 1e-9),
    "hessian, norm": (
        lambda m, f: ads.size_from_hessian(m, f.u, tolerance=0.02, norm=2.0, hmax=30.0), 1e-9
    ),
    "hessian, elements": (
        lambda m, f: ads.size_from_hessian(m, f.u, elements=800.0, g=0.3, norm=1.0), 1e-9
    ),
    "linear field": (lambda m, f: ads.size_from_hessian(m, f.linear, elements=50.0), 0.0),
    "second derivatives": (lambda m, f: recovered_hessian(m, f.u), 1e-6),
    "predicted elements": (
        lambda m, f: np.full(m.n_points, predict(m, f.h, backend="mmg").cells), 1e-13
    ),
    "marching, g of cells": (
        lambda m, f: limit_gradient(m, f.h, f.g_cells, method="fast-marching"), 1e-12
    ),
    "marching, g of sizes": (
        lambda m, f: limit_gradient(m, f.h, lambda h: 0.1 + h / (9.0 + h), method="fast-marching"),
        1e-12,
    ),
    "along edges": (lambda m, f: limit_gradient(m, f.few, 0.3, method="edge-based"), 0.0),
    "limit": (lambda m, f: limit_gradient(m, f.few, 0.3), 1e-12),
}  # fmt: skip
MESHES = {
    "disc": tagged(domains.disc(8, radius=3.0, seed=881)[0], 801),
    "cube": tagged(jittered_cube(4, 883), 805),
    "ball": ball(),
    "square": jittered_square(9, 871),
    "slivers": random_square(70, 872),
    "sphere": SURFACE,
    "circle": domains.disc(8, radius=3.0, seed=881)[0].boundary().mesh,
}
NEED_VOLUMES = [name for name in SIZES if "hessian" in name or "deriv" in name or "linear" in name]


def fields(mesh):
    """Return fields at the nodes and in the cells of a mesh."""
    rng, x = np.random.default_rng(893), mesh.points / 50.0
    h = mesh.diagonal * rng.uniform(0.01, 0.3, mesh.n_points)
    few = np.where(rng.random(mesh.n_points) < 0.7, np.inf, h)
    few[mesh.cells[0, 0]] = 0.01 * mesh.diagonal
    nodal = {
        "u": np.sin(3.0 * x[:, 0]) + x[:, 0] * x[:, 1] + np.where(x[:, 0] > 0.5, x[:, 1] ** 3, 0.0),
        "linear": mesh.points @ np.arange(1.0, 1.0 + mesh.dim),
        "h": h,
        "few": few,
    }
    in_cells = {
        "eta": rng.uniform(0.0, 1.0, mesh.n_cells) ** 4,
        "g_cells": rng.uniform(0.05, 0.6, mesh.n_cells),
    }
    return nodal, in_cells


def fields_on(part, nodal, in_cells):
    own = {name: values[part.global_ids] for name, values in nodal.items()}
    return SimpleNamespace(
        **own, **{name: values[part.cell_ids] for name, values in in_cells.items()}
    )


@pytest.mark.parametrize("size", [1, 4])
@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize("domain", MESHES)
def test_sizes(domain, name, size):
    mesh, rng = MESHES[domain], np.random.default_rng(884)
    if mesh.cell_dim < mesh.dim and name in NEED_VOLUMES:
        return
    function, rtol = SIZES[name]
    nodal, in_cells = fields(mesh)
    whole = function(mesh, SimpleNamespace(**nodal, **in_cells))
    # Each function is tried on all kinds of partition, two for each mesh.
    first = list(MESHES).index(domain) + list(SIZES).index(name)
    for number in (first, first + 1):
        kind = KINDS[number % len(KINDS)] if size == 4 else ("default", "random")[number % 2]
        results, parts = on_ranks(
            mesh,
            partition(mesh, kind, size, rng),
            size,
            lambda part: function(part, fields_on(part, nodal, in_cells)),
        )
        if name == "marching, g of cells" and mesh.n_cells == mesh.n_points:
            continue  # on the whole mesh, such an array is that of the nodes
        shared = np.full(whole.shape, np.nan)
        for found, part in zip(results, parts, strict=True):
            expected = whole[part.global_ids]
            np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol)
            before = shared[part.global_ids]  # ranks that share a node agree bit by bit
            assert np.array_equal(found[~np.isnan(before)], before[~np.isnan(before)])
            shared[part.global_ids] = found


def test_the_boundary_is_that_of_the_whole():
    mesh, rng = MESHES["disc"], np.random.default_rng(885)
    whole = mesh.boundary()
    for kind in KINDS:
        for found in on_ranks(mesh, partition(mesh, kind, SIZE, rng), SIZE, whole_boundary)[0]:
            np.testing.assert_array_equal(found.ids, whole.nodes)
            for name in ("cells", "points", "cell_tags"):
                np.testing.assert_array_equal(getattr(found.mesh, name), getattr(whole.mesh, name))


@pytest.mark.parametrize("kind", KINDS)
def test_conformity_is_that_of_the_whole(kind):
    mesh, rng = jittered_cube(5, 886), np.random.default_rng(886)
    h = rng.uniform(0.05, 0.5, mesh.n_points)
    h[:20] = np.inf
    whole = ads.size_conformity(mesh, h)
    found, _ = on_ranks(
        mesh, partition(mesh, kind, SIZE, rng), SIZE,
        lambda part: ads.size_conformity(part, h[part.global_ids]),
    )  # fmt: skip
    for name, value in flat(whole).items():
        if value is not None:
            assert all(flat(one)[name] == pytest.approx(value, rel=1e-12) for one in found)


def flat(conformity):
    """Return the numbers of a conformity, those of its worst place beside the others."""
    found = conformity.as_dict()
    return found | {f"worst {name}": value for name, value in found.pop("worst").items()}


class OfOwnClass:
    """A source that is none of those of the package."""

    def lower_sizes(self, mesh, g, h0):
        nodes = mesh.cells[:, 0]
        h0[nodes] = np.minimum(h0[nodes], 0.3 + g * mesh.points[nodes, 0] ** 2)


def places(mesh, rng, n):
    """Return points at nodes, in the middle of edges, inside and outside."""
    used = mesh.cells[rng.integers(0, mesh.n_cells, n)]
    a, b = mesh.points[used[:, 0]], mesh.points[used[:, 1]]
    share = rng.choice([0.0, 0.5, 1.0, 0.3, 4.0], n)[:, None]
    return a + share * (b - a)


def draw_sources(mesh, rng):
    """Return one source of each kind."""
    scale = 0.1 * mesh.diagonal
    lower = places(mesh, rng, 1)[0]
    return [
        ads.PointSource(places(mesh, rng, 5), rng.uniform(0.1, 1.0, 5) * scale),
        ads.CurveSource(places(mesh, rng, 3), rng.uniform(0.1, 1.0, 3) * scale),
        ads.BoundarySource(0.2 * scale, tags=int(rng.integers(4, 6))),
        ads.RegionSource(int(rng.integers(1, 3)), scale),
        ads.BoxSource(lower, lower + rng.choice([0.01, 1.0]) * scale, 0.1 * scale),
        ads.BallSource(places(mesh, rng, 1)[0], rng.choice([0.0, 1.0]) * scale, 0.1 * scale),
        lambda x: np.where(x[:, 0] > 0.0, 0.5 * scale, np.inf),
        OfOwnClass(),
    ]


# In the structured square, points at nodes and curves along edges touch cells of several parts.
WITH_TAGS = {
    "structured": tagged(structured_square(6, half_width=3.0), 801),
    "jittered": tagged(jittered_square(7, 802), 803),
    "cube": tagged(jittered_cube(4, 804), 805),
    "sphere": tagged(random_sphere(60, 806), 807),
}


def assert_sources_equal(mesh, sources, rank_of, g=0.25):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        whole = ads.size_from_sources(mesh, sources, g=g)
        results, parts = on_ranks(
            mesh, rank_of, SIZE, lambda part: ads.size_from_sources(part, sources, g=g)
        )
    for h0, part in zip(results, parts, strict=True):
        np.testing.assert_array_equal(h0, whole[part.global_ids])


@given(data=st.data())
@settings(deadline=None, max_examples=15)
def test_drawn_sources(data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    mesh = WITH_TAGS[data.draw(st.sampled_from(list(WITH_TAGS)))]
    sources = [source for source in draw_sources(mesh, rng) if data.draw(st.booleans())]
    rank_of = partition(mesh, data.draw(st.sampled_from(KINDS)), SIZE, rng)
    assert_sources_equal(mesh, sources, rank_of, data.draw(st.sampled_from([0.0, 0.25, 1.0])))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["random", "blocks", "one rank"])
def test_fields_on_another_mesh(dim, kind):
    old = jittered_square(6, 9221) if dim == 2 else jittered_cube(3, 9221)
    new = jittered_square(5, 9222) if dim == 2 else jittered_cube(4, 9222)
    rng = np.random.default_rng(9223)
    parts = {
        "random": [rng.integers(0, 4, mesh.n_cells) for mesh in (old, new)],
        "blocks": [np.arange(mesh.n_cells) * 4 // mesh.n_cells for mesh in (old, new)],
        "one rank": [np.full(old.n_cells, 1), np.full(new.n_cells, 3)],
    }[kind]
    nodal = {"u": rng.random(old.n_points), "v": rng.random((old.n_points, 2)) * (1 + 2j)}
    by_cell = {"e": rng.random((old.n_cells, 2)), "k": rng.integers(0, 9, old.n_cells)}
    jump = {"u": (nodal["u"] > 0.5) * 1.0, "v": nodal["v"]}
    wanted = ads.transfer_fields(old, new, fields=nodal, cell_fields=by_cell)
    projected = {
        method: ads.transfer_fields(old, new, fields=jump, method=method).fields
        for method in ("project", "bounded")
    }
    anywhere = old.diagonal * (rng.random((50, dim)) - 0.5)
    at_points = ads.interpolate(old, nodal["u"], anywhere)

    def run(comm):
        a = PartitionedMesh.from_serial(old, parts[0], comm)
        b = PartitionedMesh.from_serial(new, parts[1], comm)
        found = ads.transfer_fields(
            a,
            b,
            fields={name: values[a.global_ids] for name, values in nodal.items()},
            cell_fields={name: values[a.cell_ids] for name, values in by_cell.items()},
        )
        own = {name: values[a.global_ids] for name, values in jump.items()}
        for method, whole in projected.items():
            counts = []
            for some in ({"u": own["u"]}, own):
                before = comm.traffic.exchanges
                made = ads.transfer_fields(a, b, fields=some, method=method).fields
                counts.append(comm.traffic.exchanges - before)
            assert method == "bounded" or counts[0] == counts[1]  # all fields are sent together
            for name, values in whole.items():
                np.testing.assert_allclose(made[name], values[b.global_ids], rtol=0.0, atol=1e-12)
        interpolated = ads.interpolate(a, nodal["u"][a.global_ids], anywhere)
        return b.global_ids, b.cell_ids, found, interpolated

    for ids, cell_ids, found, interpolated in SimulatedCommunicator.run(4, run):
        np.testing.assert_allclose(interpolated, at_points, rtol=0.0, atol=1e-12)
        for made, values, rows in (
            (found.fields, wanted.fields, ids),
            (found.cell_fields, wanted.cell_fields, cell_ids),
        ):
            for name in values:
                assert made[name].dtype == values[name].dtype
                np.testing.assert_allclose(made[name], values[name][rows], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("away", [0.05, 3.0])
def test_fields_beyond_the_old_mesh_are_those_of_its_nearest_cells(kind, away):
    """Partly or wholly outside, and at a node in no cell."""
    old, rng = jittered_square(7, 9224), np.random.default_rng(9225)
    moved = jittered_square(6, 9226).moved(jittered_square(6, 9226).points + away * old.diagonal)
    new = ads.SimplexMesh([*moved.points, old.points[7] + 0.1 * old.diagonal], moved.cells)
    fields = {"u": rng.random(old.n_points), "k": rng.integers(0, 99, old.n_points)}
    by_cell = {"e": rng.random(old.n_cells)}
    ranks = [partition(mesh, kind, SIZE, rng) for mesh in (old, new)]
    for method in ("interpolate", "bounded"):
        whole = ads.transfer_fields(old, new, fields=fields, cell_fields=by_cell, method=method)

        def run(comm, method=method):
            a, b = (
                PartitionedMesh.from_serial(mesh, rank_of, comm)
                for mesh, rank_of in zip((old, new), ranks, strict=True)
            )
            made = ads.transfer_fields(
                a, b, method=method,
                fields={name: values[a.global_ids] for name, values in fields.items()},
                cell_fields={name: values[a.cell_ids] for name, values in by_cell.items()},
            )  # fmt: skip
            return made, b.global_ids, b.cell_ids

        for made, ids, cell_ids in SimulatedCommunicator.run(SIZE, run):
            np.testing.assert_allclose(made.fields["u"], whole.fields["u"][ids], atol=1e-12)
            np.testing.assert_array_equal(made.fields["k"], whole.fields["k"][ids])
            expected = whole.cell_fields["e"][cell_ids]
            np.testing.assert_allclose(made.cell_fields["e"], expected, atol=1e-12)


def test_a_node_farther_out_than_all_centroids_gets_its_nearest_old_cell():
    """It is behind the box of the new cells, as seen from the other old ones."""
    square = [[0.2, 0.2], [0.5, 0.2], [0.5, 0.5], [0.2, 0.5]]
    old = ads.SimplexMesh(
        [*square, [-0.1, -0.05], [-0.05, -0.05], [-0.05, -0.1]],
        [[0, 1, 2], [0, 2, 3], [4, 6, 5]],
    )
    new = ads.SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    assert old.locator.nearest(new.points[new.cells].mean(axis=1))[2] == 0.0
    fields, by_cell = {"u": np.arange(7.0)}, {"e": np.arange(3.0)}
    whole = ads.transfer_fields(old, new, fields=fields, cell_fields=by_cell, method="interpolate")
    assert whole.fields["u"][0] == 5.0

    def run(comm):
        a = PartitionedMesh.from_serial(old, np.array([0, 0, 1]), comm)
        b = PartitionedMesh.from_serial(new, np.array([0]), comm)
        made = ads.transfer_fields(
            a, b, method="interpolate",
            fields={"u": fields["u"][a.global_ids]}, cell_fields={"e": by_cell["e"][a.cell_ids]},
        )  # fmt: skip
        return made.fields["u"]

    made = SimulatedCommunicator.run(2, run)[0]
    np.testing.assert_allclose(made, whole.fields["u"], rtol=0.0, atol=1e-12)


def rising(part):
    """Return sizes that grow away from a line."""
    return 0.1 + np.abs(part.points[:, 0])


def at_shared_node(part, value):
    """Return 1, and another value at one node that other ranks hold, too."""
    h = np.ones(part.n_points)
    h[part.shared.every[0]] = value
    return h


# On rank 2 something is wrong or differs: functions of a part and of whether it is rank 2.
WRONG = {
    "h0": (lambda m, bad: limit_gradient(m, -1.0 if bad else 1.0, 0.3), "rank 2: h0 must be pos"),
    "g": (lambda m, bad: limit_gradient(m, 1.0, -0.1 if bad else 0.3), "rank 2: g must be finite"),
    "other g": (lambda m, bad: limit_gradient(m, 1.0, 0.5 if bad else 0.3), "g must be the same"),
    "g of nodes and of cells": (
        lambda m, bad: limit_gradient(m, 1.0, np.full(m.n_cells if bad else m.n_points, 0.3)),
        "g must be an array per node on all ranks, or per cell on all ranks",
    ),
    "g at a shared node": (
        lambda m, bad: limit_gradient(m, 1.0, at_shared_node(m, 1.0 + 1e-6 * bad)),
        "g must be the same on all ranks that hold a node, got 1.0 and 1.000001 at global node",
    ),
    "other method": (
        lambda m, bad: limit_gradient(m, 1.0, 0.3, method="fast-marching" if bad else "auto"),
        "method must be the same on all ranks",
    ),
    "h0 at a shared node": (
        lambda m, bad: limit_gradient(m, at_shared_node(m, 1.0 + 1e-6 * bad), 0.3),
        "h0 must be the same on all ranks that hold a node, got 1.0 and 1.000001 at global node",
    ),
    "size at a shared node": (
        lambda m, bad: ads.remesh(m, np.full(m.n_points, 0.2 + 0.1 * bad)),
        "size must be the same on all ranks that hold a node",
    ),
    "other points": (
        lambda m, bad: limit_gradient(m, 1.0, 0.3, point_sources=([[0.5, 0.5]], [0.1 + 0.1 * bad])),
        "point_sources must be the same on all ranks",
    ),
    "points on one rank only": (
        lambda m, bad: limit_gradient(
            m, 1.0, 0.3, point_sources=([[0.5, 0.5]], [0.1]) if bad else None
        ),
        "point_sources must be the same on all ranks",
    ),
    "other g(h)": (
        lambda m, bad: limit_gradient(m, rising(m), lambda h: 0.3 + 0.1 * bad * h),
        r"g\(h\) must be the same on all ranks",
    ),
    "g(h) and g": (
        lambda m, bad: limit_gradient(m, rising(m), 0.3 if bad else lambda h: 0.3 + 0 * h),
        "g must be the same on all ranks",
    ),
    "values": (
        lambda m, bad: ads.size_from_hessian(m, m.points[:, 0] + bad, tolerance=0.1),
        "values must be the same on all ranks that hold a node",
    ),
    "max_refine": (
        lambda m, bad: ads.adapt(m, np.ones(m.n_cells), elements=99, max_refine=4 + bad),
        "max_refine must be the same on all ranks",
    ),
    "initial": (lambda m, _: limit_gradient(m, 1.0, 0.3, initial=1.0), "rank 0: initial and"),
    "exact": (
        lambda m, _: limit_gradient(m, 1.0, np.full(m.n_points, 0.3), method="exact"),
        "method='exact' needs one number g",
    ),
    "info": (
        lambda m, bad: (limit_gradient.with_info if bad else limit_gradient)(m, 1.0, 0.3),
        "with_info must be the same on all ranks",
    ),
    "function": (
        lambda m, bad: ads.size_from_sources(m, lambda x: np.full(len(x), 0.5 - bad)),
        r"rank 2: sources\[0\]\(points\)",
    ),
    "tag": (
        lambda m, _: ads.size_from_sources(m, ads.RegionSource(9, 0.1)),
        "sources: tags must be among the cell_tags 1, 2, got 9",
    ),
    "fields": (
        lambda m, bad: ads.transfer_fields(m, m, fields={"v" if bad else "u": m.owner}),
        "fields must be the same on all ranks",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_bad_input_on_one_rank_is_reported_by_all(name):
    function, message = WRONG[name]

    def work(part):
        with pytest.raises(ValueError, match=f"^{message}"):
            function(part, part.ranks.rank == 2)

    on_ranks(WITH_TAGS["structured"], None, SIZE, work)


def test_g_of_parts_with_as_many_cells_as_nodes_is_that_of_the_nodes():
    """Of the cells it would differ between the ranks, so it is refused instead of misread."""
    points = [[0, 0], [3, 0], [3, 1], [0, 1], [1, 0.5], [2, 0.5]]
    cells = np.array([[0, 1, 4], [1, 5, 4], [1, 2, 5], [2, 4, 5], [2, 3, 4], [3, 0, 4]])
    points += [[x, -y] for x, y in points[2:]]
    mesh = ads.SimplexMesh(points, [*cells, *np.where(cells > 1, cells + 4, cells)])
    h0, g = np.full(mesh.n_points, np.inf), np.linspace(0.1, 0.5, mesh.n_cells)
    h0[3] = 0.1
    whole = limit_gradient(mesh, h0, g[: mesh.n_points])

    def work(part):
        bound = h0[part.global_ids]
        assert part.n_points == part.n_cells
        with pytest.raises(ValueError, match=r"^g must be the same on all ranks"):
            limit_gradient(part, bound, g[part.cell_ids])
        return limit_gradient(part, bound, g[part.global_ids])

    results, parts = on_ranks(mesh, np.repeat([0, 1], 6), 2, work)
    for found, part in zip(results, parts, strict=True):
        np.testing.assert_allclose(found, whole[part.global_ids], rtol=1e-12)


def counts(function, mesh, rank_of=None):
    """Return what each rank sends in a first call, and in a second one."""

    def work(part):
        found = []
        for _ in range(2):
            traffic = part.ranks.traffic
            before = traffic.exchanges, traffic.reductions, traffic.bytes_sent
            function(part)
            after = traffic.exchanges, traffic.reductions, traffic.bytes_sent
            found.append(tuple(np.subtract(after, before).tolist()))
        return found

    return on_ranks(mesh, rank_of, SIZE, work)[0]


@pytest.mark.parametrize(
    ("n", "kind", "expected"), [(20, "two", 0), (8, "two", 1), (20, "noise", 2)]
)
def test_exchanges_of_the_exact_method(n, kind, expected):
    """None for few bounds, else one; one more if bounds are linear; seven for the boundary."""
    mesh = jittered_square(n, 840)
    h0 = bounds(mesh, kind, np.random.default_rng(841))
    found = counts(lambda m: limit_gradient(m, h0[m.global_ids], 0.3, method=Exact()), mesh)
    assert {(first[0], again[0]) for first, again in found} == {(7 + expected, expected)}
    if kind == "two":  # each source, six numbers, goes to at most all others
        assert sum(again[2] for _, again in found) <= 2 * (SIZE - 1) * 6 * 8
