"""Lines between groups of facets: nodes of a new mesh that are on these move along them only.

The distance of surfaces does not see a line that moves along the surface.
"""

from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import regions_beside
from adaptsize.remeshing.preparation import facet_numbers, facets_that_stay
from adaptsize.remeshing.protocol import NO_TAG
from adaptsize.remeshing.skins import corners_of
from adaptsize.remeshing.surface import facets_of
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray


class BorderLines(NamedTuple):
    """The edges between facets of different groups, and those with a tag.

    Parameters
    ----------
    edges : int32[n, 2]
        Rows ascend.  Of edges in the plane, the nodes between two groups.
    kinds : int64[n, 3]
        Lowest and highest tag of the facets beside each, and its own; ``NO_TAG`` for none.
    """

    edges: IntArray
    kinds: LongArray

    @classmethod
    def of(cls, surface: SimplexMesh, tag_of: LongArray | None = None) -> "BorderLines":
        """Return those of a surface; ``tag_of``: the tags of its groups, these by default."""
        n = len(surface.facets)
        kinds, is_border = np.full((n, 3), NO_TAG), np.zeros(n, np.bool_)
        if surface.cell_tags is not None:
            beside, groups = surface.cell_facets, surface.cell_tags
            lowest, highest = regions_beside(beside, groups, n)
            is_border = lowest != highest
            known, number = np.unique(
                groups if tag_of is None else tag_of[groups], return_inverse=True
            )
            tags = number.reshape(-1).astype(np.int32)
            kinds[:, :2] = known[np.column_stack(regions_beside(beside, tags, n))]
        if surface.cell_dim == 2 and surface.tagged_facets is not None:
            assert surface.facet_tags is not None
            number = facet_numbers(surface, surface.tagged_facets)
            is_border[number], kinds[number, 2] = True, surface.facet_tags
        edges, rows = np.unique(
            np.sort(surface.facets[is_border], axis=1), axis=0, return_index=True
        )
        return cls(edges, kinds[is_border][rows])

    def lengths(self, points: FloatArray) -> FloatArray:
        """Return the lengths of the edges."""
        return np.asarray(
            np.linalg.norm(points[self.edges[:, -1]] - points[self.edges[:, 0]], axis=1)
        )

    def longest_at_nodes(self, points: FloatArray) -> FloatArray:
        """Return the length of the longest edge at each node."""
        longest = np.zeros(len(points))
        np.maximum.at(longest, self.edges, self.lengths(points)[:, None])
        return longest

    def at_nodes(self, nodes: IntArray) -> tuple[LongArray, LongArray]:
        """Return the edges at some nodes: for each, the place of the node in these, and its row."""
        order = np.argsort(self.edges.ravel(), kind="stable")
        ends = self.edges.ravel()[order]
        first, last = (np.searchsorted(ends, nodes, side=side) for side in ("left", "right"))
        which = np.repeat(np.arange(len(nodes)), last - first)
        at = np.arange(len(which)) - np.repeat(np.cumsum(last - first) - last, last - first)
        return which, np.asarray(order[at] // self.edges.shape[1])

    def rows_of(self, edges: IntArray) -> LongArray:
        """Return the places of edges, given by sorted nodes, among these; or -1."""
        if not len(self.edges):
            return np.full(len(edges), -1)
        n = int(max(self.edges.max(), edges.max(initial=0))) + 1
        own, keys = _keys(self.edges, n), _keys(edges, n)
        row = np.minimum(np.searchsorted(own, keys), len(own) - 1)
        return np.where(own[row] == keys, row, -1)


def _keys(edges: IntArray, n: int) -> LongArray:
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1)
    return np.asarray(low * n + high)


def _tags_of_groups(mesh: SimplexMesh) -> LongArray | None:
    """Return the tags of the groups that `facets_of` numbers, none for a surface with its own."""
    if mesh.cell_dim < mesh.dim:
        return None
    return facets_that_stay(mesh).tag_of_group


class Borders:
    """The borders of a given surface.

    Nodes and edges of a new mesh are compared with lines between the same tags, not farther away
    than edges are long.

    Parameters
    ----------
    given : SimplexMesh
        The mesh or surface.
    mesh : SimplexMesh
        The new one, or one with the same regions and tags.
    """

    def __init__(self, given: SimplexMesh, mesh: SimplexMesh) -> None:
        old = facets_of(given)
        lines = BorderLines.of(old, _tags_of_groups(given))
        self._tag_of = _tags_of_groups(mesh)
        self._curves: dict[tuple[int, ...], SimplexMesh] = {}
        if len(lines.edges) and lines.edges.shape[1] == 2:
            kinds, which = np.unique(lines.kinds, axis=0, return_inverse=True)
            for k, kind in enumerate(kinds.tolist()):
                edges = lines.edges[which.reshape(-1) == k]
                self._curves[tuple(kind)] = SimplexMesh(old.points, edges)

    @property
    def are_any(self) -> bool:
        """Whether there are borders."""
        return len(self._curves) > 0

    def _lines_of(self, surface: SimplexMesh) -> BorderLines:
        return BorderLines.of(surface, self._tag_of)

    def _nearest(
        self, points: FloatArray, which: LongArray, kinds: LongArray, reach: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the closest points on borders, and their distances; inf if there are none.

        Parameters
        ----------
        points : float64[n, dim]
        which : int64[m]
            A point.
        kinds : int64[m, 3]
            Of lines with which it is compared.
        reach : float64[n]
            Largest distance.
        """
        there, distance = points.copy(), np.full(len(points), np.inf)
        known, number = np.unique(kinds, axis=0, return_inverse=True)
        for k, kind in enumerate(known.tolist()):
            if (curve := self._curves.get(tuple(kind))) is None:
                continue
            rows = np.unique(which[number.reshape(-1) == k])
            edges, weights, away = curve.locator.nearest(points[rows])
            places = np.einsum("ij,ijk->ik", weights, curve.points[curve.cells[edges]])
            nearer = away < np.minimum(distance[rows], reach[rows])
            there[rows[nearer]], distance[rows[nearer]] = places[nearer], away[nearer]
        return there, distance

    def nearest_of_nodes(
        self, surface: SimplexMesh, nodes: IntArray, there: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the points closest to places on the borders of nodes, and their distances.

        The distance is inf of nodes that are on no border, or on one that is too far away.
        """
        lines = self._lines_of(surface)
        if not len(lines.edges) or not self.are_any:
            return there, np.full(len(there), np.inf)
        which, rows = lines.at_nodes(nodes)
        reach = lines.longest_at_nodes(surface.points)[nodes]
        return self._nearest(there, which, lines.kinds[rows], reach)

    def nodes_off(self, surface: SimplexMesh, limit: float) -> tuple[IntArray, FloatArray]:
        """Return the nodes on borders that are farther away than a limit, and their places."""
        nodes = np.unique(self._lines_of(surface).edges)
        there, distance = self.nearest_of_nodes(surface, nodes, surface.points[nodes])
        off = (distance > limit) & np.isfinite(distance)
        return nodes[off], there[off]

    def edges_off(self, surface: SimplexMesh, limit: float) -> tuple[IntArray, FloatArray]:
        """Return the edges on borders that are too far away between near ends, and their places."""
        lines = self._lines_of(surface)
        if lines.edges.shape[1] != 2 or not self.are_any or not len(lines.edges):
            return np.empty((0, 2), np.int32), np.empty((0, surface.dim))
        one, other = np.moveaxis(surface.points[lines.edges], 1, 0)
        middles, away = self._along(one, other, lines.kinds)
        far = (np.maximum(away[0], away[-1]) <= limit) & (away.max(axis=0) > limit)
        far &= np.isfinite(away[2])
        return lines.edges[far], middles[far]

    def _along(
        self, one: FloatArray, other: FloatArray, kinds: LongArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the points closest to the middles of edges, and distances at their quarters.

        The latter have a row for each quarter, with both ends.
        """
        every, reach = np.arange(len(one)), np.linalg.norm(other - one, axis=1)
        found = [
            self._nearest((1.0 - t) * one + t * other, every, kinds, reach)
            for t in (0.0, 0.25, 0.5, 0.75, 1.0)
        ]
        return found[2][0], np.array([distance for _, distance in found])

    def _keep_edges(
        self,
        surface: SimplexMesh,
        lines: BorderLines,
        nodes: IntArray,
        there: FloatArray,
        limit: float,
    ) -> BoolArray:
        """Return which nodes, moved to places on borders, leave the edges there near to these."""
        keep = np.ones(len(nodes), np.bool_)
        if lines.edges.shape[1] != 2 or not len(nodes):
            return keep
        which, rows = lines.at_nodes(nodes)
        here = nodes[which]
        other = surface.points[lines.edges[rows].sum(axis=1) - here]
        before, after = (
            self._along(one, other, lines.kinds[rows])[1].max(axis=0)
            for one in (surface.points[here], there[which])
        )
        keep[which[after > np.maximum(limit, before)]] = False
        return keep

    def kept_on(
        self,
        surface: SimplexMesh,
        nodes: IntArray,
        edges: IntArray,
        there: FloatArray,
        limit: float,
    ) -> tuple[FloatArray, BoolArray]:
        """Return places at which nodes stay on borders, and which may be served.

        Parameters
        ----------
        surface : SimplexMesh
            The facets of the new mesh.
        nodes : int32[n]
            The node to move to each place; or -1.
        edges : int32[n, 2]
            The edge to divide instead.
        there : float64[n, dim]
        limit : float
            Distance of edges on borders, beyond which no move of a node brings them.
        """
        lines, new, may = self._lines_of(surface), there.copy(), np.ones(len(there), np.bool_)
        if not len(lines.edges):
            return there, may
        moved = nodes >= 0
        is_bound = moved & np.isin(nodes, lines.edges)
        new[is_bound], distance = self.nearest_of_nodes(surface, nodes[is_bound], there[is_bound])
        may[is_bound] = np.isfinite(distance) & ~staying(surface, lines)[nodes[is_bound]]
        may[is_bound] &= self._keep_edges(surface, lines, nodes[is_bound], new[is_bound], limit)
        if lines.edges.shape[1] == 2:
            row = np.where(moved, -1, lines.rows_of(edges))
            is_cut, row = row >= 0, row[row >= 0]
            reach = lines.lengths(surface.points)[row]
            new[is_cut], distance = self._nearest(
                there[is_cut], np.arange(len(row)), lines.kinds[row], reach
            )
            may[is_cut] = np.isfinite(distance)
        return new, may


def staying(surface: SimplexMesh, lines: BorderLines) -> BoolArray:
    """Return the nodes at which borders end, meet or turn."""
    if lines.edges.shape[1] == 2:
        tags = np.full(len(lines.edges), NO_TAG)
        return corners_of(surface.points, lines.edges, tags)
    is_on = np.zeros(surface.n_points, np.bool_)
    is_on[lines.edges] = True
    return is_on
