"""Bores, bosses and text below a length are removed, and nothing else."""

import numpy as np
import pytest
from meshes import random_sphere
from scipy.spatial.transform import Rotation
from solids import box, hull

from adaptsize import SimplexMesh
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.remeshing import remove_details

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("manifold3d")

PLATE = ((0.0, 0.0, 0.0), (10.0, 8.0, 2.0))


def block(centre, extents):
    return trimesh.creation.box(extents).apply_translation(centre)


def rod(radius, height, centre, sections=24):
    return trimesh.creation.cylinder(radius, height, sections=sections).apply_translation(centre)


def less(*parts):
    return trimesh.boolean.difference([block(*PLATE), *parts])


def more(*parts):
    return trimesh.boolean.union([block(*PLATE), *parts])


def ring(z):
    return trimesh.boolean.difference([rod(1.0, 0.2, (2, 0, z)), rod(0.7, 0.4, (2, 0, z))])


def letter(z):
    """An E with strokes of 0.3, engraved by 0.1 or as high."""
    bars = [block((-2.0, y, z), (1.5, 0.3, 0.2)) for y in (-1.0, 0.0, 1.0)]
    return trimesh.boolean.union([block((-2.6, 0.0, z), (0.3, 2.3, 0.2)), *bars])


def as_mesh(part):
    return SimplexMesh(part.vertices, part.faces)


def volume_of(mesh):
    return float(cone_measures(mesh, mesh.points.mean(axis=0)).sum())


PARTS = {  # the part, and volumes without what is smaller than 0.5
    "bore": (lambda: less(rod(0.2, 4.0, (1, 1, 0))), 160.0, ["cavity"]),
    "blind bore": (lambda: less(rod(0.2, 1.0, (1, 1, 1))), 160.0, ["cavity"]),
    "pin": (lambda: more(rod(0.2, 6.0, (1, 1, 3))), 160.0, ["boss"]),
    "engraved O": (lambda: less(ring(1.0)), 160.0, ["cavity"]),
    "embossed O": (lambda: more(ring(1.0)), 160.0, ["boss"]),
    "engraved E": (lambda: less(letter(1.0)), 160.0, ["cavity"]),
    "embossed E": (lambda: more(letter(1.0)), 160.0, ["boss"]),
    "text": (lambda: less(letter(1.0), ring(1.0)), 160.0, ["cavity", "cavity"]),
    "bore in the floor of a pocket": (
        lambda: less(block((0, 0, 1), (4, 4, 1)), rod(0.2, 4.0, (0, 0, 0))),
        152.0,
        ["cavity"],
    ),
    "small and large bores": (
        lambda: less(rod(0.2, 4.0, (-2, 0, 0)), block((2, 0, 0), (0.8, 0.8, 4))),
        160.0 - 2.0 * 0.8**2,
        ["cavity"],
    ),
}
KEPT = {
    "wide bore": lambda: less(rod(0.3, 4.0, (1, 1, 0))),
    "wide pocket, not deep": lambda: less(block((0, 0, 1), (4, 4, 0.2))),
    "wide bore in a thin plate": lambda: trimesh.boolean.difference(
        [block((0, 0, 0), (10, 8, 0.2)), rod(1.0, 4.0, (1, 1, 0))]
    ),
    "slot to the edge": lambda: less(block((5, 0, 1), (4, 0.3, 1))),
    "thin fin along the plate": lambda: more(block((0, 0, 1.5), (10, 0.3, 2))),
}


@pytest.mark.parametrize("name", PARTS)
def test_what_is_smaller_is_removed_exactly(name):
    part, volume, kinds = PARTS[name]
    mesh = as_mesh(part())
    found = remove_details(mesh, 0.5)
    assert found.mesh.is_closed
    assert volume_of(found.mesh) == pytest.approx(volume, rel=1e-9)
    assert [detail.kind for detail in found.details] == kinds
    change = sum(d.volume if d.kind == "cavity" else -d.volume for d in found.details)
    assert volume_of(mesh) + change == pytest.approx(volume, rel=1e-9)
    assert f"removed {kinds.count('cavity')} cavit" in str(found)
    kept = remove_details(mesh, 0.1)
    assert kept.details == ()
    assert volume_of(kept.mesh) == pytest.approx(volume_of(mesh), rel=1e-12)


@pytest.mark.parametrize("name", KEPT)
def test_what_a_ball_of_the_length_passes_is_kept(name):
    mesh = as_mesh(KEPT[name]())
    found = remove_details(mesh, 0.5)
    assert found.details == ()
    assert found.mesh.n_cells == mesh.n_cells
    assert str(found) == "no details removed"


def test_bodies_and_cavities_of_their_own_are_no_details():
    others = [block((20.0, 0.0, 0.0), (0.1, 0.1, 0.1)), block((0.0, 3.0, 0.5), (0.2, 0.2, 0.2))]
    others[1].invert()
    others.append(
        trimesh.boolean.difference([block((30, 0, 0), (1, 1, 1)), rod(0.1, 2, (30, 0, 0))])
    )
    part = trimesh.util.concatenate([less(rod(0.1, 9.0, (2.0, 1.0, 0.0))), *others])
    made = remove_details(as_mesh(part), 1.5)
    assert [detail.kind for detail in made.details] == ["cavity", "cavity"]
    blocks = trimesh.util.concatenate([block(*PLATE), *others[:2], block((30, 0, 0), (1, 1, 1))])
    assert volume_of(made.mesh) == pytest.approx(blocks.volume, rel=1e-12)


def test_a_ball_on_a_thin_stem_loses_the_stem_only():
    ball = trimesh.creation.icosphere(3, 1.0).apply_translation((0, 0, 4.5))
    mesh = as_mesh(more(rod(0.2, 4.0, (0, 0, 2)), ball))
    found = remove_details(mesh, 0.5)
    assert len(found.details) == 1
    assert found.details[0].volume < 0.4
    assert volume_of(found.mesh) == pytest.approx(160.0 + ball.volume, rel=1e-3)


@pytest.mark.parametrize("seed", [7, 8, 9])
def test_place_unit_and_numbering_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    mesh = as_mesh(less(rod(0.2, 4.0, (-2, 0, 0)), ring(1.0), rod(0.6, 4.0, (-4, 2, 0))))
    expected = remove_details(mesh, 0.5)
    scale, turn = float(rng.uniform(1e-3, 1e3)), Rotation.random(random_state=seed).as_matrix()
    order = rng.permutation(mesh.n_points)
    cells = np.argsort(order)[mesh.cells][rng.permutation(mesh.n_cells)]
    moved = SimplexMesh(scale * mesh.points[order] @ turn.T + scale * rng.normal(size=3), cells)
    found = remove_details(moved, 0.5 * scale)
    assert found.mesh.is_closed
    assert volume_of(found.mesh) == pytest.approx(scale**3 * volume_of(expected.mesh), rel=1e-9)
    volumes = sorted(detail.volume for detail in found.details)
    assert volumes == pytest.approx(
        sorted(scale**3 * detail.volume for detail in expected.details), rel=1e-6
    )


def test_tags_of_the_facets_that_stay_are_kept():
    part = as_mesh(less(rod(0.2, 4.0, (1, 1, 0))))
    tags = 1 + (part.points[part.cells].mean(axis=1)[:, 2] > 0.0)
    found = remove_details(SimplexMesh(part.points, part.cells, cell_tags=tags), 0.5)
    made = found.mesh
    high = made.points[made.cells].mean(axis=1)[:, 2] > 0.0
    known = made.cell_tags > 0
    assert (made.cell_tags[known] == 1 + high[known]).all()
    assert made.measures[~known].sum() == pytest.approx(2 * np.pi * 0.2**2, rel=0.02)  # the caps


@pytest.mark.parametrize("mesh", [random_sphere(200, 3), box(1.0, 2.0, 3.0)])
def test_shapes_without_details_come_back_as_they_are(mesh):
    found = remove_details(mesh, 0.5)
    assert found.details == ()
    assert found.mesh.n_cells == mesh.n_cells


def test_open_surfaces_and_bad_lengths_are_refused():
    cube = hull([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    with pytest.raises(ValueError, match="surface must be closed for details to be removed"):
        remove_details(SimplexMesh(cube.points, cube.cells[1:]), 0.1)
    with pytest.raises(ValueError, match="length must be finite and > 0, got 0"):
        remove_details(cube, 0.0)
