"""Lines of sight inside the solid that a surface encloses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptsize._kernels import inside as kernels
from adaptsize._kernels.rays import FacetTree
from adaptsize._workers import Workers, in_all_threads
from adaptsize.background import SimplexMesh
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import components_of, pairs_of_cells
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.convexity import cross, norms
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.walls import WallTree
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: Points on the surface are moved inside by this, in units of the longest side of its box: more
#: than the rounding of coordinates in single precision.
NUDGE = 1e-6
#: Points closer to the surface than this, in the same units, are on it.
ON = 10.0 * NUDGE
#: A piece of a surface with a rim is a sheet if its area as a vector is more than this share of its
#: area.  Of a closed surface it is 0, of a box without a lid 0.2, of half a sphere 0.5.
_SHEET = 0.25
# Facets per chunk of a thread, a millisecond.
_CELLS = 1 << 13


@dataclass(frozen=True, eq=False)
class Inside:
    """The solid that a surface encloses, in which walls hide points from each other.

    Parameters
    ----------
    faces : Faces
        Of triangles in space.
    is_crossed : bool
        Whether bodies overlap or intersect themselves.  Then nothing is hidden: their facets are no
        walls of the union.
    """

    faces: Faces
    is_crossed: bool = False

    @cached_property
    def is_sheet(self) -> BoolArray:
        """Which facets belong to sheets, which hide from both sides, bool[n_cells]."""
        mesh = self.faces.mesh
        if (mesh.facet_cell_counts != 1).all():
            return np.zeros(mesh.n_cells, np.bool_)
        links = pairs_of_cells(mesh, mesh.facet_cell_counts == 2) // 3
        piece = components_of(links, mesh.n_cells)
        areas = facet_normals(mesh.points[mesh.cells])
        n = int(piece.max()) + 1
        total = np.stack([np.bincount(piece, areas[:, d], n) for d in range(3)], axis=1)
        every = np.bincount(piece, np.linalg.norm(areas, axis=1), n)
        return np.asarray((np.linalg.norm(total, axis=1) > _SHEET * every)[piece])

    @cached_property
    def walls(self) -> tuple[FacetTree, BoolArray]:
        """The facets in a tree, and which of its rows hide from both sides."""
        walls = WallTree.of(self.faces)
        return walls.tree, self.is_sheet[walls.order]

    @cached_property
    def normals(self) -> FloatArray:
        """Outward normals at the nodes of the surface, float64[n_points, 3]; zero at sheets."""
        mesh = self.faces.mesh
        return self.normals_of_parts(mesh, np.arange(mesh.n_cells))[self.faces.targets]

    def normals_of_parts(self, mesh: SimplexMesh, owner: IndexArray) -> FloatArray:
        """Return the normals at the nodes of parts of the facets, given the facet of each part."""
        weighted, normals = (
            np.empty((3, 3, mesh.n_cells)),
            self.faces.normals * ~self.is_sheet[:, None],
        )

        def weigh(first: int, last: int) -> None:
            corners = mesh.points[mesh.cells[first:last]]
            unit = normals[owner[first:last]].T
            for v in range(3):
                one, other = (corners[:, (v + k) % 3] - corners[:, v] for k in (1, 2))
                area = norms(cross(one, other))
                angle = np.arctan2(area, np.einsum("ij,ij->i", one, other))
                np.multiply(angle, unit, out=weighted[v, :, first:last])

        in_all_threads(weigh, mesh.n_cells, _CELLS)
        total = np.zeros((mesh.n_points, 3))

        def add(first: int, last: int) -> None:
            for d in range(first, last):
                for v in range(3):
                    total[:, d] += np.bincount(mesh.cells[:, v], weighted[v, d], mesh.n_points)

        in_all_threads(add, 3, 1)
        length = norms(total)
        total /= np.where(length > 0.0, length, 1.0)[:, None]
        return total

    def nudged(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return points of the surface moved inside, in the frame."""
        return np.asarray(self.faces.frame.of(points) - NUDGE * normals)

    def moved_inside(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points in the frame, those on the surface or outside moved inside, and how far.

        The latter is 0 for points inside.
        """
        surface, frame = self.faces.mesh, self.faces.frame
        moved, lost = frame.of(points), np.zeros(len(points))
        if len(points) == 0 or self.is_crossed:
            return moved, lost
        around, weights, away = surface.locator.weights(points)
        closest, normals = blended(surface, self.normals, around, weights)
        outside = np.einsum("ij,ij->i", points - closest, normals) > 0.0
        near = outside | (away * frame.scale < ON)
        moved[near] = self.nudged(closest[near], normals[near])
        lost[outside] = away[outside]
        return moved, lost

    def hidden(
        self, starts: FloatArray, ends: FloatArray, workers: Workers, *, strict: bool = False
    ) -> BoolArray:
        """Return which lines between points in the frame leave the solid.

        ``strict``: also those that enter it, as from points outside.
        """
        hidden = np.zeros(len(starts), np.bool_)
        if self.is_crossed or len(starts) == 0:
            return hidden
        tree, two_sided = self.walls
        lines = tuple(read_only(np.ascontiguousarray(x)) for x in (starts, ends))

        def task(first: int, last: int) -> None:
            kernels.find_hidden(tree, two_sided, lines, strict, hidden, first, last)

        workers.in_chunks(task, len(starts), 4096)
        return hidden


def blended(
    mesh: SimplexMesh, normals: FloatArray, around: IntArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points in facets, and the normals there."""
    points = np.einsum("ij,ijk->ik", weights, mesh.points[around])
    return points, np.einsum("ij,ijk->ik", weights, normals[around])
