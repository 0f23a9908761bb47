"""A new mesh compared with the request: how good it is, and what is out of bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.quality import Conformity


def kind_of(mesh: SimplexMesh) -> str:
    """Return the name of the cells of a mesh."""
    return ("segments", "triangles", "tetrahedra")[mesh.cell_dim - 1]


@dataclass(frozen=True)
class Outcome:
    """A new mesh compared with the request."""

    kind: str
    conformity: Conformity
    expected: float | None = None
    """Number of cells that is predicted, or requested."""
    requested: bool = False
    """Whether that number is requested."""
    tolerance: float | None = None
    """Allowed distance of the boundary over the diagonal."""
    change: float | None = None
    """Relative change of the area or volume; None if the old mesh encloses none."""

    @property
    def excess(self) -> float | None:
        """Number of cells over the expected one, minus 1."""
        if self.expected is None:
            return None
        return self.conformity.n_cells / max(self.expected, 1.0) - 1.0

    @property
    def _expectation(self) -> str:
        return "requested" if self.requested else "predicted"

    @property
    def distance(self) -> float | None:
        """Distance of the boundary over the diagonal."""
        return self.conformity.hausdorff_relative

    def as_dict(self) -> dict[str, Any]:
        """Return the keys of the JSON object."""
        result: dict[str, Any] = {"kind": self.kind, **self.conformity.as_dict()}
        result["share_in_band"] = self.conformity.share_in_band
        if self.expected is not None:
            result[f"n_cells_{self._expectation}"] = self.expected
            result["tolerance"] = self.tolerance
            result["measure_change"] = self.change
        return result

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Topics, and what was found on each."""
        found = self.conformity
        cells = f"{found.n_cells} {self.kind}"
        if self.excess is not None:
            cells += f", {self.expected:.0f} {self._expectation} ({self.excess:+.1%})"
        angles = f"{'dihedral, ' if found.cell_dim == 3 else ''}least {found.angle_min:.1f} degrees"
        rows = [
            ("cells", cells),
            ("edges", f"{found.share_in_band:.1%} within a factor sqrt 2 of the size"),
            ("angles", f"{angles}, 1 % below {found.angle_p01:.1f}"),
        ]
        if self.distance is not None:
            text = f"{self.distance:.2g} of the diagonal from the old one"
            rows.append(("boundary", f"{text}, tolerance {self.tolerance:.2g}"))
        if self.change is not None:
            rows.append((self._measure, f"changed by {self.change:+.2%}"))
        return rows

    def __str__(self) -> str:
        """Return one line per topic."""
        return "\n".join(f"{name:10}{text}" for name, text in self.rows)

    @property
    def _measure(self) -> str:
        return "volume" if self.conformity.cell_dim == 3 else "area"

    def warnings(self) -> list[str]:
        """Return one line for each value that is out of bounds."""
        found, lines = self.conformity, []
        if (self.distance or 0.0) > (self.tolerance or np.inf):
            lines.append(
                f"the boundary is {self.distance:.2g} of the diagonal from the old one, more "
                f"than the tolerance, {self.tolerance:.2g}; smaller sizes keep it closer"
            )
        if found.share_in_band < 0.8:
            lines.append(
                f"only {found.share_in_band:.1%} of the edges are within a factor sqrt 2 of the "
                "size; details of the boundary may not allow it"
            )
        if self.excess is not None and abs(self.excess) > 0.25 and not self.requested:
            lines.append(
                f"{found.n_cells} {self.kind} are {abs(self.excess):.0%} "
                f"{'more' if self.excess > 0.0 else 'fewer'} than predicted"
            )
        if found.angle_min < 5.0:
            lines.append(f"the smallest angle is {found.angle_min:.2g} degrees")
        if self.change is not None and abs(self.change) > 0.01:
            lines.append(f"the {self._measure} has changed by {self.change:+.1%}")
        return lines


def outcome_of_remeshing(
    new: SimplexMesh,
    old: SimplexMesh,
    size: SizeFunction,
    tolerance: float,
    elements: float | None = None,
) -> Outcome:
    """Compare a new mesh with the old one, with the sizes, and with the number requested."""
    from adaptsize.quality import size_conformity

    surface = old if old.cell_dim < new.cell_dim or old.dim > old.cell_dim else old.boundary().mesh
    return Outcome(
        kind_of(new),
        size_conformity(new, size, surface=surface),
        _predicted(new, size) if elements is None else elements,
        elements is not None,
        tolerance,
        _change(new, old),
    )


def outcome_of_mesh(mesh: SimplexMesh) -> Outcome:
    """Compare a mesh with its nodal field h."""
    from adaptsize.quality import size_conformity

    return Outcome(kind_of(mesh), size_conformity(mesh, mesh.point_data["h"]))


def _predicted(new: SimplexMesh, size: SizeFunction) -> float:
    """Return the predicted number of cells of the kind that was made."""
    from adaptsize.background import SimplexMesh
    from adaptsize.sizes import predicted_elements

    background = size.background
    if new.cell_dim < new.dim and isinstance(background, SimplexMesh):  # a surface, not a volume
        return predicted_elements(background, size.values)
    assert size.report is not None
    return size.report.n_elements


def _change(new: SimplexMesh, old: SimplexMesh) -> float | None:
    """Return the relative change of the area or volume; None if the old one has no volume."""
    from adaptsize.geometry.enclosed import enclosed_measure
    from adaptsize.remeshing.hole_filling import merged_surface

    same_kind = old.cell_dim == new.cell_dim
    before = old.measures.sum() if same_kind else enclosed_measure(merged_surface(old))
    return float(new.measures.sum() / before - 1.0) if before > 0.0 else None
