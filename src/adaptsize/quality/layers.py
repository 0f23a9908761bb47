"""Height of the first layer of cells on the walls of a mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptsize._checks import place_text
from adaptsize.background import SimplexMesh
from adaptsize.metrics import Metric
from adaptsize.quality import tuning
from adaptsize.typing import FloatArray

#: Factor between the heights, made and requested, that counts as right.
NEAR = 1.5


class FirstLayer(NamedTuple):
    """Heights of the cells on walls over those requested."""

    share: float
    """Of the measure of the walls, where the factor between both is at most 1.5."""
    lowest: float
    highest: float
    """5 % and 95 % quantiles of height over request."""
    place: tuple[float, ...]
    """Where they differ most."""
    height: float
    wanted: float

    def __str__(self) -> str:
        """Return the share, the range and the worst place."""
        return (
            f"the first layer is within a factor {NEAR:g} of its height on {self.share:.0%} of the "
            f"walls: {self.lowest:.3g} to {self.highest:.3g} times as high as requested; worst at "
            f"{place_text(self.place, 4)}: {self.height:.3g} where {self.wanted:.3g} is requested"
        )


def first_layer(mesh: SimplexMesh, metric: Callable[[FloatArray], Metric]) -> FirstLayer | None:
    """Return the heights of the first layer on walls; None if there is none, or of a surface.

    Walls are the facets of the boundary at whose centroid the size along the normal is at most a
    fiftieth of each size along the facet.
    """
    if mesh.cell_dim != mesh.dim or mesh.dim == 1:
        return None
    on_boundary = mesh.facet_cell_counts == 1
    corners = mesh.points[mesh.facets[on_boundary]]
    edges = corners[:, 1:] - corners[:, :1]
    normals = _across(edges)
    area = np.linalg.norm(normals, axis=1)
    middles = corners.mean(axis=1)
    there = metric(middles)
    wanted = there.size_along(np.where(area[:, None] > 0.0, normals, 1.0))
    walls = (wanted <= 1.2 * there.sizes[:, 0]) & (there.sizes[:, 1] >= tuning.THIN_LAYER * wanted)
    walls &= area > 0.0
    if not walls.any():
        return None
    apex = np.empty(len(mesh.facets), np.intp)
    apex[mesh.cell_facets.ravel()] = mesh.cells.ravel()
    opposite = apex[on_boundary]
    unit = normals[walls] / area[walls, None]
    height = np.abs(np.einsum("ij,ij->i", mesh.points[opposite[walls]] - middles[walls], unit))
    ratio = height / wanted[walls]
    off = np.abs(np.log(np.maximum(ratio, np.finfo(float).tiny)))
    share = float(area[walls][off <= np.log(NEAR)].sum() / area[walls].sum())
    worst = int(off.argmax())
    low, high = np.quantile(ratio, [0.05, 0.95]).tolist()
    place = tuple(middles[walls][worst].tolist())
    return FirstLayer(share, low, high, place, float(height[worst]), float(wanted[walls][worst]))


def _across(edges: FloatArray) -> FloatArray:
    """Return normals of facets whose length is proportional to their measure."""
    if edges.shape[2] == 2:
        return np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
    return np.cross(edges[:, 0], edges[:, 1])
