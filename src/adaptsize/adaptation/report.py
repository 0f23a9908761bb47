"""What is told of one turn of an adaptive loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsize.adaptation.boundary_moves import BoundaryMoves
from adaptsize.background import SimplexMesh
from adaptsize.quality import Conformity
from adaptsize.typing import FloatArray

#: A number of elements within this of the one asked for is met.
BUDGET_TOLERANCE = 0.15


@dataclass(frozen=True)
class AdaptReport:
    """One turn of an adaptive loop: what was asked for, done, and come out.

    Attributes
    ----------
    n_points_before, n_points_after, n_cells_before, n_cells_after : int
        "After" is the mesh returned, also if it is the old one.
    backend : str
        The mesh generator.
    n_meshes : int
        How many meshes were made: more than one if the first missed the number of elements.
    target_elements, tolerance : float or None
        What was asked for.
    predicted_elements : float
        Elements expected of the sizes, for this generator, within all limits.
    error : float or None
        Estimated error of the solution on the old mesh, ``sqrt(sum(indicator**2))``.
    share_in_band : float
        Share of the elements of the next mesh that the old one has already: of its edges within
        sqrt 2 of the new sizes, each counted as the elements that come in its place.
    share_too_long, share_too_short : float
        The other edges, counted in the same way.
    before, after : Conformity
        Both meshes measured against the new sizes; the same object if not remeshed.
    measure_before, measure_after : float
        Area or volume.
    boundary_distance : float
        Largest distance of a boundary node of the mesh that the generator made to the boundary of
        the old mesh.
    moves : BoundaryMoves or None
        What became of ``project``.
    lost_tags : tuple of str
        Tags of cells and facets that the new mesh has not got any more.
    kept_tags : bool
        Whether the old mesh had tags of cells or facets.
    transferred : dict of str to str
        How each field was transferred.
    integrals : dict of str to (ndarray, ndarray)
        Integrals of cell fields over the old and the new mesh.
    """

    n_points_before: int
    n_points_after: int
    n_cells_before: int
    n_cells_after: int
    backend: str
    n_meshes: int
    target_elements: float | None
    tolerance: float | None
    predicted_elements: float
    error: float | None
    share_in_band: float
    share_too_long: float
    share_too_short: float
    before: Conformity
    after: Conformity
    measure_before: float
    measure_after: float
    boundary_distance: float
    moves: BoundaryMoves | None
    lost_tags: tuple[str, ...]
    kept_tags: bool
    transferred: dict[str, str]
    integrals: dict[str, tuple[FloatArray, FloatArray]]

    @property
    def budget_met(self) -> bool | None:
        """Whether the number of cells is within 15 % of the one asked for; None if none was."""
        if self.target_elements is None:
            return None
        return abs(self.n_cells_after / self.target_elements - 1.0) <= BUDGET_TOLERANCE

    def __str__(self) -> str:
        """Return a few lines."""
        return "\n".join(self._lines())

    def _lines(self) -> list[str]:
        kind = "triangles" if self.before.cell_dim == 2 else "tetrahedra"
        lines = [f"{self.n_cells_before} {kind}, {self.n_points_before} nodes"]
        if self.n_meshes:
            lines[0] += f" -> {self.n_cells_after} {kind}, {self.n_points_after} nodes"
            lines[0] += f" ({self.backend}" + (
                f", try {self.n_meshes})" if self.n_meshes > 1 else ")"
            )
        lines.append(f"expected {self.predicted_elements:.0f}" + self._asked())
        if self.error is not None:
            wanted = "" if self.tolerance is None else f", tolerance {self.tolerance:.3g}"
            lines.append(f"estimated error of the old mesh {self.error:.3g}{wanted}")
        lines.append(
            f"sizes: {self.share_in_band:.0%} as asked for already, {self.share_too_long:.0%} too "
            f"long, {self.share_too_short:.0%} too short"
        )
        lines.append("old mesh: " + _quality(self.before))
        if self.n_meshes:
            lines.append("new mesh: " + _quality(self.after))
            change = self.measure_after / self.measure_before - 1.0
            lines.append(
                f"boundary within {self.boundary_distance:.2g} of the old one, "
                f"area or volume changed by {change:.1e}"
            )
        if self.moves is not None:
            lines.append(f"projected: {self.moves}")
        if self.kept_tags:
            lost = ", ".join(self.lost_tags)
            lines.append(f"tags lost: {lost}" if lost else "tags: all kept")
        lines += [self._field(name, how) for name, how in self.transferred.items()]
        return lines

    def _asked(self) -> str:
        if self.target_elements is None:
            return ""
        if not self.n_meshes:
            return f", asked for {self.target_elements:.0f}"
        ratio = self.n_cells_after / self.target_elements
        met = "budget met" if self.budget_met else "budget missed"
        return f", asked for {self.target_elements:.0f}: {met}, {ratio:.2f} of it"

    def _field(self, name: str, how: str) -> str:
        text = f"field {name}: {how}"
        if name not in self.integrals:
            return text
        before, after = self.integrals[name]
        largest = float(np.abs(before).max(initial=0.0))
        if largest > 0.0:
            change = float(np.abs(after - before).max()) / largest
            text += f", integral changed by {change:.1e}"
        return text


def _quality(conformity: Conformity) -> str:
    return (
        f"{conformity.share_in_band:.0%} of the edges within sqrt 2 of the sizes, radius ratio "
        f"min {conformity.radius_ratio_min:.3f} mean {conformity.radius_ratio_mean:.3f}, "
        f"least angle {conformity.angle_min:.1f} deg"
    )


def lost_tags(old: SimplexMesh, new: SimplexMesh) -> tuple[str, ...]:
    """Return which tags of cells and facets of the old mesh the new one has not."""
    lost = []
    for kind in ("cell", "facet"):
        before, after = (getattr(mesh, f"{kind}_tags") for mesh in (old, new))
        if before is None:
            continue
        there = [] if after is None else after
        lost += [f"{kind} tag {tag}" for tag in np.setdiff1d(before, there)]
    return tuple(lost)


def boundary_distance(old: SimplexMesh, new: SimplexMesh) -> float:
    """Return the largest distance of a boundary node of a mesh to the boundary of another.

    Of triangles in space all nodes count, and the distance is that to the old triangles.
    """
    if new.cell_dim < new.dim:
        return float(old.locator.nearest(new.points)[2].max())
    skin = old.boundary().mesh
    return float(skin.locator.nearest(new.points[new.boundary().nodes])[2].max())
