"""A boundary prepared for inscribed spheres: oriented facets, sectors, feature edges, trees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import interpolate as tree_kernels
from adaptsize._kernels.sectors import fill_facet_cells
from adaptsize._kernels.sphere_trees import fill_slabs
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import tree_over
from adaptsize.background.location import in_space
from adaptsize.geometry import curvature as surfaces
from adaptsize.geometry.distance.orientation import oriented
from adaptsize.typing import BoolArray, FloatArray, IntArray

# A point is on an edge of its cell if its weight is below this.
_ON_EDGE = 1e-9
# Probes on feature edges are moved by this share towards the centroid of the cell.  From there,
# the facet on the other side of the edge is a wall and not in the tangent plane.
_ASIDE = 1e-3


class Probes(NamedTuple):
    """Points of the boundary with a normal each."""

    points: FloatArray
    """float64[n, 3]."""
    starts: FloatArray
    """The same points, moved off feature edges, float64[n, 3]."""
    normals: FloatArray
    """Into the domain, unit, float64[n, 3]."""
    owners: npt.NDArray[np.intp]
    """Owner of each point."""
    cells: IntArray
    """Cell that contains each point, int32[n], in the order of the tree; -1 at nodes."""


class Tree(NamedTuple):
    """Cells in the order of a tree of boxes."""

    points: FloatArray
    cells: IntArray
    boxes: FloatArray
    order: npt.NDArray[np.intp]
    """Original numbers of the cells."""

    @classmethod
    def over(cls, points: FloatArray, cells: IntArray) -> Tree:
        """Return the tree over cells."""
        n_leaves, order = tree_over(points, np.array(cells))
        boxes = np.empty((2 * n_leaves, 6))
        sorted_cells = np.ascontiguousarray(cells[order])
        tree_kernels.fill_boxes(points, sorted_cells, boxes)
        return cls(points, sorted_cells, boxes, order)


@dataclass(frozen=True, eq=False)
class Solid:
    """The boundary data used to find inscribed spheres."""

    boundary: SimplexMesh
    """Oriented: normals outward."""
    tree: Tree
    slabs: FloatArray
    inward: FloatArray
    """Unit normals of the cells in the order of the tree; zero: none."""
    corner_normals: FloatArray
    """Inward unit normals at the corners of the cells, float64[m, k + 1, 3]."""
    sectors: Probes
    """One for each fan of facets around a node between creases; the owners are nodes."""
    is_sharp: BoolArray
    """Whether each facet of the boundary (edge; in the plane node) is a feature edge."""
    bends: Tree
    """Edges (in the plane nodes) where the boundary bends; may be empty."""
    tips: FloatArray
    """Tips of cones, float64[n, 3]."""
    targets: npt.NDArray[np.intp]
    """Boundary node into which each node was merged."""

    @classmethod
    def of(cls, boundary: SimplexMesh, crease_angle: float) -> Solid:
        """Prepare triangles in space or segments in the plane; the angle in degrees."""
        mesh, targets = oriented(boundary)
        parts = (_parts_of_line if mesh.cell_dim == 1 else _parts_of_surface)(mesh, crease_angle)
        points = in_space(mesh.points)
        tree = Tree.over(points, mesh.cells)
        inward = -parts.face_normals[tree.order]
        slabs = np.empty((len(tree.boxes), 5))
        fill_slabs(points, tree.cells, inward, mesh.measures[tree.order], slabs)
        lost: BoolArray = ~np.any(parts.sector_normals, axis=1)
        at_corners = parts.sector_normals[parts.sector] * parts.sign[:, None]
        width = mesh.cells.shape[1]
        # Tips have no normal; use that of the facet.
        at_corners = np.where(
            lost[parts.sector][:, None], np.repeat(parts.face_normals, width, axis=0), at_corners
        )
        nodes = np.zeros(len(lost), np.intp)
        nodes[parts.sector] = mesh.cells.ravel()
        known = np.flatnonzero(~lost)
        known = known[np.argsort(nodes[known], kind="stable")]
        areas = np.bincount(parts.sector, np.repeat(mesh.measures, width), len(lost))
        aside = _ASIDE * _mean_steps(points, mesh.cells, parts.sector, len(lost))
        starts = points[nodes] + np.where(parts.is_open[:, None], aside, 0.0)
        return cls(
            mesh,
            tree,
            slabs,
            inward,
            -at_corners.reshape(-1, width, 3),
            Probes(
                points[nodes[known]],
                starts[known],
                -parts.sector_normals[known],
                nodes[known],
                np.full(len(known), -1, np.int32),
            ),
            parts.is_sharp,
            Tree.over(points, parts.bends),
            points[np.unique(nodes[lost & (areas > 0.0)])],
            targets,
        )

    def probes_at_nodes(self) -> Probes:
        """Return the probes of all nodes: one for each sector."""
        return self._of_nodes(self.targets, np.arange(len(self.targets)))

    def probes_near(self, points: FloatArray) -> Probes:
        """Return probes at the closest points of the boundary.

        The normal is interpolated in the facet.  A point on a feature edge gets one probe for
        each side; a point at a node gets those of the sectors of the node.
        """
        cells, weights, _ = self.boundary.locator.nearest(points)
        nodes = self.boundary.cells[cells, weights.argmax(axis=1)].astype(np.intp)
        at_node = weights.max(axis=1) >= 1.0 - _ON_EDGE
        at_node &= np.isin(nodes, self.sectors.owners)  # tips have none
        parts = [self._of_nodes(nodes[at_node], np.flatnonzero(at_node))]
        rest = np.flatnonzero(~at_node)
        cells, weights = cells[rest], weights[rest]
        facet = self.boundary.cell_facets[cells, weights.argmin(axis=1)]
        on_crease = (weights.min(axis=1) < _ON_EDGE) & self.is_sharp[facet]
        parts.append(self._inside_cells(cells, weights, on_crease, rest))
        if self.boundary.cell_dim == 2:
            facet, cells, weights, rest = (a[on_crease] for a in (facet, cells, weights, rest))
            parts.append(self._across(facet, cells, weights, rest))
        return Probes(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _of_nodes(self, nodes: npt.NDArray[np.intp], owners: npt.NDArray[np.intp]) -> Probes:
        """Return the probes of the sectors of nodes."""
        at = self.sectors
        first = np.searchsorted(at.owners, nodes, "left")
        count = np.searchsorted(at.owners, nodes, "right") - first
        row = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
        owners = np.repeat(owners, count)
        return Probes(at.points[row], at.starts[row], at.normals[row], owners, at.cells[row])

    def _inside_cells(
        self,
        cells: IntArray,
        weights: FloatArray,
        on_crease: BoolArray,
        owners: npt.NDArray[np.intp],
    ) -> Probes:
        """Return the probes of points given by their weights in cells."""
        corners = self.tree.points[self.boundary.cells[cells]]
        points = np.einsum("ij,ijk->ik", weights, corners)
        aside = _ASIDE * on_crease[:, None] * (corners.mean(axis=1) - points)
        normals = np.einsum("ij,ijk->ik", weights, self.corner_normals[cells])
        lengths = np.linalg.norm(normals, axis=1)
        good = lengths > 0.0  # facets without area have no normal
        place = np.empty(len(self.tree.order), np.int32)
        place[self.tree.order] = np.arange(len(place))
        return Probes(
            points[good],
            (points + aside)[good],
            normals[good] / lengths[good, None],
            owners[good],
            place[cells[good]],
        )

    def _across(
        self,
        facet: IntArray,
        cells: IntArray,
        weights: FloatArray,
        owners: npt.NDArray[np.intp],
    ) -> Probes:
        """Return the probes of points on feature edges for the cell on the other side."""
        mesh = self.boundary
        paired = mesh.facet_cell_counts[facet] == 2
        facet, cells, weights, owners = (a[paired] for a in (facet, cells, weights, owners))
        facet_cells = np.empty((len(mesh.facets), 2), np.int32)
        fill_facet_cells(mesh.cell_facets, facet_cells)
        others = facet_cells[facet].sum(axis=1) - cells
        same = mesh.cells[others][:, :, None] == mesh.cells[cells][:, None, :]
        weights = (same * weights[:, None, :]).sum(axis=2)
        return self._inside_cells(others, weights, np.ones(len(others), np.bool_), owners)


class _Parts(NamedTuple):
    face_normals: FloatArray  # outward, zero where degenerate
    sector: npt.NDArray[np.integer]  # of corner width * c + v
    sign: FloatArray  # -1: the cell runs against the normal of its sector
    sector_normals: FloatArray  # outward; zero at the tips of cones
    is_open: BoolArray  # sectors that end at creases
    is_sharp: BoolArray
    bends: IntArray


def _parts_of_surface(surface: SimplexMesh, crease_angle: float) -> _Parts:
    angle = math.radians(crease_angle)
    faces = surfaces._faces_of(surface)
    creases = surfaces._creases_of(surface, faces, angle)
    sectors = surfaces._sectors_of(surface, faces, creases)
    normals = surfaces._normals_of(surface, faces, sectors, angle)
    # Half the angle: a node on such an edge sees both facets under a quarter of it, which
    # is smooth enough, but nodes beside the edge see the other facet under all of it.
    bends = surface.facets[surfaces._creases_of(surface, faces, 0.5 * angle)]
    face_normals = np.where(faces.areas[:, None] > 0.0, faces.normals, 0.0)
    is_open = sectors.ends[:, 0] >= 0
    return _Parts(face_normals, sectors.sector, sectors.sign, normals, is_open, creases, bends)


def _parts_of_line(line: SimplexMesh, crease_angle: float) -> _Parts:
    along = line.points[line.cells[:, 1]] - line.points[line.cells[:, 0]]
    lengths = line.measures
    face_normals = np.zeros((line.n_cells, 3))
    good = lengths > 0.0
    face_normals[good, 0] = along[good, 1] / lengths[good]
    face_normals[good, 1] = -along[good, 0] / lengths[good]
    turn = _turns(line, along)
    # Nodes of the circle through three points: weights of the inverse length.
    weighted = np.zeros((line.n_points, 3))
    for v in range(2):
        np.add.at(weighted, line.cells[good, v], face_normals[good] / lengths[good, None])
    sizes = np.linalg.norm(weighted, axis=1)
    smooth = (turn <= math.radians(crease_angle)) & (sizes > 0.0)
    weighted[smooth] /= sizes[smooth, None]
    nodes = line.cells.ravel()
    corner = np.arange(len(nodes))
    number = np.where(smooth[nodes], nodes, line.n_points + corner)
    _, first, sector = np.unique(number, return_index=True, return_inverse=True)
    normals = np.where(smooth[nodes[first], None], weighted[nodes[first]], face_normals[first // 2])
    bent = np.flatnonzero(np.isfinite(turn) & (turn > math.radians(0.5 * crease_angle)))
    ends = np.flatnonzero(np.isinf(turn))
    bends = np.repeat(np.concatenate([bent, ends])[:, None], 2, axis=1).astype(np.int32)
    return _Parts(
        face_normals, sector.reshape(-1), np.ones(len(nodes)), normals, ~smooth[nodes[first]],
        ~smooth[line.facets[:, 0]], bends,
    )  # fmt: skip


def _turns(line: SimplexMesh, along: FloatArray) -> FloatArray:
    """Return the turning angle of the line at each node, inf unless two segments meet."""
    turn = np.full(line.n_points, np.inf)
    turn[np.bincount(line.cells.ravel(), minlength=line.n_points) == 0] = 0.0
    ring_ptr, ring = line.rings
    passed = np.flatnonzero(np.diff(ring_ptr) == 2)
    one, other = (ring[ring_ptr[passed] + k] for k in range(2))
    a, b = along[one], along[other]
    # Consistently oriented segments run through a node; flip the second one of others.
    through = line.cells[one, 0] != line.cells[other, 0]
    through &= line.cells[one, 1] != line.cells[other, 1]
    b = np.where(through[:, None], b, -b)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    turn[passed] = np.abs(np.arctan2(cross, (a * b).sum(axis=1)))
    return turn


def _mean_steps(
    points: FloatArray, cells: IntArray, sector: npt.NDArray[np.integer], n_sectors: int
) -> FloatArray:
    """Return the mean vector from the node of each sector to the centroids of its cells."""
    steps = np.repeat(points[cells].mean(axis=1), cells.shape[1], axis=0) - points[cells.ravel()]
    mean = np.zeros((n_sectors, 3))
    np.add.at(mean, sector, steps)
    return np.asarray(mean / np.bincount(sector, minlength=n_sectors)[:, None])
