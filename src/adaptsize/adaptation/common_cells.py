"""Cells that two meshes have in common, in which fields stay as they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.background.merging import merge_equal_points
from adaptsize.background.partitioning import RankPart, cut_part
from adaptsize.background.topology import marked, unique_rows
from adaptsize.sizes.budget import nodal_measures
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray


@dataclass(frozen=True, eq=False)
class CommonCells:
    """The cells that two meshes have in common, and the patches of the others."""

    new: SimplexMesh
    old_cells: IndexArray
    """Those of the old mesh, and in the same order those of the new one."""
    new_cells: IndexArray
    old_nodes: IntArray
    """Their nodes in the old mesh, and in the same order those in the new one."""
    new_nodes: IndexArray
    before: RankPart
    """The other cells of the old mesh."""
    after: RankPart
    """The other cells of the new mesh."""
    border: BoolArray
    """Which nodes of ``after`` are also those of common cells."""
    share: FloatArray
    """Share of the measure around each of them that is in the patch."""

    @classmethod
    def of(cls, old: SimplexMesh, new: SimplexMesh) -> CommonCells | None:
        """Return what two meshes of one domain have in common; None if that is nothing or all."""
        old, new = old.without_data(), new.without_data()
        place = merge_equal_points(np.concatenate([old.points, new.points]))[1].astype(np.int32)
        ends = old.cells, new.cells + old.n_points
        orders = [np.argsort(place[cells], axis=1) for cells in ends]
        sorted_ends = [
            np.take_along_axis(x, order, 1) for x, order in zip(ends, orders, strict=True)
        ]
        number = unique_rows(place[np.concatenate(sorted_ends)], len(place))[1]
        of_number = np.full(len(number), -1)
        of_number[number[: old.n_cells]] = np.arange(old.n_cells)
        found = of_number[number[old.n_cells :]]
        is_common = found >= 0
        old_cells, new_cells = found[is_common], np.flatnonzero(is_common)
        if len(new_cells) in (0, new.n_cells) or len(old_cells) == old.n_cells:
            return None
        nodes, first = np.unique(sorted_ends[1][new_cells], return_index=True)
        new_nodes = (nodes - old.n_points).astype(np.intp)
        old_nodes = sorted_ends[0][old_cells].ravel()[first]
        before = _rest(old, old_cells)
        after = _rest(new, new_cells)
        border = marked(new_nodes, new.n_points)[after.global_ids]
        assert after.mesh is not None
        inside = nodal_measures(after.mesh)[border]
        share = inside / nodal_measures(new)[after.global_ids[border]]
        return cls(new, old_cells, new_cells, old_nodes, new_nodes, before, after, border, share)

    @property
    def patches(self) -> tuple[SimplexMesh, SimplexMesh]:
        """The meshes of the other cells, of the old mesh and of the new one."""
        before, after = self.before.mesh, self.after.mesh
        assert before is not None
        assert after is not None
        return before, after

    def at_nodes(
        self, values: npt.NDArray[Any], moved: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
    ) -> npt.NDArray[Any]:
        r"""Return a nodal field on the new mesh; ``moved`` transfers that of the patch.

        The field stays at the nodes outside of the patch.  At a node i of its border, it is the
        mean of the old value :math:`u_i` and the transferred one :math:`v_i`, weighted by the
        measures m around the node outside and inside of the patch,

        .. math:: u_i + \frac{m_i^{in}}{m_i^{out} + m_i^{in}} (v_i - u_i),

        so that the integral :math:`\sum_i m_i u_i` changes by what it changes in the patch.
        """
        found = moved(values[self.before.global_ids])
        made = np.empty((self.new.n_points, *values.shape[1:]), found.dtype)
        made[self.after.global_ids] = found
        made[self.new_nodes] = values[self.old_nodes]
        if found.dtype.kind not in "biu":
            share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
            nodes = self.after.global_ids[self.border]
            made[nodes] += share * (found[self.border] - made[nodes])
        return made

    def in_cells(
        self, values: npt.NDArray[Any], moved: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
    ) -> npt.NDArray[Any]:
        """Return a cell field on the new mesh; ``moved`` transfers that of the patch."""
        found = moved(values[self.before.cell_ids])
        made = np.empty((self.new.n_cells, *values.shape[1:]), found.dtype)
        made[self.after.cell_ids], made[self.new_cells] = found, values[self.old_cells]
        return made


def _rest(mesh: SimplexMesh, cells: IndexArray) -> RankPart:
    """Return the part of a mesh without some cells."""
    of_cells = marked(cells, mesh.n_cells).astype(np.int32)
    return cut_part(mesh, of_cells, np.full(mesh.n_points, -1, np.int32), 0)
