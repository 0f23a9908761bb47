"""Tetrahedra that Mmg cannot adapt, made anew from their boundary and the interfaces of regions."""

from dataclasses import replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import cut_out
from adaptsize.background.topology import compacted, places_among
from adaptsize.errors import BackendError
from adaptsize.geometry.distance.orientation import oriented
from adaptsize.geometry.enclosed import is_oriented
from adaptsize.remeshing import netgen
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.preparation import as_problem, restore
from adaptsize.remeshing.protocol import NO_TAG, MeshingProblem
from adaptsize.remeshing.registry import available_backends
from adaptsize.typing import FloatArray, IntArray


def refilled(problem: MeshingProblem, run: IsolatedRunner) -> SimplexMesh:
    """Return tetrahedra of the same domain whose inside does not come from the given ones.

    Mmg fails on meshes with cells that are turned inside out or overlap, as hexahedra divided into
    tetrahedra may have where they are skew.  It starts from all cells.  Here Netgen fills each
    region between its boundary facets, which stay, and so do interfaces and tagged facets.  Mmg
    adapts these tetrahedra to the sizes.  If one of them fails, or facets inside of a region have
    tags, fTetWild makes the mesh from the facets.

    Parameters
    ----------
    problem : MeshingProblem
        To remesh tetrahedra.
    run : IsolatedRunner

    Raises
    ------
    BackendError
        If fTetWild fails, too, or cannot do this: it follows no metric and keeps no facets.
    """
    mmg, tetwild = (available_backends()[name] for name in ("mmg", "tetwild"))
    try:
        inner = _filled_regions(problem, run)
        return restore(mmg.solve(inner, replace(run, backend="mmg")), inner, "mmg")
    except BackendError:
        if problem.metric is not None or problem.facets.required.any():
            raise
    raw = tetwild.solve(problem, replace(run, backend="tetwild"))
    return restore(raw, problem, "tetwild")


def _filled_regions(problem: MeshingProblem, run: IsolatedRunner) -> MeshingProblem:
    """Return the request to adapt the tetrahedra with which Netgen fills each region.

    Raises
    ------
    BackendError
        If it cannot.
    """
    mesh, facets = problem.mesh, problem.facets
    if facets.has_free:
        raise BackendError("netgen cannot keep facets inside of a region")
    points: list[FloatArray] = [mesh.points]
    cells: list[IntArray] = []
    n = mesh.n_points
    for region in range(len(problem.region_tags)):
        part, of_part = cut_out(mesh.points, mesh.cells[problem.regions == region])
        skin = part.boundary()
        surface = skin.mesh if is_oriented(skin.mesh) else oriented(skin.mesh)
        made = netgen.fill(surface, run)
        n_new = len(made["points"]) - surface.n_points
        number = np.concatenate([of_part[skin.nodes], n + np.arange(n_new)])
        points.append(made["points"][surface.n_points :])
        cells.append(number[made["cells"]].astype(np.int32))
        n += n_new
    regions = np.repeat(np.arange(len(cells)), [len(one) for one in cells])
    nodes, local = compacted(np.concatenate(cells))
    place = places_among(nodes, n)
    tags = facets.tag_of_group[facets.groups]
    tagged = tags != NO_TAG
    volume = SimplexMesh(
        np.concatenate(points)[nodes],
        local,
        cell_tags=None if mesh.cell_tags is None else problem.region_tags[regions],
        tagged_facets=place[facets.nodes[tagged]] if tagged.any() else None,
        facet_tags=tags[tagged] if tagged.any() else None,
        tag_names=mesh.tag_names,
    )
    required = place[facets.nodes[facets.required]] if facets.required.any() else None
    plain = as_problem("tetrahedra", volume, problem.tolerance / volume.diagonal, required)
    return replace(
        plain,
        size=problem.size,
        size_nodes=problem.size_nodes,
        metric=problem.metric,
        ridges=place[problem.ridges],
    )
