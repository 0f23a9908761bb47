"""Preparation of meshes for a generator, and restoration of what it drops."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._pickling import once
from adaptsize.background import SimplexMesh
from adaptsize.background.merging import first_at_place, nodes_there
from adaptsize.background.topology import (
    compacted,
    have_different_nodes,
    marked,
    places_among,
    regions_beside,
    unique_rows,
)
from adaptsize.errors import BackendError
from adaptsize.geometry.repair import Repair, repair_triangles
from adaptsize.metrics import Metric
from adaptsize.remeshing.acceptance import refuse_other_domain
from adaptsize.remeshing.protocol import NO_TAG, Arrays, Facets, MeshingProblem, Task, mesh_of
from adaptsize.remeshing.sizing import MetricAt, Size
from adaptsize.typing import FloatArray, IndexArray, IntArray

#: Points of a surface closer than this times the diagonal are merged.
MERGE_DISTANCE = 1e-9


class RepairedMesh(NamedTuple):
    """A mesh without the defects that generators do not accept."""

    mesh: SimplexMesh
    nodes: IntArray
    """``nodes[i]`` is the node of the given mesh for node i, -1 where facets of bodies meet."""
    node_map: IntArray
    """``node_map[j]`` is the node for node j of the given mesh, or -1 if it was dropped."""
    repairs: str = ""
    """What was repaired on a surface."""


def repair_mesh(mesh: SimplexMesh) -> RepairedMesh:
    """Return the mesh without unused nodes and with positive full-dimensional cells.

    Surface triangulations are repaired without opening them (see `repair_triangles`): coincident
    points are merged (STL files hold every corner of every triangle), triangles without area
    vanish by topology, duplicates are removed, and nodes on open edges of other triangles are
    joined with these.  Other meshes keep coincident points, because they form slits.
    Point and cell data are dropped.

    The result is kept with the given mesh.  Loops need it again: of the first mesh in each cycle,
    and of each mesh for all that a cycle makes of it.
    """
    return once(mesh, "_repaired", lambda: _repaired(mesh))


def _repaired(mesh: SimplexMesh) -> RepairedMesh:
    if mesh.cell_dim == 2 and mesh.dim == 3:
        return _repaired_surface(mesh)
    cells = np.array(mesh.cells)
    if mesh.cell_dim == mesh.dim:
        inverted = mesh.signed_measures < 0.0
        if mesh.in_a_cell.all() and not inverted.any():
            numbers = np.arange(mesh.n_points, dtype=np.int32)
            bare = mesh.without_data().with_original(None)
            return RepairedMesh(bare, numbers, numbers)
        cells[inverted, :2] = cells[inverted, 1::-1]
    tagged = mesh.tagged_facets
    return _without_unused_nodes(
        mesh, cells, np.arange(mesh.n_cells), np.arange(mesh.n_points), tagged, mesh.facet_tags
    )


def _repaired_surface(mesh: SimplexMesh) -> RepairedMesh:
    within = MERGE_DISTANCE * mesh.diagonal
    target = first_at_place(mesh.points, within)
    found = repair_triangles(mesh.points, target[mesh.cells].astype(np.int32), within)
    if len(found.cells) == 0:
        raise ValueError("mesh must have a triangle with an area, got degenerate triangles only")
    moved = np.flatnonzero(target != np.arange(mesh.n_points))
    target = found.target[target]
    tagged, tags = mesh.tagged_facets, mesh.facet_tags
    if tagged is not None and tags is not None and found.halves:
        parts = [list(found.parts(*ends)) for ends in target[tagged].tolist()]
        tags = np.repeat(tags, [len(one) for one in parts])
        tagged = np.array(list(chain(*parts)), np.int32).reshape(-1, 2)
    texts = [str(one) for one in found.repairs]
    if len(moved):
        merged = Repair(
            "duplicate point{s} merged", len(moved), tuple(mesh.points[moved[0]].tolist())
        )
        texts = [str(merged), *texts]
    repaired = _without_unused_nodes(mesh, found.cells, found.owner, target, tagged, tags)
    return repaired._replace(repairs=f"surface repaired: {', '.join(texts)}" if texts else "")


def _without_unused_nodes(
    mesh: SimplexMesh,
    cells: IntArray,
    owner: IndexArray,
    target: IndexArray,
    tagged: IntArray | None,
    tags: IntArray | None,
) -> RepairedMesh:
    """Return a mesh of new cells, each with the tag of its owner, and its facets with tags.

    ``target`` is the node into which each node was merged.
    """
    nodes, local = compacted(cells)
    node_map = places_among(nodes, mesh.n_points)[target]
    if tagged is not None and tags is not None:
        tagged = node_map[tagged]
        good = (tagged >= 0).all(axis=1) & have_different_nodes(tagged)
        tagged, tags = tagged[good], tags[good]
    repaired = SimplexMesh(
        mesh.points[nodes],
        local,
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[owner],
        tagged_facets=tagged,
        facet_tags=tags,
        tag_names=mesh.tag_names,
    )
    return RepairedMesh(repaired, nodes.astype(np.int32), node_map)


def as_problem(
    task: Task, mesh: SimplexMesh, tolerance: float, required: IntArray | None = None
) -> MeshingProblem:
    """Return the request to remesh a repaired mesh, without sizes.

    ``tolerance`` is over the diagonal, and ``required`` are facets to keep.
    """
    regions, region_tags = number_regions(mesh)
    facets = facets_that_stay(mesh) if required is None else collect_facets(mesh, regions, required)
    return MeshingProblem(task, mesh, tolerance * mesh.diagonal, facets, regions, region_tags)


def facets_that_stay(mesh: SimplexMesh) -> Facets:
    """Return boundary, interface and tagged facets, which are kept with the mesh."""
    return once(
        mesh, "_facets_that_stay", lambda: collect_facets(mesh, number_regions(mesh)[0], None)
    )


def number_regions(mesh: SimplexMesh) -> tuple[IntArray, IntArray]:
    """Return the region (0, 1, ...) of each cell and the tag of each region."""
    if mesh.cell_tags is None:
        return np.zeros(mesh.n_cells, np.int32), np.zeros(1, np.int32)
    tags, regions = np.unique(mesh.cell_tags, return_inverse=True)
    return regions.reshape(-1).astype(np.int32), tags


def collect_facets(mesh: SimplexMesh, regions: IntArray, required: IntArray | None) -> Facets:
    """Return boundary, interface, tagged and required facets.

    Parameters
    ----------
    mesh : SimplexMesh
    regions : int32[n_cells]
    required : int32[n, cell_dim] or None
        Facets to keep, as node numbers of ``mesh``.

    Raises
    ------
    ValueError
        If a required facet is not a facet of the mesh.
    """
    n = len(mesh.facets)
    lowest, highest = regions_beside(mesh.cell_facets, regions, n)
    between = (mesh.facet_cell_counts != 2) | (lowest != highest)
    tags = np.full(n, NO_TAG)
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        number = facet_numbers(mesh, mesh.tagged_facets)
        tags[number[number >= 0]] = mesh.facet_tags[number >= 0]
    is_required = np.zeros(n, bool)
    if required is not None:
        number = facet_numbers(mesh, required)
        if (number < 0).any():
            first = int(np.argmax(number < 0))
            raise ValueError(
                f"required_facets must be facets of the mesh, got required_facets[{first}]"
            )
        is_required[number] = True
    matters = between | (tags != NO_TAG) | is_required
    # Facets with the same tag but different adjacent regions form separate groups.
    keys = np.column_stack([tags, lowest, highest, between, is_required])[matters]
    unique, groups = np.unique(keys, axis=0, return_inverse=True)
    return Facets(
        mesh.facets[matters],
        groups.reshape(-1).astype(np.int32),
        is_required[matters],
        unique[:, 0],
        bool((matters & ~between).any()),
    )


def facet_numbers(mesh: SimplexMesh, facets: IntArray) -> npt.NDArray[np.intp]:
    """Return the row of each given facet in ``mesh.facets``, or -1 if it is not among them."""
    exists = ((facets >= 0) & (facets < mesh.n_points)).all(axis=1)
    rows = np.concatenate([mesh.facets, facets[exists]])
    number = unique_rows(rows, mesh.n_points)[1]
    row_of = np.full(int(number.max()) + 1, -1, np.intp)
    row_of[number[: len(mesh.facets)]] = np.arange(len(mesh.facets))
    found = np.full(len(facets), -1, np.intp)
    found[exists] = row_of[number[len(mesh.facets) :]]
    return found


class Frame(NamedTuple):
    """The middle and the scale of a part."""

    origin: FloatArray
    """float64[dim]"""
    scale: float
    """Length of the diagonal of its bounding box."""

    @classmethod
    def around(cls, mesh: SimplexMesh) -> Frame:
        """Return the frame of a mesh."""
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        scale = float(np.linalg.norm(high - low))
        return cls(low + 0.5 * (high - low), scale if scale > 0.0 else 1.0)

    def to_own(self, points: FloatArray) -> FloatArray:
        """Return points in the coordinates of the part."""
        return (points - self.origin) / self.scale

    def from_own(self, points: FloatArray) -> FloatArray:
        """Return points in the given coordinates."""
        return self.origin + self.scale * points

    def mesh(self, mesh: SimplexMesh) -> SimplexMesh:
        """Return a mesh in the coordinates of the part, without fields."""
        return mesh.moved(self.to_own(mesh.points))

    def size(self, size: Size) -> Size:
        """Return a size as a function of points in the coordinates of the part."""

        def own(points: FloatArray) -> FloatArray:
            return size(self.from_own(points)) / self.scale

        return own

    def metric(self, metric: MetricAt) -> MetricAt:
        """Return a metric as a function of points in the coordinates of the part."""

        def own(points: FloatArray) -> Metric:
            return metric(self.from_own(points)).scaled(1.0 / self.scale)

        return own

    def restored(self, new: SimplexMesh, old: SimplexMesh) -> SimplexMesh:
        """Return a mesh in the given coordinates; nodes that have not moved are exactly those."""
        points = self.from_own(new.points)
        # Generators that scale their input move nodes that they keep by rounding, by less than
        # this.
        number = nodes_there(self.to_own(old.points), new.points, 1e-13)
        kept = number >= 0
        points[kept] = old.points[number[kept]]
        return new.moved(points)


def restore(raw: Arrays, problem: MeshingProblem, backend: str) -> SimplexMesh:
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
    new, nodes = _checked(raw, backend)
    refuse_other_domain(new, problem, backend)
    old, is_filled = problem.mesh, problem.task == "surface to tetrahedra"
    if old.tag_names:
        new = replace(new, tag_names=old.tag_names)
    if old.cell_tags is not None and not is_filled:
        regions = raw.get("regions")
        if regions is None:
            centroids = new.points[new.cells].mean(axis=1)
            regions = problem.regions[old.locator.nearest(centroids)[0]]
        new = replace(new, cell_tags=problem.region_tags[regions])
    if (old.cell_tags if is_filled else old.tagged_facets) is None:
        return new
    if "facets" in raw:
        found, tags = nodes[raw["facets"]], problem.facets.tag_of_group[raw["facet_groups"]]
    else:
        found, tags = _tags_there(new, problem)
    tagged = (tags != NO_TAG) & (found >= 0).all(axis=1)
    tags = tags[tagged].astype(np.int32)
    return replace(new, tagged_facets=found[tagged], facet_tags=tags)


def _checked(raw: Arrays, backend: str) -> tuple[SimplexMesh, IntArray]:
    """Return a mesh of used nodes and positive cells, and the map of the nodes."""
    points, cells = np.asarray(raw["points"], np.float64), np.array(raw["cells"], np.int32)
    if len(cells) == 0:
        raise BackendError(f"{backend} returned an empty mesh")
    if cells.min() < 0 or cells.max() >= len(points):
        raise BackendError(f"{backend} returned a mesh with indices out of range")
    if marked(cells.ravel(), len(points)).all() and np.isfinite(points).all():
        mesh, new_number = mesh_of(raw), np.arange(len(points), dtype=np.int32)
    else:
        used, local = compacted(cells)
        if not np.isfinite(points[used]).all():
            raise BackendError(f"{backend} returned coordinates that are not finite")
        mesh, new_number = SimplexMesh(points[used], local), places_among(used, len(points))
    if mesh.cell_dim < mesh.dim:
        return mesh, new_number
    if mesh.signed_measures.sum() < 0.0:  # some generators use the opposite orientation
        mesh = replace(mesh, cells=np.column_stack([mesh.cells[:, [1, 0]], mesh.cells[:, 2:]]))
    count = int((mesh.signed_measures <= 0.0).sum())
    if count:
        raise BackendError(f"{backend} returned {count} inverted or flat cells")
    return mesh, new_number


def _tags_there(
    new: SimplexMesh, problem: MeshingProblem
) -> tuple[IntArray, npt.NDArray[np.int64]]:
    """Return the boundary and interface facets with the tags of the nearest old facets."""
    if problem.task == "surface to tetrahedra":
        old, tag_of_old = problem.mesh, np.asarray(problem.mesh.cell_tags, np.int64)
    else:
        facets = problem.facets
        old = SimplexMesh(problem.mesh.points, facets.nodes)
        tag_of_old = facets.tag_of_group[facets.groups]
    between = new.facet_cell_counts == 1
    if new.cell_tags is not None:
        lowest, highest = regions_beside(new.cell_facets, new.cell_tags, len(new.facets))
        between |= lowest != highest
    found = new.facets[between]
    nearest = old.locator.nearest(new.points[found].mean(axis=1))[0]
    return found, tag_of_old[nearest]
