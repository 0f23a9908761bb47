"""What a mesh has more than the integral of its sizes: single layers of cells, and narrow faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptsize._progress import silent
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import rows_among
from adaptsize.domain_size import tuning
from adaptsize.domain_size.parameters import chords_of
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.width import Width
from adaptsize.sizes.budget import CELLS_PER_PREDICTED, ELEMENTS_PER_MEASURE, nodes_of
from adaptsize.sizes.prediction import Prediction
from adaptsize.typing import BoolArray, FloatArray, IndexArray

#: Cells per facet of the boundary where all nodes are on it: nodes are half the facets.
_PER_FACET = (0.5 - nodes_of(3, 0.0, 1.0)) / nodes_of(3, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class ThinParts:
    """Counts the cells and facets that thin walls and narrow faces need beyond those of the sizes.

    A wall thinner than two sizes has most of its nodes on the boundary, and cells between them that
    are smaller than regular ones: sheets were measured.  A face between two feature edges that is
    narrower than the size has one row of triangles, two per size along it.  Two facets more are one
    node more.  Around feature edges are fewer cells than on flat parts of the boundary, which
    counts where faces are narrow.

    Parameters
    ----------
    faces : Faces
    width : Width
    """

    faces: Faces
    width: Width

    def added_to(self, found: Prediction, size: SizeFunction) -> Prediction:
        """Return a prediction of sizes on a refined surface with what thin parts add to it."""
        facets, in_strips = self._in_strips(size)
        on_sides, in_walls = self._in_walls(size)
        cells = max(found.cells + in_walls + in_strips, on_sides)
        facets += on_sides
        return Prediction(cells, facets, nodes_of(3, cells, facets))

    def _in_walls(self, size: SizeFunction) -> tuple[float, float]:
        """Return the facets, and the cells that thin walls have more, by points of the surface.

        There are as many points in places as facets, and the same ones for each relaxation.  Inside
        of facets, sizes may be smaller than between their nodes.  Cells in walls are as many as
        their facets, which are smaller than the size where Mmg keeps chords within the tolerance.
        """
        mesh, h = size.background, size.values
        assert isinstance(mesh, SimplexMesh)
        density = ELEMENTS_PER_MEASURE[2] * (h[mesh.cells] ** -2.0).mean(axis=1)
        number = np.cumsum(mesh.measures * density)
        n = tuning.POINTS_ON_WALLS
        rng = np.random.default_rng(20061)
        cell = np.searchsorted(number, number[-1] * (np.arange(n) + rng.random(n)) / n)
        cell = np.minimum(cell, mesh.n_cells - 1)
        weights = rng.dirichlet(np.ones(3), n)
        points = np.einsum("ij,ijk->ik", weights, mesh.points[mesh.cells[cell]])
        sizes = np.asarray(size(points))
        edges = np.minimum(sizes, self._longest(size)[mesh.cells[cell]].min(axis=1))
        widths, areas = self._widths(points), number[-1] / n / density[cell]
        filled = 0.5 * CELLS_PER_PREDICTED["mmg inside", 3] * ELEMENTS_PER_MEASURE[3] * widths
        made = np.interp(widths / edges, *np.transpose(tuning.IN_WALLS)) * edges**-2.0
        facets = float((ELEMENTS_PER_MEASURE[2] * edges**-2.0 * areas).sum())
        return facets, float((np.maximum(made - filled * sizes**-3.0, 0.0) * areas).sum())

    def _longest(self, size: SizeFunction) -> FloatArray:
        """Return the longest edges that Mmg makes at the nodes that carry the sizes."""
        report = size.report
        bound = None if report is None else report.bounds.get("curvature")
        if report is None or bound is None or not np.isfinite(report.tolerance):
            return np.full(size.values.shape, np.inf)
        allowed = report.tolerance * self.faces.mesh.diameter
        by_chords = bound**2.0 / (chords_of(report.relaxation) * allowed)
        with np.errstate(invalid="ignore"):  # 0 elements per radian where the surface is flat
            radius = np.fmax(report.elements_per_radian * bound, by_chords)
        return np.asarray(np.sqrt(tuning.MADE_CHORDS * allowed * radius))

    def _widths(self, points: FloatArray) -> FloatArray:
        surface, scale = self.faces.mesh, self.faces.frame.scale
        owner = surface.locator.nearest(points)[0]
        return np.asarray(self.width.shoot(self.faces.frame.of(points), owner, silent) / scale)

    @cached_property
    def _strips(self) -> tuple[IndexArray, FloatArray]:
        """Feature edges beside narrow faces, and how wide these are there.

        Given surfaces have one row of triangles in these: on the one side of a triangle is a
        feature edge, and its third node is on another one, or at the other end of one that meets it
        at a corner.  At other ends it is on the same curve.
        """
        faces, mesh = self.faces, self.faces.mesh
        row = rows_among(mesh.edges, faces.features)[mesh.cell_facets]
        is_on = np.zeros(mesh.n_points, np.bool_)
        is_on[faces.features] = True
        cell, v = np.nonzero(row >= 0)
        n_sides = (row >= 0).sum(axis=1)
        is_across = (n_sides == 1)[cell] & is_on[mesh.cells[cell, v]]
        is_across |= ((n_sides == 2) & self._are_at_corners(row < 0))[cell]
        cell, v = cell[is_across], v[is_across]
        edge = row[cell, v]
        ends = mesh.points[faces.features[edge]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        return edge, 2.0 * mesh.measures[cell] / np.maximum(lengths, np.finfo(float).tiny)

    def _are_at_corners(self, is_inner: BoolArray) -> BoolArray:
        """Return whether the sides of triangles but for one, bool[n, 3], meet at a corner."""
        mesh = self.faces.mesh
        v, cells = is_inner.argmax(axis=1), np.arange(mesh.n_cells)
        at = [mesh.points[mesh.cells[cells, (v + k) % 3]] for k in range(3)]
        one, other = at[1] - at[0], at[2] - at[0]
        lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
        return np.asarray(np.einsum("ij,ij->i", one, other) > tuning.BLUNTEST_CORNER * lengths)

    def _in_strips(self, size: SizeFunction) -> tuple[float, float]:
        """Return the facets that rows of triangles have more, and the cells that they cause."""
        edge, wide = self._strips
        if self.faces.is_rough or len(edge) == 0:
            return 0.0, 0.0
        edges, at = np.unique(edge, return_inverse=True)  # most are beside two narrow faces
        ends = self.faces.mesh.points[self.faces.features[edges]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        places = (np.arange(4) + 0.5) / 4.0
        points = ends[:, None, 0] + places[:, None] * (ends[:, None, 1] - ends[:, None, 0])
        h = np.asarray(size(points.reshape(-1, 3))).reshape(len(edges), -1)
        h, lengths = h[at.reshape(-1)], lengths[at.reshape(-1)]
        along = lengths[:, None] / len(places) / h  # edges of the new mesh
        more = np.maximum(1.0 - 0.5 * ELEMENTS_PER_MEASURE[2] * wide[:, None] / h, 0.0)
        facets = float((along * more).sum())
        narrow = wide[:, None] < tuning.NARROW_FACE * h
        return facets, _PER_FACET * facets - tuning.LESS_AT_EDGE * float(along[narrow].sum())
