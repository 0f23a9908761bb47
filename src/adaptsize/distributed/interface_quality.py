"""How good a mesh is at former interfaces between parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.quality import minimum_angles
from adaptsize.typing import BoolArray, FloatArray


@dataclass(frozen=True)
class Quality:
    """Some cells and edges of a mesh compared with the requested sizes."""

    n_cells: int
    share_in_band: float
    """Share of the edges of these cells within a factor sqrt 2 of the size; nan without cells.
    An edge counts once for each of its cells."""
    angle_min: float
    """Smallest angle of `minimum_angles` in degrees; nan without cells."""
    angle_p01: float
    """Its quantile of 1 %; the smallest of those of the parts."""


@dataclass(frozen=True)
class InterfaceQuality:
    """The quality of all cells, and of those at former interfaces."""

    everywhere: Quality
    at_interfaces: Quality
    """Of cells whose centroid is within two sizes of an interface of an earlier round."""

    def __str__(self) -> str:
        """Return a line for all cells, and one for those at interfaces, if there are any."""
        return "\n".join(
            f"{name:14}{q.n_cells} cells, {q.share_in_band:.1%} of the edges in the band, least "
            f"angle {q.angle_min:.1f} degrees, 1 % below {q.angle_p01:.1f}"
            for name, q in (("all cells", self.everywhere), ("at interfaces", self.at_interfaces))
            if q.n_cells
        )


def measure_interfaces(
    part: PartitionedMesh, h: FloatArray, places: FloatArray
) -> InterfaceQuality:
    """Return the quality of a mesh, everywhere and near places; collective.

    Parameters
    ----------
    part : PartitionedMesh
    h : float64[n_local]
        Requested sizes.
    places : float64[k, dim]
        Points of former interfaces, the same on all ranks.
    """
    from scipy.spatial import cKDTree

    near = np.zeros(part.n_cells, bool)
    if part.mesh is not None and len(places):
        centroids = part.points[part.cells].mean(axis=1)
        near = cKDTree(places).query(centroids)[0] < 2.0 * h[part.cells].mean(axis=1)
    every = np.ones(part.n_cells, bool)
    return InterfaceQuality(_quality(part, h, every), _quality(part, h, near))


def _quality(part: PartitionedMesh, h: FloatArray, chosen: BoolArray) -> Quality:
    n_edges = n_good = 0
    least = p01 = np.inf
    if part.mesh is not None and chosen.any():
        cells = part.cells[chosen]
        for v in range(cells.shape[1]):
            for w in range(v):
                i, j = cells[:, v], cells[:, w]
                length = np.linalg.norm(part.points[i] - part.points[j], axis=1)
                ratio = length / (0.5 * (h[i] + h[j]))
                n_edges += len(ratio)
                n_good += int(np.count_nonzero(np.abs(np.log(ratio)) <= 0.5 * np.log(2.0)))
        angles = minimum_angles(part.mesh)[chosen]
        least, p01 = float(angles.min()), float(np.quantile(angles, 0.01))
    total = part.ranks.allreduce(np.array([np.count_nonzero(chosen), n_edges, n_good]), "sum")
    least, p01 = part.ranks.allreduce(np.array([least, p01]), "min").tolist()
    if total[0] == 0:
        return Quality(0, np.nan, np.nan, np.nan)
    return Quality(int(total[0]), float(total[2] / total[1]), least, p01)
