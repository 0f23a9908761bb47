"""What ``adaptsize remesh`` reports: how good the new mesh is, and what is out of bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize.cli.output import say

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.report import SizeReport
    from adaptsize.typing import FloatArray

# What is worth a warning: a number of cells this far from the predicted one, as a factor, ...
_FAR_OFF = 1.5
# ... fewer edges than this within the band, ...
_LEAST_IN_BAND = 0.8
# ... and a volume that has changed by more than this share.
_VOLUME_CHANGE = 0.01


def print_quality(
    new: SimplexMesh, old: SimplexMesh, size: SizeFunction, report: SizeReport, tolerance: float
) -> None:
    """Print what became of a request, and warn of what is far from it."""
    from adaptsize.quality import size_conformity

    surface = old if old.cell_dim < new.cell_dim or old.dim > old.cell_dim else old.boundary().mesh
    found = size_conformity(new, size, surface=surface)
    distance = found.hausdorff_relative or 0.0
    kind = " (dihedral)" if new.cell_dim == 3 else ""
    predicted = _predicted(new, size, report)
    print(f"cells     {new.n_cells}, {predicted:.0f} predicted")
    print(f"edges     {found.share_in_band:.1%} within a factor sqrt 2 of the size")
    print(f"angles    from {found.angle_min:.1f} degrees{kind}, 1 % below {found.angle_p01:.1f}")
    print(f"boundary  off by {distance:.3g} of the diagonal, tolerance {tolerance:.3g}")
    change = _change(new, old)
    if change is not None:
        print(f"{'volume' if new.cell_dim == 3 else 'area':9} changed by {change:+.2%}")
        if abs(change) > _VOLUME_CHANGE:
            say("warning: the measure of the domain has changed by more than 1 %")
    if distance > tolerance:
        say("warning: the boundary is off by more than the tolerance")
    if found.share_in_band < _LEAST_IN_BAND:
        say("warning: many edges miss the size; details of the boundary may forbid it")
    if not 1.0 / _FAR_OFF < new.n_cells / max(predicted, 1.0) < _FAR_OFF:
        say("warning: the number of cells is far from the predicted one")


def _predicted(new: SimplexMesh, size: SizeFunction, report: SizeReport) -> float:
    """Return the predicted number of cells of the kind that was made."""
    from adaptsize.background import SimplexMesh
    from adaptsize.sizes import predicted_elements

    background = size.background
    if new.cell_dim < new.dim and isinstance(background, SimplexMesh):  # a surface, not a volume
        return predicted_elements(background, size.values)
    return report.n_elements


def _change(new: SimplexMesh, old: SimplexMesh) -> float | None:
    """Return the relative change of the area or volume; None if the old one has no volume."""
    before = old.measures.sum() if old.cell_dim == new.cell_dim else _enclosed(old)
    if before is None or not before > 0.0:
        return None
    return float(new.measures.sum() / before - 1.0)


def _enclosed(surface: SimplexMesh) -> float | None:
    """Return the volume that a closed surface encloses; None if it is open."""
    from adaptsize.remeshing.preparation import repair_mesh

    mesh = repair_mesh(surface).mesh
    if not (mesh.facet_cell_counts == 2).all():
        return None
    corners: FloatArray = mesh.points[mesh.cells] - mesh.points.mean(axis=0)
    return abs(float(np.linalg.det(corners).sum())) / 6.0
