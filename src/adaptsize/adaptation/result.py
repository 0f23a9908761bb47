"""What `adapt` returns: the mesh, fields on it, and the report."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy.typing as npt

from adaptsize._size_function import SizeFunction
from adaptsize.adaptation.new_mesh import NewMesh
from adaptsize.adaptation.next_sizes import Decision, NextSizes, Request
from adaptsize.adaptation.report import AdaptReport, lost_tags
from adaptsize.adaptation.transfer import FieldTransfer
from adaptsize.background import SimplexMesh
from adaptsize.errors import ResolutionWarning
from adaptsize.metrics import MetricFunction
from adaptsize.quality import size_conformity
from adaptsize.typing import ProgressCallback

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class AdaptResult:
    """What `adapt` returns.

    Attributes
    ----------
    mesh : SimplexMesh
        The next mesh, with the transferred fields as its point and cell data.  It is the old
        mesh itself if ``remeshed`` is False.
    size : SizeFunction
        The requested sizes, on the old mesh; the smallest ones if they depend on the direction.
    fields, cell_fields : dict of str to ndarray
        The fields on ``mesh``; unchanged if it is the old mesh.
    remeshed : bool
        Whether ``mesh`` is a new mesh.  False ends a loop.
    converged : bool
        Whether the old mesh meets the request: its error is within the tolerance, or its
        sizes and the number of its elements are as requested.
    reason : str
        Why the mesh was remeshed, or why not.
    report : AdaptReport
        ``print(result.report)`` prints a few lines.
    metric : MetricFunction or None
        The requested metric on the old mesh, if sizes depend on the direction.
    """

    mesh: SimplexMesh
    size: SizeFunction
    fields: Arrays
    cell_fields: Arrays
    remeshed: bool
    converged: bool
    reason: str
    report: AdaptReport
    metric: MetricFunction | None = None

    def __str__(self) -> str:
        """Return the reason and the report."""
        return f"{self.reason}\n{self.report}"


@dataclass(frozen=True)
class FieldsToTransfer:
    """Fields to transfer, and how."""

    fields: Arrays
    cell_fields: Arrays
    conservative: bool
    keep_integral: bool


def result_of(
    old: SimplexMesh,
    sizes: NextSizes,
    request: Request,
    decision: Decision,
    made: NewMesh,
    to_transfer: FieldsToTransfer,
    generator: str,
    progress: ProgressCallback,
) -> AdaptResult:
    """Return fields on the new mesh, and the report."""
    requested, new = sizes.requested(old), made.mesh
    fields, cell_fields = to_transfer.fields, to_transfer.cell_fields
    how: dict[str, str] = {}
    integrals: dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]] = {}
    if decision.remesh:
        transfer = FieldTransfer(old, new, progress=progress)
        fields = {name: transfer.nodal(values) for name, values in to_transfer.fields.items()}
        cell_fields = {
            name: transfer.cells(
                values,
                conservative=to_transfer.conservative,
                keep_integral=to_transfer.keep_integral,
            )
            for name, values in to_transfer.cell_fields.items()
        }
        how, integrals = _how_transferred(transfer, to_transfer, cell_fields)
        new = new.with_data(point_data=fields, cell_data=cell_fields)
    before = size_conformity(old, requested)
    after = size_conformity(new, requested) if decision.remesh else before
    lost = lost_tags(old, new)
    if lost:
        warnings.warn(
            f"the new mesh has lost {', '.join(lost)}: parts smaller than the sizes vanish",
            ResolutionWarning,
            stacklevel=3,
        )
    report = AdaptReport(
        n_points_before=old.n_points, n_points_after=new.n_points,
        n_cells_before=old.n_cells, n_cells_after=new.n_cells,
        backend=generator, n_meshes=made.n_meshes,
        target_elements=request.target_elements, target_nodes=request.target_nodes,
        tolerance=request.tolerance,
        predicted_elements=sizes.predicted, error=request.error,
        share_in_band=decision.in_band, share_too_long=decision.too_long,
        share_too_short=decision.too_short, before=before, after=after,
        measure_before=float(old.measures.sum()), measure_after=float(new.measures.sum()),
        boundary_distance=made.boundary_distance, moves=made.moves,
        lost_tags=lost, kept_tags=old.cell_tags is not None or old.facet_tags is not None,
        transferred=how, integrals=integrals,
    )  # fmt: skip
    return AdaptResult(
        new, SizeFunction(old, sizes.h), fields, cell_fields, decision.remesh, decision.converged,
        decision.reason, report, requested if isinstance(requested, MetricFunction) else None,
    )  # fmt: skip


def _how_transferred(
    transfer: FieldTransfer, to_transfer: FieldsToTransfer, cell_fields: Arrays
) -> tuple[dict[str, str], dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]]]:
    """Return how fields were transferred, and the integrals of cell fields."""
    how = {}
    integrals = {}
    for name, values in to_transfer.fields.items():
        how[name] = "nearest node" if values.dtype.kind in "biu" else "interpolated"
    for name, values in to_transfer.cell_fields.items():
        how[name] = "value at the centroid"
        if values.dtype.kind in "biu":
            continue
        if to_transfer.conservative:
            how[name] = "conservative"
        integrals[name] = transfer.integrals(values, cell_fields[name])
    return how, integrals
