"""What `distributed.adapt` returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from adaptsize.adaptation.report import CycleReport
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.remeshing.in_parts import InterfaceQuality, Quality
from adaptsize.typing import FloatArray


@dataclass(frozen=True)
class PartsReport(CycleReport):
    """One adaptation cycle of a distributed mesh; the same on all ranks.

    The attributes that `adaptsize.adaptation.AdaptReport` has as well mean the same, for the whole
    mesh.

    Attributes
    ----------
    before : Quality
        The old mesh compared with the new sizes.
    after : InterfaceQuality
        The new mesh, and its cells at former interfaces between parts.
    """

    before: Quality
    after: InterfaceQuality

    def __str__(self) -> str:
        """Return a few lines."""
        lines = [
            f"{self.n_cells_before} cells -> {self.n_cells_after} cells, "
            f"{self.n_points_after} nodes",
            *self._request(),
        ]
        if self.n_meshes:
            lines += [str(self.after), self._boundary()]
        if self.lost_tags:
            lines.append(f"tags lost: {', '.join(self.lost_tags)}")
        return "\n".join(lines)


@dataclass(frozen=True)
class AdaptedParts:
    """What `distributed.adapt` returns.

    Attributes
    ----------
    part : PartitionedMesh
        The next mesh; the old one itself if ``remeshed`` is False.
    size : float64[n_local]
        The requested sizes at the nodes of the old mesh.
    fields, cell_fields : dict of str to ndarray
        The fields at the nodes and cells of ``part`` on this rank.
    remeshed : bool
        Whether ``part`` is a new mesh.  False ends a loop.
    converged : bool
        Whether the old mesh meets the request.
    reason : str
        Why the mesh was remeshed, or why not.
    report : PartsReport
    """

    part: PartitionedMesh
    size: FloatArray
    fields: dict[str, npt.NDArray[Any]]
    cell_fields: dict[str, npt.NDArray[Any]]
    remeshed: bool
    converged: bool
    reason: str
    report: PartsReport

    def __str__(self) -> str:
        """Return the reason and the report."""
        return f"{self.reason}\n{self.report}"
