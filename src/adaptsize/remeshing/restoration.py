"""Checks of generated meshes, and restoration of their regions and tags."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendError
from adaptsize.remeshing.acceptance import refuse_other_domain
from adaptsize.remeshing.preparation import NO_TAG, Facets
from adaptsize.remeshing.protocol import Problem, RawMesh
from adaptsize.typing import FloatArray, IntArray


def restore(
    raw: RawMesh, problem: Problem, facets: Facets, region_tags: IntArray, backend: str
) -> SimplexMesh:
    """Return a checked mesh with the tags of the old one.

    Regions and tags that the generator lost are looked up in the old mesh.  The region of a cell
    is that at its centroid.  The tag of a boundary facet is that of the facet nearest to its
    centroid.

    Raises
    ------
    BackendError
        If the generator returned no cells, coordinates that are not finite, indices
        out of range, inverted cells, or a mesh of another domain.
    """
    points, cells, nodes = _checked(raw, backend)
    refuse_other_domain(SimplexMesh(points, cells), problem, backend)
    old = problem.mesh
    cell_tags = None
    if old.cell_tags is not None and problem.task != "surface to tetrahedra":
        regions = raw.regions if raw.regions is not None else _regions_there(points, cells, problem)
        cell_tags = region_tags[regions]
    wants_facets = problem.task == "surface to tetrahedra" and old.cell_tags is not None
    if old.tagged_facets is None and not wants_facets:
        return SimplexMesh(points, cells, cell_tags=cell_tags, tag_names=old.tag_names)
    if raw.facets is not None and raw.facet_groups is not None:
        found, tags = nodes[raw.facets], facets.tag_of_group[raw.facet_groups]
    else:
        found, tags = _tags_there(SimplexMesh(points, cells, cell_tags=cell_tags), problem, facets)
    tagged = (tags != NO_TAG) & (found >= 0).all(axis=1)
    return SimplexMesh(
        points,
        cells,
        cell_tags=cell_tags,
        tagged_facets=found[tagged],
        facet_tags=tags[tagged].astype(np.int32),
        tag_names=old.tag_names,
    )


def _checked(raw: RawMesh, backend: str) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the used points, cells with positive measures, and the map of the nodes."""
    points, cells = np.asarray(raw.points, np.float64), np.array(raw.cells, np.int32)
    if len(cells) == 0:
        raise BackendError(f"{backend} returned an empty mesh")
    if cells.min() < 0 or cells.max() >= len(points):
        raise BackendError(f"{backend} returned a mesh with indices out of range")
    used, local = np.unique(cells, return_inverse=True)
    new_number = np.full(len(points), -1, np.int32)
    new_number[used] = np.arange(len(used))
    points, cells = points[used], local.reshape(cells.shape).astype(np.int32)
    if not np.isfinite(points).all():
        raise BackendError(f"{backend} returned coordinates that are not finite")
    mesh = SimplexMesh(points, cells)
    if mesh.cell_dim == mesh.dim:
        volumes = mesh.signed_measures
        if volumes.sum() < 0.0:  # some generators use the opposite orientation
            cells[:, :2] = cells[:, 1::-1]
            volumes = -volumes
        if (volumes <= 0.0).any():
            count = int((volumes <= 0.0).sum())
            raise BackendError(f"{backend} returned {count} inverted or flat cells")
    return points, cells, new_number


def inside_only(raw: RawMesh, problem: Problem) -> RawMesh:
    """Return the cells whose centroids lie in the old mesh."""
    centroids = np.asarray(raw.points)[raw.cells].mean(axis=1)
    distances = problem.mesh.locator.nearest(centroids)[2]
    return RawMesh(raw.points, raw.cells[distances <= 1e-12 * problem.mesh.diagonal])


def _regions_there(points: FloatArray, cells: IntArray, problem: Problem) -> IntArray:
    old_cells = problem.mesh.locator.nearest(points[cells].mean(axis=1))[0]
    return np.asarray(problem.regions[old_cells])


def _tags_there(
    new: SimplexMesh, problem: Problem, facets: Facets
) -> tuple[IntArray, npt.NDArray[np.int64]]:
    """Return the boundary and interface facets with the tags of the nearest old facets."""
    if problem.task == "surface to tetrahedra":
        old, tag_of_old = problem.mesh, np.asarray(problem.mesh.cell_tags, np.int64)
    else:
        old = SimplexMesh(problem.mesh.points, facets.nodes)
        tag_of_old = facets.tag_of_group[facets.groups]
    between = new.facet_cell_counts == 1
    if new.cell_tags is not None:
        tags = np.repeat(new.cell_tags[:, None], new.cell_dim + 1, axis=1)
        lowest = np.full(len(new.facets), np.iinfo(np.int32).max)
        highest = np.full(len(new.facets), np.iinfo(np.int32).min)
        np.minimum.at(lowest, new.cell_facets, tags)
        np.maximum.at(highest, new.cell_facets, tags)
        between = between | (lowest != highest)
    found = new.facets[between]
    nearest = old.locator.nearest(new.points[found].mean(axis=1))[0]
    return found, tag_of_old[nearest]
