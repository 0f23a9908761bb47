"""What `adapt` on distributed meshes returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from adaptsize.adaptation.report import BUDGET_TOLERANCE
from adaptsize.distributed.interface_quality import InterfaceQuality, Quality
from adaptsize.distributed.mesh import PartitionedMesh
from adaptsize.typing import FloatArray


@dataclass(frozen=True)
class PartsReport:
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

    n_points_before: int
    n_points_after: int
    n_cells_before: int
    n_cells_after: int
    n_meshes: int
    target_elements: float | None
    target_nodes: float | None
    tolerance: float | None
    predicted_elements: float
    error: float | None
    share_in_band: float
    share_too_long: float
    share_too_short: float
    before: Quality
    after: InterfaceQuality
    measure_before: float
    measure_after: float
    boundary_distance: float
    lost_tags: tuple[str, ...]

    @property
    def budget_met(self) -> bool | None:
        """Whether the number of cells or nodes is within 15 % of the request, None without one."""
        if self.target_nodes is not None:
            return abs(self.n_points_after / self.target_nodes - 1.0) <= BUDGET_TOLERANCE
        if self.target_elements is not None:
            return abs(self.n_cells_after / self.target_elements - 1.0) <= BUDGET_TOLERANCE
        return None

    def __str__(self) -> str:
        """Return a few lines."""
        goal = "" if self.target_elements is None else f", requested {self.target_elements:.0f}"
        if self.target_nodes is not None:
            goal = f", requested {self.target_nodes:.0f} nodes"
        lines = [
            f"{self.n_cells_before} cells -> {self.n_cells_after} cells, "
            f"{self.n_points_after} nodes",
            f"predicted {self.predicted_elements:.0f} elements{goal}",
        ]
        if self.error is not None:
            goal = "" if self.tolerance is None else f", tolerance {self.tolerance:.3g}"
            lines.append(f"estimated error of the old mesh {self.error:.3g}{goal}")
        if self.n_meshes:
            change = self.measure_after / self.measure_before - 1.0
            lines += [
                str(self.after),
                f"boundary within {self.boundary_distance:.2g} of the old one, "
                f"area or volume changed by {change:.1e}",
            ]
        if self.lost_tags:
            lines.append(f"tags lost: {', '.join(self.lost_tags)}")
        return "\n".join(lines)


@dataclass(frozen=True)
class AdaptedParts:
    """What `adapt` on distributed meshes returns.

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
