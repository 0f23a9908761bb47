"""One adaptation cycle of a distributed mesh: requests and decisions are those of one process."""

import numpy as np
import pytest
from meshes import jittered_square, random_sphere
from partitions import on_ranks, partition
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize import CartesianGrid, SimplexMesh, adapt
from adaptsize.adaptation.next_sizes import bound_by_tolerance
from adaptsize.adaptation.report import boundary_distance, tags_of
from adaptsize.background.splitting import bisect_edges
from adaptsize.errors import TooManyElementsError
from adaptsize.sizes import predict


def _indicator(mesh, rows=slice(None)):
    x = mesh.points[mesh.cells[rows]].mean(axis=1)
    return np.exp(-6.0 * np.linalg.norm(x - mesh.points.min(axis=0), axis=1) / mesh.diagonal)


def _no_mesh(*args, **options):
    raise AssertionError("no mesh is to be made")


def _ball():
    """Tetrahedra in a ball of radius 1 with edges of about .3."""
    steps = np.arange(-0.8, 0.81, 0.28)
    inner = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    inner = inner + np.random.default_rng(76).uniform(-0.02, 0.02, inner.shape)
    inner = inner[np.linalg.norm(inner, axis=1) < 0.78]
    points = np.vstack([random_sphere(170, 77).points, inner])
    return SimplexMesh(points, Delaunay(points).simplices)


@pytest.mark.parametrize("kind", ["random", "some empty"])
@pytest.mark.parametrize("mesh", [jittered_square(9, 74), _ball()])
def test_sizes_from_bounds_are_those_of_one_process(mesh, kind, monkeypatch):
    monkeypatch.setattr("adaptsize.adaptation.new_mesh.remesh", _no_mesh)
    rng = np.random.default_rng(75)
    # About the sizes that the mesh has, so that it is kept.
    of_size_1 = predict(mesh, np.ones(mesh.n_points)).cells
    size = (1.1 if mesh.dim == 3 else 1.0) * (of_size_1 / mesh.n_cells) ** (1.0 / mesh.dim)
    h0 = size * rng.uniform(0.95, 1.1, mesh.n_points)
    options = {"g": 0.05, "hmin": 0.01, "enough": 0.0, "boundary_tolerance": 5.7e-3}
    whole = ads.adapt(mesh, h0=h0, **options, backend="mmg")
    if mesh.dim == 3:
        bound = bound_by_tolerance(mesh, 5.7e-3)
        assert 0.2 < (bound < h0).mean() < 0.8
        assert (whole.size.values <= bound).all()

    def run(part):
        result = adapt(part, h0=h0[part.global_ids], **options)
        return result, part.gather_nodal(result.size)

    found, _ = on_ranks(mesh, partition(mesh, kind, 4, rng), 4, run)
    assert (whole.size.values < h0).any()
    assert np.array_equal(found[0][1], whole.size.values)
    for result, _ in found:
        report = result.report
        assert report.share_in_band == pytest.approx(whole.report.share_in_band, rel=1e-12)
        assert not result.remeshed
        assert result.reason == whole.reason
        assert report.predicted_elements == pytest.approx(whole.report.predicted_elements)


@pytest.mark.parametrize(
    ("dim", "n", "target", "how"), [(2, 9, 400, "parts"), (3, 5, 2000, "gather")]
)
def test_new_mesh_fields_and_report(dim, n, target, how):
    box = CartesianGrid((0.0,) * dim, 1.0 / (n - 1), (n,) * dim).mesh
    below = box.points[box.cells].mean(axis=1)[:, 1] < 0.5
    carried = {"old": box.points[:, 0]}  # of which nothing is to warn
    mesh = SimplexMesh(box.points, box.cells, cell_tags=1 + below, point_data=carried)
    eta, slope = _indicator(mesh), np.arange(1.0, dim + 1)

    def run(part):
        result = adapt(
            part, eta[part.cell_ids], elements=target, how=how,
            fields={"u": part.points @ slope}, cell_fields={"c": eta[part.cell_ids]},
        )  # fmt: skip
        new = result.mesh
        np.testing.assert_allclose(result.fields["u"], new.points @ slope, atol=1e-12)
        measures = np.zeros(0) if new.mesh is None else new.mesh.measures
        integral = new.ranks.allreduce(float(measures @ result.cell_fields["c"]), "sum")
        return result, integral, new.gather()

    results, _ = on_ranks(mesh, None, 3, run)
    whole = ads.adapt(mesh, eta, elements=target, backend="mmg")
    result, integral, new = results[0]
    report = result.report
    assert all(repr(other.report) == repr(report) for other, _, _ in results)  # nan is not nan
    assert result.remeshed
    assert not result.converged
    assert result.reason == whole.reason
    assert report.budget_met
    assert new.n_cells == report.n_cells_after
    assert report.predicted_elements == pytest.approx(target, rel=3e-3)
    assert report.error == pytest.approx(np.linalg.norm(eta), rel=1e-12)
    assert integral == pytest.approx(mesh.measures @ eta, rel=1e-12)
    assert report.measure_after == pytest.approx(1.0, abs=1e-12)
    assert report.boundary_distance < 1e-12
    assert report.lost_tags == ()
    assert new.measures[new.cell_tags == 2].sum() == pytest.approx(0.5, abs=1e-9)
    text = str(result)
    assert f" -> {new.n_cells} {'triangles' if dim == 2 else 'tetrahedra'}" in text
    assert f"requested {target}" in text
    before, after = report.integrals["c"]
    assert after == pytest.approx(before, rel=1e-12)
    assert before == pytest.approx(mesh.measures @ eta, rel=1e-12)


def test_mesh_within_tolerance_is_returned_itself(monkeypatch):
    monkeypatch.setattr("adaptsize.adaptation.new_mesh.remesh", _no_mesh)
    mesh = jittered_square(6, 76)
    eta = _indicator(mesh)
    u = np.arange(mesh.n_points)

    def run(part):
        error = np.linalg.norm(eta)
        values = u[part.global_ids]
        result = adapt(part, eta[part.cell_ids], tolerance=1.01 * error, fields={"u": values})
        assert result.mesh is part
        assert np.array_equal(result.fields["u"], values)
        return result

    for result in on_ranks(mesh, None, 2, run)[0]:
        assert result.converged
        assert not result.remeshed
        assert "within the tolerance" in str(result)


def test_lost_tags_and_moved_boundaries_are_found():
    disc = jittered_square(8, 78)
    moved = SimplexMesh(1.1 * disc.points, disc.cells, cell_tags=np.ones(disc.n_cells, int))
    old = SimplexMesh(disc.points, disc.cells, cell_tags=1 + np.arange(disc.n_cells) % 2)

    def run(part):
        rank_of = np.arange(disc.n_cells) % 3
        new = ads.distributed.PartitionedMesh.from_serial(moved, rank_of, part.ranks)
        lost = tags_of(part) - tags_of(new)
        return lost, boundary_distance(part, new), boundary_distance(part, part)

    low, high = disc.points.min(axis=0), disc.points.max(axis=0)
    outside = np.maximum(np.maximum(low - moved.points, moved.points - high), 0.0)
    expected = np.linalg.norm(outside, axis=1).max()
    for lost, distance, none in on_ranks(old, None, 3, run)[0]:
        assert lost == {("cell", 2)}
        assert distance == pytest.approx(expected, rel=1e-12)
        assert none == 0.0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (lambda rank: {"order": 1 + rank}, "order must be the same on all ranks, got 1.0 on rank"),
        (lambda rank: {"nodes": 100}, "exclude each other"),
        (
            lambda rank: {"elements": None, "nodes": 100 + rank},
            "nodes must be",
        ),
        (lambda rank: {"g": None if rank else 0.2}, "g must be the same"),
        (lambda rank: {"how": ("parts", "gather")[rank]}, "how must be the same"),
        (lambda rank: {"fields": [{}, {"u": np.ones(0)}][rank]}, "rank 1: fields"),
        (lambda rank: {"indicator": None}, "indicator or h0 must be given"),
        (lambda rank: {"indicator": None, "h0": 0.1, "tolerance": 1.0}, "needs an indicator"),
    ],
)
def test_bad_arguments_are_reported_by_all_ranks(options, text):
    mesh = jittered_square(5, 80)
    eta = _indicator(mesh)

    def run(part):
        given = {"indicator": eta[part.cell_ids], "elements": 300}
        with pytest.raises(ValueError, match=text):
            adapt(part, **{**given, **options(part.ranks.rank)})

    on_ranks(mesh, None, 2, run)


def test_curved_boundaries_are_those_of_the_first_mesh_of_the_loop():
    first = _ball()
    later = bisect_edges(first, first.edges).mesh
    whole = bound_by_tolerance(later, 1e-3, first)
    boundary = first.boundary().mesh

    def run(part):
        bound = bound_by_tolerance(part, 1e-3, boundary)
        texts = []
        for original in (first, boundary):
            with pytest.raises(TooManyElementsError, match="the curved boundary needs") as found:
                adapt(part, h0=0.5, elements=1000, original=original)
            texts.append(str(found.value))
        return part.gather_nodal(bound), texts

    found, _ = on_ranks(later, None, 3, run)
    np.testing.assert_allclose(found[0][0], whole, rtol=1e-12)
    assert np.isfinite(whole).sum() > len(boundary.points)
    assert len({text for _, texts in found for text in texts}) == 1


def test_parts_keep_the_boundary_of_the_first_mesh():
    mesh = _ball()

    def run(part):
        options = {"h0": 0.35, "boundary_tolerance": 2e-2, "how": "gather"}
        result = adapt(part, **options)
        again = adapt(result.mesh, **options | {"h0": 0.4})
        return result.remeshed, result.original, again.original

    found, _ = on_ranks(mesh, None, 2, run)
    for remeshed, first, later in found:
        assert remeshed
        assert later is first
        assert first.n_cells == mesh.boundary().mesh.n_cells
