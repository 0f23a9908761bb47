"""Remeshing of distributed meshes by Mmg: the domain, tags and sizes are those of serial runs."""

import numpy as np
import pytest
from simulated_ranks import SimulatedCommunicator

from adaptsize import CartesianGrid, SimplexMesh, interpolate, remesh
from adaptsize.distributed import PartitionedMesh
from adaptsize.errors import TooManyElementsError
from adaptsize.quality import size_conformity


def _box(dim, n):
    mesh = CartesianGrid((0.0,) * dim, 1.0 / (n - 1), (n,) * dim).mesh
    points, cells = mesh.points, mesh.cells
    boundary = mesh.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    left = (points[facets][:, :, 0] == 0.0).all(axis=1)
    return SimplexMesh(
        points,
        cells,
        cell_tags=1 + (points[cells].mean(axis=1)[:, 1] > 0.5),
        tagged_facets=facets[left],
        facet_tags=np.full(np.count_nonzero(left), 9),
        tag_names={(dim, 1): "below"},
    )


def _sizes(points):
    finest = 0.06 if points.shape[1] == 2 else 0.22
    return finest + 0.25 * np.linalg.norm(points - 0.5, axis=1)


def _remeshed(mesh, n_ranks, **options):
    def run(comm):
        part = PartitionedMesh.from_serial(mesh, None, comm)
        made = remesh(part, _sizes(part.points), **options)
        quality = size_conformity(made, interpolate(part, _sizes(part.points), made.points))
        return made.gather(), quality, made.n_cells

    return SimulatedCommunicator.run(n_ranks, run)


@pytest.mark.parametrize(("dim", "n"), [(2, 9), (3, 5)])
@pytest.mark.parametrize("how", ["parts", "gather"])
def test_domain_tags_and_sizes(dim, n, how):
    results = _remeshed(_box(dim, n), 3, how=how)
    mesh, quality, _ = results[0]
    assert (mesh.signed_measures > 0.0).all()
    assert mesh.measures.sum() == pytest.approx(1.0, abs=1e-9)
    # No facet is left unmatched where parts met.
    assert mesh.boundary().mesh.measures.sum() == pytest.approx(2.0 * dim, abs=1e-9)
    assert mesh.measures[mesh.cell_tags == 1].sum() == pytest.approx(0.5, abs=1e-9)
    assert mesh.tag_names == {(dim, 1): "below"}
    tagged = SimplexMesh(mesh.points, mesh.tagged_facets)
    assert (mesh.facet_tags == 9).all()
    assert tagged.measures.sum() == pytest.approx(1.0, abs=1e-9)
    assert np.abs(mesh.points[mesh.tagged_facets][:, :, 0]).max() < 1e-12
    assert all(n_cells > 0 for _, _, n_cells in results)
    assert quality.n_cells == mesh.n_cells
    assert quality.share_in_band > 0.8
    assert (quality.at_interfaces is None) == (how == "gather")


def test_second_round_repairs_the_interfaces():
    # Facets of the coarse mesh are frozen in the first round; sizes there are 6 times smaller.
    share = [_remeshed(_box(2, 4), 2, rounds=rounds)[0][1].share_in_band for rounds in (1, 2)]
    assert share[1] > share[0] + 0.05


def test_too_many_elements_of_all_parts_together_are_reported_by_all():
    mesh = _box(2, 5)

    def run(comm):
        part = PartitionedMesh.from_serial(mesh, None, comm)
        with pytest.raises(TooManyElementsError, match="the sizes require about"):
            remesh(part, np.full(part.n_points, 1e-3), max_elements=1000)

    SimulatedCommunicator.run(2, run)
