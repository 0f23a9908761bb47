"""The result of one adaptation cycle, and the report on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from adaptsize._checks import warn_caller
from adaptsize._messages import Message
from adaptsize._printed import Printed
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation import tuning
from adaptsize.adaptation._fields import Arrays
from adaptsize.adaptation.boundary_moves import BoundaryMoves
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import local_mesh
from adaptsize.background.requests import ask_nearest, boxes_around
from adaptsize.errors import ResolutionWarning
from adaptsize.metrics import MetricFunction
from adaptsize.quality.boundary import parts_by_tag
from adaptsize.quality.conformity import Conformity
from adaptsize.typing import FloatArray


@dataclass(frozen=True)
class AdaptReport(Printed):
    """One adaptation cycle: the request, the steps, and the result.

    It describes the whole mesh, and is the same on all ranks if that is in parts.

    Attributes
    ----------
    cell_dim : int
        2 for triangles, 3 for tetrahedra.
    n_points_before, n_points_after, n_cells_before, n_cells_after : int
        "After" refers to the returned mesh, which may be the old one.
    backend : str
        The mesh generator.
    n_meshes : int
        Number of meshes made: more than one if the first missed the number of elements.
    elements, nodes, tolerance : float or None
        The request.  With ``nodes``, ``elements`` is the number expected with it.
    predicted_elements : float
        Predicted number of elements for the sizes and this generator, within all limits.
    error : float or None
        Estimated error of the solution on the old mesh, ``sqrt(sum(indicator**2))``.
    share_in_band : float
        Share of the elements of the next mesh that the old mesh already has: its edges within
        sqrt 2 of the new sizes, each weighted by the elements that replace it.
    share_too_long, share_too_short : float
        Shares of the other edges, with the same weights.
    before, after : Conformity
        Conformity of both meshes with the new sizes; the same object if not remeshed.  That of
        whole meshes is measured on first use, for instance when the report is printed.
    measure_before, measure_after : float
        Area or volume.
    boundary_distance : float
        Largest distance of a boundary node of the generated mesh, before projection, from the
        boundary of the old mesh or, if that is less and the first mesh of the loop is known, of
        that one.
    moves : BoundaryMoves or None
        Result of the projection by ``project``.
    lost_tags : tuple of str
        Tags of cells and facets that the new mesh has lost.
    dropped_tags : tuple of str
        Those among them whose cells or facets are wider than the sizes.
    kept_tags : bool
        Whether the old mesh had tags of cells or facets.
    transferred : dict of str to str
        How each field was transferred.
    integrals : dict of str to (ndarray, ndarray)
        Integrals of the fields over the old and the new mesh, except for integers.
    magnitudes : dict of str to float
        Integrals of their absolute values over the old mesh, the largest of a field's components.
        Changes are printed relative to them, since an integral may vanish.
    """

    cell_dim: int
    n_points_before: int
    n_points_after: int
    n_cells_before: int
    n_cells_after: int
    n_meshes: int
    elements: float | None
    nodes: float | None
    tolerance: float | None
    predicted_elements: float
    error: float | None
    share_in_band: float
    share_too_long: float
    share_too_short: float
    measure_before: float
    measure_after: float
    boundary_distance: float
    lost_tags: tuple[str, ...]
    dropped_tags: tuple[str, ...]
    backend: str
    qualities: Callable[[], tuple[Conformity, Conformity]] = field(compare=False, repr=False)
    moves: BoundaryMoves | None
    kept_tags: bool
    transferred: dict[str, str]
    integrals: dict[str, tuple[FloatArray, FloatArray]]
    magnitudes: dict[str, float]

    @cached_property
    def _qualities(self) -> tuple[Conformity, Conformity]:
        return self.qualities()

    @property
    def before(self) -> Conformity:
        """Conformity of the old mesh with the new sizes."""
        return self._qualities[0]

    @property
    def after(self) -> Conformity:
        """Conformity of the new mesh with the new sizes."""
        return self._qualities[1]

    def __str__(self) -> str:
        """Return a few lines."""
        kind = "triangles" if self.cell_dim == 2 else "tetrahedra"
        lines = [f"{self.n_cells_before} {kind}, {self.n_points_before} nodes"]
        if self.n_meshes:
            lines[0] += f" -> {self.n_cells_after} {kind}, {self.n_points_after} nodes"
            lines[0] += f" ({self.backend}" + (
                f", try {self.n_meshes})" if self.n_meshes > 1 else ")"
            )
        lines.append(f"predicted {self.predicted_elements:.0f} elements" + self._target())
        if self.error is not None:
            goal = "" if self.tolerance is None else f", tolerance {self.tolerance:.3g}"
            lines.append(f"estimated error of the old mesh {self.error:.3g}{goal}")
        lines.append(
            f"sizes: {self.share_in_band:.0%} of the next mesh present already, "
            f"{self.share_too_long:.0%} too long, {self.share_too_short:.0%} too short"
        )
        lines.append("old mesh: " + _quality(self.before))
        if self.n_meshes:
            lines.append("new mesh: " + _quality(self.after))
            change = self.measure_after / self.measure_before - 1.0
            lines.append(
                f"boundary within {self.boundary_distance:.2g} of the given one, "
                f"area or volume changed by {change:.1e}"
            )
        if self.moves is not None:
            lines.append(f"projected: {self.moves}")
        if self.kept_tags:
            lost = ", ".join(self.lost_tags)
            lines.append(f"tags lost: {lost}" if lost else "tags: all kept")
        lines += [self._field(name, how) for name, how in self.transferred.items()]
        return "\n".join(lines)

    def _field(self, name: str, how: str) -> str:
        text = f"field {name}: {how}"
        if name not in self.integrals:
            return text
        before, after = self.integrals[name]
        if self.magnitudes[name] > 0.0:
            change = float(np.abs(after - before).max()) / self.magnitudes[name]
            text += f", integral changed by {change:.1e}"
        return text

    @property
    def budget_met(self) -> bool | None:
        """Whether the number of cells or nodes is within 15 % of the request, None without one."""
        ratio = self._ratio
        return None if ratio is None else abs(ratio - 1.0) <= tuning.BUDGET

    @property
    def _ratio(self) -> float | None:
        """Number of cells or nodes over the requested one."""
        if self.nodes is not None:
            return self.n_points_after / self.nodes
        if self.elements is not None:
            return self.n_cells_after / self.elements
        return None

    def _target(self) -> str:
        if self.elements is None:
            return ""
        text = f", requested {self.elements:.0f}"
        if self.nodes is not None:
            text = f", requested {self.nodes:.0f} nodes"
        if not self.n_meshes:
            return text
        met = "budget met" if self.budget_met else "budget missed"
        return f"{text}: {met}, ratio {self._ratio:.2f}"

    def warn(self, allowed: float) -> None:
        """Warn of lost tags, and of a boundary that has moved farther than allowed."""
        vanished = [tag for tag in self.lost_tags if tag not in self.dropped_tags]
        if vanished:
            warn_caller(
                f"the new mesh has lost {', '.join(vanished)}: parts smaller than the sizes vanish",
                ResolutionWarning,
            )
        if self.dropped_tags:
            warn_caller(
                f"the new mesh has lost {', '.join(self.dropped_tags)}, though not for its size: "
                f"{self.backend} did not keep it",
                ResolutionWarning,
            )
        for tag in () if self.moves is None else self.moves.idle:
            where = "" if tag is None else f" of facets with tag {tag}"
            warn_caller(
                f"project has no effect: no node{where} may move, since all are corners, on ridges "
                "or between two projections",
                ResolutionWarning,
            )
        if self.boundary_distance > allowed:
            # The text is constant, so that Python shows the warning once.
            warn_caller(
                Message(
                    "the boundary of the new mesh is farther from the given one than "
                    "{boundary_tolerance} (see report.boundary_distance), which adds up in a loop; "
                    "pass project= for a curved boundary of a whole mesh, or lower "
                    "{boundary_tolerance}"
                ),
                ResolutionWarning,
            )


#: The mesh of a result, and its sizes: a `SizeFunction`, or nodal values in parts.
MeshT_co = TypeVar("MeshT_co", bound=AnyMesh, covariant=True)
SizeT_co = TypeVar("SizeT_co", bound="SizeFunction | FloatArray", covariant=True)


@dataclass(frozen=True)
class AdaptResult(Generic[MeshT_co, SizeT_co]):
    """What `adapt` returns.

    Attributes
    ----------
    mesh : SimplexMesh or PartitionedMesh
        The next mesh, with the transferred fields as its point and cell data if it is whole.  It is
        the old mesh itself if ``remeshed`` is False.
    size : SizeFunction, or float64[n_points] in parts
        The requested sizes, on the old mesh; the smallest ones if they depend on the direction.
    fields, cell_fields : dict of str to ndarray
        The fields on ``mesh``, of this rank; unchanged if it is the old mesh.
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
    original : SimplexMesh or None
        The first mesh of the loop, the curved boundary of which bounds sizes; of meshes in parts
        that boundary; None in the plane.  `adapt` knows it of ``mesh``; pass it as ``original`` if
        the mesh comes back from another program.  A mesh with projected nodes is a first one.
    """

    mesh: MeshT_co
    size: SizeT_co
    fields: dict[str, Any]
    cell_fields: Arrays
    remeshed: bool
    converged: bool
    reason: str
    report: AdaptReport
    metric: MetricFunction | None = None
    original: SimplexMesh | None = None

    def __repr__(self) -> str:
        return f"AdaptResult({self.mesh!r}, {self.reason})"

    def plot(self: AdaptResult[SimplexMesh, SizeFunction], **options: Any) -> Any:
        """Draw the mesh, with the options of `adaptsize.plot.plot_mesh`."""
        return self.mesh.plot(**options)

    def __str__(self) -> str:
        """Return the reason and the report."""
        return f"{self.reason}\n{self.report}"


def _quality(conformity: Conformity) -> str:
    served = ""
    if conformity.served is not None:
        served = f", {conformity.served:.0%} of the requested elements served"
    text = (
        f"{conformity.share_in_band:.0%} of the edges within sqrt 2 of the sizes{served}, radius "
        f"ratio min {conformity.radius_ratio_min:.3f} mean {conformity.radius_ratio_mean:.3f}, "
        f"smallest angle {conformity.angle_min:.1f} deg"
    )
    near = conformity.at_interfaces
    return text if near is None else f"{text}\nat former interfaces: {_quality(near)}"


def total_measure(mesh: AnyMesh) -> float:
    """Return the area or volume of a mesh; collective."""
    return float(mesh.ranks.allreduce(float(mesh.measures.sum()), "sum"))


def numbers_of(mesh: AnyMesh) -> tuple[int, int]:
    """Return the numbers of nodes and cells of the whole mesh."""
    if isinstance(mesh, PartitionedMesh):
        return mesh.n_global_points, mesh.n_global_cells
    return mesh.n_points, mesh.n_cells


def tags_of(mesh: AnyMesh) -> set[tuple[str, int]]:
    """Return the kinds and numbers of the tags of cells and facets; collective."""
    own = local_mesh(mesh)
    tags = {kind: getattr(own, f"{kind}_tags", None) for kind in ("cell", "facet")}
    found = {
        (kind, tag) for kind, of in tags.items() if of is not None for tag in np.unique(of).tolist()
    }
    return set().union(*mesh.ranks.allgather(found))


def wide_parts(mesh: AnyMesh, h: FloatArray, tags: list[tuple[str, int]]) -> set[tuple[str, int]]:
    """Return those tags whose cells or facets are on some rank wider than the sizes; collective.

    The width of a part is twice its measure over that of its boundary: for a layer its thickness.
    That of a curve is its length.
    """
    own, found = local_mesh(mesh), set[tuple[str, int]]()
    for kind, tag in tags:
        part = None
        if own is not None:
            part = parts_by_tag(own, own.cell_dim - (kind == "facet")).get(tag)
        if part is None:
            continue
        width = float(part.measures.sum())
        if part.cell_dim > 1:
            around = float(part.boundary().mesh.measures.sum()) if not part.is_closed else 0.0
            width = 2.0 * width / around if around else np.inf
        if width > float(h[np.unique(part.cells)].mean()):
            found.add((kind, tag))
    return set().union(*mesh.ranks.allgather(found))


def boundary_distance(old: AnyMesh, new: AnyMesh) -> float:
    """Return the largest distance of a boundary node of a mesh to the boundary of another.

    For triangles in space, the distance of all nodes from the old triangles is used.  Collective:
    nodes are sent to the ranks with the nearest facets.
    """
    if isinstance(old, SimplexMesh) and old.cell_dim < old.dim:
        return float(old.locator.nearest(new.points)[2].max())
    facets = boundary_facets(old)
    nodes = np.unique(boundary_facets(new))
    skin = SimplexMesh(old.points, facets) if len(facets) else None

    def distances(points: FloatArray) -> FloatArray:
        if skin is None:  # nothing is asked of this rank
            return np.empty((0, 1))
        return skin.locator.nearest(points)[2][:, None]

    if isinstance(old, SimplexMesh):
        return float(distances(new.points[nodes]).max(initial=0.0))
    boxes = boxes_around(old.points[np.unique(facets)], old.ranks)
    found = ask_nearest(old, boxes, new.points[nodes], distances)
    return float(old.ranks.allreduce(float(found.max(initial=0.0)), "max"))
