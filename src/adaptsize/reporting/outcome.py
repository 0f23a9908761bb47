"""A new mesh compared with the request: how good it is, and what is out of bounds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from adaptsize._checks import place_text
from adaptsize._messages import Message
from adaptsize.reporting import tuning

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.background.image import Image
    from adaptsize.options.sizes import ImageOptions
    from adaptsize.quality.by_place import RequestedElements
    from adaptsize.quality.certificate import MeshCheck, Status
    from adaptsize.quality.conformity import Conformity, SizeLike


#: What helps where a requirement of `check_mesh` is missed.
_ADVICE = {
    "cells": Message("{strict:True} tries other generators"),
    "facets": Message("{strict:True} tries other generators"),
    "overlaps": Message("{strict:True} tries other generators"),
    "boundary": Message("smaller sizes or {strict:True} keep it closer"),
    "interface": Message("smaller sizes or {strict:True} keep it closer"),
    "tags": Message("{backend:'mmg'} keeps tagged facets, and smaller sizes resolve them"),
    "regions": "smaller sizes resolve thin regions",
    "measure": "smaller sizes or a lower tolerance keep it",
    "topology": "walls or gaps as thin as the tolerance may be lost or filled; lower the tolerance",
    "edges": "details of the boundary may not allow it",
    "served": "remesh the new mesh with the same sizes",
    "angles": Message("smaller sizes there, or {backend:'tetwild'}, may help"),
}


#: Requirements on distances, which are rows of the summary.
_DISTANCES = ("boundary", "interface")


def kind_of(mesh: SimplexMesh) -> str:
    """Return the name of the cells of a mesh."""
    return ("segments", "triangles", "tetrahedra")[mesh.cell_dim - 1]


@dataclass(frozen=True)
class Outcome:
    """A new mesh compared with the request."""

    kind: str
    conformity: Conformity
    check: MeshCheck
    """The requirements of `check_mesh`, which warnings report if they are not met."""
    expected: float | None = None
    """Number of cells that is predicted, or requested."""
    requested: bool = False
    """Whether that number is requested."""
    tolerance: float | None = None
    """Allowed distance of the boundary over the diagonal."""
    change: float | None = None
    """Relative change of the area or volume; None if the old mesh encloses none."""
    regions: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Area or volume of each region, and its relative change."""
    sharp: tuple[int, tuple[float, ...]] = (0, ())
    """Number of cells with an angle below 10 degrees, and the place of the worst."""
    pinched: tuple[int, tuple[float, ...]] = (0, ())
    """Number of edges (nodes, in the plane) of the boundary in more than two of its facets, and the
    place of one."""

    names: dict[int, str] = field(default_factory=dict)
    """Names of the regions that have one."""
    unserved: tuple[str, ...] = ()
    """A line for each request of which too much is missing."""
    over_cap: Message | None = None
    """Why the mesh has more elements than allowed; None if it has not."""

    @property
    def status(self) -> Status:
        """The status of the check, or missed if there are more elements than allowed."""
        return self.check.status if self.over_cap is None else "missed"

    @property
    def excess(self) -> float | None:
        """Number of cells over the expected one, minus 1."""
        if self.expected is None:
            return None
        return self.conformity.n_cells / max(self.expected, 1.0) - 1.0

    @property
    def _expectation(self) -> str:
        return "requested" if self.requested else "predicted"

    def as_dict(self) -> dict[str, Any]:
        """Return the keys of the JSON object."""
        result: dict[str, Any] = {"kind": self.kind, **self.conformity.as_dict()}
        result["share_in_band"] = self.conformity.share_in_band
        result["measure_change"] = self.change
        if self.expected is not None:
            result[f"n_cells_{self._expectation}"] = self.expected
            result["tolerance"] = self.tolerance
            result["interface_relative"] = self.check.distance("interface")
        else:
            result["n_pinched"] = self.pinched[0]
        result["n_sharp"] = self.sharp[0]
        result["status"] = self.status
        result["requirements"] = [requirement.as_dict() for requirement in self.check.requirements]
        result["regions"] = {
            tag: {"measure": measure, "change": change}
            for tag, (measure, change) in self.regions.items()
        }
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
            *([] if found.served is None else [("served", found.service)]),
            ("angles", f"{angles}, 1 % below {found.angle_p01:.1f}"),
        ]
        rows += [(d.name, d.text) for d in self.check.requirements if d.name in _DISTANCES]
        several = self.regions if len(self.regions) > 1 else {}
        for tag, (measure, change) in several.items():
            rows.append(
                (
                    f"region {self._named(tag)}",
                    f"{self._measure} {measure:.6g}, changed by {_percent(change)}",
                )
            )
        if self.change is not None:
            rows.append((self._measure, f"changed by {_percent(self.change)}"))
        return rows + [("note", note) for note in self.check.notes]

    def __str__(self) -> str:
        """Return one line per topic."""
        width = max(10, 1 + max(len(name) for name, _ in self.rows))
        return "\n".join(f"{name:{width}}{text}" for name, text in self.rows)

    def _named(self, tag: int) -> str:
        """Return a tag, and its name if it has one."""
        return f'{tag} "{self.names[tag]}"' if tag in self.names else str(tag)

    @property
    def _measure(self) -> str:
        return "volume" if self.conformity.cell_dim == 3 else "area"

    def warnings(self) -> list[str]:
        """Return one line for each value that is out of bounds."""
        from adaptsize.quality.certificate import NEAR

        found, lines = self.conformity, list[str | Message](self.unserved)
        if self.over_cap is not None:
            lines.append(self.over_cap)
        for requirement in self.check.failures:
            worst = (
                f", the worst at {place_text(requirement.places[0].point)}"
                if requirement.places
                else ""
            )
            advice = _ADVICE[requirement.name]
            if (
                requirement.name == "served" and (found.too_coarse or 0.0) < tuning.TOO_COARSE
            ):  # too fine
                advice = _ADVICE["edges"]
            if requirement.status == "near":
                advice = f"near, which is accepted up to {100.0 * NEAR:g} % beyond the limit"
            lines.append(Message("{}: {}{}; {}", requirement.name, requirement.text, worst, advice))
        if self.excess is not None and abs(self.excess) > tuning.EXCESS and not self.requested:
            lines.append(
                f"{found.n_cells} {self.kind} are {abs(self.excess):.0%} "
                f"{'more' if self.excess > 0.0 else 'fewer'} than predicted"
            )
        if self.sharp[0] and all(one.name != "angles" for one in self.check.failures):
            n, place = self.sharp
            lines.append(
                f"{n} cell{'s have' if n > 1 else ' has'} an angle below {tuning.SHARP:g} degrees, "
                f"the worst, {found.angle_min:.2g}, at {place_text(place)}; smaller sizes there"
                f"{', or the backend tetwild,' if found.cell_dim == 3 else ''} may help"
            )
        most = tuning.CHANGE_OF_IMAGE if self.expected is None else tuning.CHANGE
        if self.change is not None and abs(self.change) > most:
            lines.append(f"the {self._measure} has changed by {self.change:+.1%}")
        of_regions = self.regions if self.expected is None and len(self.regions) > 1 else {}
        changes = {tag: change for tag, (_, change) in of_regions.items() if abs(change) > most}
        if changes:  # of other meshes, check compares the regions
            listed = ", ".join(
                f"{self._named(tag)} ({change:+.1%})" for tag, change in changes.items()
            )
            text = (
                "the {} of these regions has changed: {}; less smoothing keeps thinner parts, and "
                "smaller sizes ({size_of}) resolve them"
            )
            lines.append(Message(text, self._measure, listed))
        if self.pinched[0]:
            n, place = self.pinched
            lines.append(
                f"the boundary is not manifold: {n} {'edges' if found.cell_dim == 3 else 'nodes'} "
                f"of it belong to more than two facets, one at {place_text(place)}; more smoothing "
                "or smaller sizes separate what touches there"
            )
        return lines


def outcome_of_remeshing(
    new: SimplexMesh,
    old: SimplexMesh,
    size: SizeFunction,
    tolerance: float,
    elements: float | None = None,
    check: MeshCheck | None = None,
    elements_there: RequestedElements | None = None,
) -> Outcome:
    """Compare a new mesh with the repaired old one, its sizes, and the number requested.

    ``check`` and ``elements_there`` are what `remesh` has found when it compared them; these take
    longest.
    """
    from adaptsize.quality import by_place, check_mesh
    from adaptsize.quality.boundary import region_measures
    from adaptsize.quality.certificate import (
        angles_requirement,
        edges_requirement,
        of_domain,
        served_requirement,
    )
    from adaptsize.quality.conformity import with_served
    from adaptsize.quality.requests import unserved

    # Edges as `adaptsize check` does, which has the nodal sizes only; these do not show what was
    # requested between the nodes.
    sizes = new.point_data.get("h", size)
    if check is None:
        check = check_mesh(new, original=old, tolerance=tolerance)
    if elements_there is None:
        elements_there = by_place.RequestedElements.of(new, size)
    of_sizes = edges_requirement(new, sizes), *served_requirement(elements_there)
    angles = angles_requirement(new, old, tolerance)
    check = replace(check, requirements=(*of_domain(check), *of_sizes, *angles))
    found = with_served(conformity_beside(check, new, sizes, old), elements_there.served(size))
    same_kind = old.cell_dim == new.cell_dim
    was, made = (region_measures(mesh) if same_kind else {} for mesh in (old, new))
    return Outcome(
        kind_of(new),
        found,
        check,
        _predicted(new, size) if elements is None else elements,
        elements is not None,
        tolerance,
        _change(new, old, check),
        {tag: (made[tag], made[tag] / was[tag] - 1.0) for tag in was if tag in made},
        sharp_cells(new),
        names=names_of_regions(new),
        unserved=tuple(str(one) for one in unserved(elements_there, size)),
    )


def conformity_beside(
    check: MeshCheck, mesh: SimplexMesh, size: SizeLike, original: SimplexMesh | None
) -> Conformity:
    """Return the conformity of a mesh, with the distance of the boundary that the check found.

    The distance from an open surface to the mesh is the only one that is compared.
    """
    from adaptsize.quality import size_conformity

    found: Conformity = size_conformity(mesh, size)
    away = check.distance("boundary")
    if original is None or away is None:
        return found
    return replace(found, hausdorff=away * original.diagonal, hausdorff_relative=away)


def names_of_regions(mesh: SimplexMesh) -> dict[int, str]:
    """Return the names of the regions that have one."""
    return {tag: name for (dim, tag), name in mesh.tag_names.items() if dim == mesh.cell_dim}


def sharp_cells(mesh: SimplexMesh) -> tuple[int, tuple[float, ...]]:
    """Return the number of cells with small angles, and the centroid of the worst."""
    from adaptsize.quality.elements import minimum_angles

    angles = minimum_angles(mesh)
    worst = int(angles.argmin())
    place = tuple(mesh.points[mesh.cells[worst]].mean(axis=0).tolist())
    return int((angles < tuning.SHARP).sum()), place


def outcome_of_image(mesh: SimplexMesh, image: Image, options: ImageOptions) -> Outcome:
    """Compare a mesh of an image with its nodal field h, and its volume with that of the voxels."""
    from adaptsize.domain_size.masks import mask_of
    from adaptsize.quality import check_mesh, size_conformity
    from adaptsize.quality.boundary import region_measures

    was, made = mask_of(image, options).measures(), region_measures(mesh)
    skin = mesh.boundary().mesh
    pinched = skin.facets[skin.facet_cell_counts > 2]
    return Outcome(
        kind_of(mesh),
        size_conformity(mesh, mesh.point_data["h"]),
        check_mesh(mesh, size=mesh.point_data["h"]),
        change=float(mesh.measures.sum() / sum(was.values()) - 1.0),
        regions={k: (made.get(k, 0.0), made.get(k, 0.0) / was[k] - 1.0) for k in was if made},
        sharp=sharp_cells(mesh),
        names=names_of_regions(mesh),
        pinched=(len(pinched), tuple(skin.points[pinched[:1]].mean(axis=1).ravel().tolist())),
    )


def _percent(change: float) -> str:
    return f"{round(change, 4) + 0.0:+.2%}"  # zero without a minus sign


def _predicted(new: SimplexMesh, size: SizeFunction) -> float:
    """Return the predicted number of cells of the kind that was made."""
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.reports import report_of
    from adaptsize.sizes import predict

    background = size.background
    if new.cell_dim < new.dim and isinstance(background, SimplexMesh):  # a surface, not a volume
        return predict(background, size.values).cells
    return report_of(size).n_elements


def _change(new: SimplexMesh, old: SimplexMesh, check: MeshCheck) -> float | None:
    """Return the relative change of the area or volume; None if the old one has no volume."""
    from adaptsize.geometry.solid import Solid

    if old.cell_dim == new.cell_dim:
        before = old.measures.sum()
    else:
        found = [
            requirement.value for requirement in check.requirements if requirement.name == "measure"
        ]
        if found:
            return found[0]
        before = Solid.of(old).volume
    return float(new.measures.sum() / before - 1.0) if before > 0.0 else None
