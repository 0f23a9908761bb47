"""Requirements that a mesh must meet: which are met, nearly met or missed, and where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from adaptsize._checks import as_number, as_tolerance, as_whole_number, length_text, place_text
from adaptsize._defaults import TOLERANCE
from adaptsize._printed import Printed
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import skin_of
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.creases import least_angle_between
from adaptsize.geometry.solid import Solid
from adaptsize.quality.boundary import (
    Distances,
    Topology,
    distances_from,
    distances_from_solid,
    interface_distances,
    overlapping_cells,
    region_measures,
    tagged_parts,
    topology_of,
)
from adaptsize.quality.by_place import BAND, RequestedElements, is_in_band
from adaptsize.quality.conformity import SizeLike, edge_ratios, inverted_cells
from adaptsize.quality.connections import repeated_cells, unconnected
from adaptsize.quality.elements import check_cells, minimum_angles
from adaptsize.quality.requests import SHARE_SERVED
from adaptsize.quality.walls import across_walls
from adaptsize.typing import FloatArray

#: Generators bring more edges than this within a factor sqrt 2 of sizes that the geometry allows.
SHARE_IN_BAND = 0.8
#: A change of the volume or area up to this share is accepted, whatever the tolerance.
VOLUME_CHANGE = 0.005
#: Tetrahedra with a smaller dihedral angle, in degrees, are too flat.  Commands warn below 10.
LEAST_ANGLE = 5.0
#: A figure that is beyond its limit by up to this share of the limit is near it.
NEAR = 0.1
#: Relative error of sums of volumes.
_ROUNDING = 1e-9
#: A closed surface that encloses less than this times a power of the diagonal is a flat bag.
_NO_VOLUME = 1e-12

#: Whether a requirement is met, is beyond its limit by at most 10 % of that, or is missed.
Status: TypeAlias = Literal["met", "near", "missed"]


@dataclass(frozen=True)
class Place:
    """A place where a mesh does not meet a requirement."""

    point: tuple[float, ...]
    value: float
    """What is wrong there: measure or angle of a cell, distance, or edge length over size."""


@dataclass(frozen=True)
class Requirement:
    """One property that a mesh must have.

    Attributes
    ----------
    name : str
        ``"cells"``, ``"facets"``, ``"overlaps"``, ``"boundary"``, ``"interface"``, ``"tags"``,
        ``"regions"``, ``"measure"``, ``"topology"``, ``"edges"``, ``"served"`` or ``"angles"``.
    status : {"met", "near", "missed"}
        ``"near"`` if the figure is beyond its limit by at most 10 % of the limit.
    text : str
        What was measured and what is allowed.
    value, limit : float or None
        The figure and its limit: distances over the diagonal of ``"boundary"``, ``"interface"`` and
        ``"tags"``; relative changes of ``"measure"`` and ``"regions"``; shares of ``"edges"`` and
        ``"served"``, which must be at least the limit.  None for other requirements.
    places : tuple of Place
        The worst places, the worst first.  Empty if the requirement is met or concerns no place.
    """

    name: str
    status: Status
    text: str
    value: float | None = None
    limit: float | None = None
    places: tuple[Place, ...] = ()

    @property
    def is_met(self) -> bool:
        """Whether the figure is within its limit."""
        return self.status == "met"

    def as_dict(self) -> dict[str, Any]:
        """Return a dictionary of plain values, suitable for JSON."""
        return {"is_met": self.is_met, **asdict(self)}


@dataclass(frozen=True)
class MeshCheck(Printed):
    """Which requirements a mesh meets.

    Attributes
    ----------
    requirements : tuple of Requirement
    notes : tuple of str
        What was not compared, and why.
    """

    requirements: tuple[Requirement, ...]
    notes: tuple[str, ...] = ()

    @property
    def is_met(self) -> bool:
        """Whether all requirements are met."""
        return not self.failures

    @property
    def status(self) -> Status:
        """The worst status of a requirement.  The commands exit with 1 if it is ``"missed"``."""
        if self.missed:
            return "missed"
        return "near" if self.failures else "met"

    @property
    def failures(self) -> tuple[Requirement, ...]:
        """The requirements that are not met: near or missed."""
        return tuple(requirement for requirement in self.requirements if not requirement.is_met)

    @property
    def missed(self) -> tuple[Requirement, ...]:
        """The requirements that are missed."""
        return tuple(
            requirement for requirement in self.requirements if requirement.status == "missed"
        )

    def distance(self, name: str) -> float | None:
        """Return the distance of ``"boundary"``, ``"interface"`` or ``"tags"``; None if unknown."""
        return next((one.value for one in self.requirements if one.name == name), None)

    def as_dict(self) -> dict[str, Any]:
        """Return dictionaries and lists of plain values, suitable for JSON."""
        requirements = [requirement.as_dict() for requirement in self.requirements]
        return {
            "is_met": self.is_met, "status": self.status, "requirements": requirements,
            "notes": self.notes,
        }  # fmt: skip

    def __str__(self) -> str:
        """Return one line per requirement, and the worst places."""
        shown = {"met": "met", "near": "near", "missed": "MISSED"}
        lines = []
        for requirement in self.requirements:
            lines.append(f"{requirement.name:9} {shown[requirement.status]:7} {requirement.text}")
            for place in requirement.places:
                lines.append(f"{'':18}{place.value:.4g} at {place_text(place.point)}")
        lines += [f"{'note':17} {note}" for note in self.notes]
        return "\n".join(lines)


def check_mesh(
    mesh: SimplexMesh,
    *,
    original: SimplexMesh | None = None,
    size: SizeLike | None = None,
    tolerance: float = TOLERANCE,
    share_in_band: float = SHARE_IN_BAND,
    share_served: float = SHARE_SERVED,
    n_places: int = 5,
) -> MeshCheck:
    """Check that a mesh is sound, fills the same domain as another, and follows the sizes.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles or tetrahedra.
    original : SimplexMesh, optional
        The mesh, surface or outline whose domain ``mesh`` must fill.
    size : SizeFunction, callable, array_like of float, shape (n_points,), or float, optional
        Requested edge lengths, as in `size_conformity`.
    tolerance : float
        Allowed distance of the boundaries from each other, over the diagonal of the bounding box
        of ``original``; at most 1.
    share_in_band : float
        Required share of the edges whose length is within a factor sqrt 2 of the size.
    share_served : float
        Required share of the requested elements that are served, see `size_conformity`.
    n_places : int
        Number of worst places to list for each requirement that is not met.

    Returns
    -------
    MeshCheck

    Raises
    ------
    ValueError
        If an argument is invalid or the meshes do not fit each other.

    Notes
    -----
    A figure beyond its limit by at most 10 % of the limit is *near*, and *missed* beyond that: of
    distances and changes of volumes above 1.1 times what is allowed, of shares below .9 times what
    is required.  The first three requirements, missing tags, the topology and the angles are met or
    missed.

    The requirements are:

    - *cells*: none is inverted or flat, and none has the same nodes as another.
    - *facets*: each facet of a volume mesh or a plane mesh belongs to one or two cells.
    - *overlaps*: no point is in two cells of a volume mesh.  Depths below 1e-6 of the diagonal do
      not count.
    - *boundary*: each boundary is within the tolerance of the other one.  The distance is that of
      the farthest point: facets are divided until it is known to 1 %.  Where ``original`` is a
      surface with holes, the boundary of ``mesh`` may be where the winding number is between 1/4
      and 3/4.
    - *interface*: the same for facets between regions and tagged facets inside of them, if both
      meshes have any.
    - *tags*: the mesh has facets of each tag of ``original``, and those of each tag are within the
      tolerance of the old ones and vice versa.  Likewise tagged triangles of a surface, if the mesh
      has any, or edges of it.
    - *regions*: both meshes have the same ones, and the volume or area of each has changed by at
      most the tolerance times its boundary.
    - *measure*: the volume or area is the enclosed one up to .5 %, or up to what the tolerance
      explains if that is more: the tolerance times the area of the boundary, and twice the integral
      of the distance over the boundary, the larger of the two directions.  The smaller of these
      counts.  On parts that generators make, the second is 2 to 300 times stricter.
    - *topology*: the boundary has as many components as that of ``original``, and the same Euler
      number, hence the same number of handles.
    - *edges*: enough of them are near their size.  Those from one side of the boundary to the
      opposite one that are shorter do not count.
    - *served*: at the places of enough of the requested elements, the cells have their size.
    - *angles*: no tetrahedron has a dihedral angle below 5 degrees, unless facets of ``original``
      meet at such an angle.  Like the two above, it is compared if ``size`` is given: cells that
      depend on the direction may be flat.

    Notes of the result report cells side by side that are not connected: slits, nodes at one place
    that are not joined, and nodes in the middle of an edge (hanging nodes).

    A surface encloses the union of its bodies: where the winding number is above one half, after
    facets that contradict their neighbours are flipped.  Facets inside of it are not compared.  The
    topology is compared if the boundaries are closed manifolds, whose facets do not intersect each
    other.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> half = SimplexMesh(square.points, square.cells[:1])
    >>> check = check_mesh(half, original=square)
    >>> check.is_met, [requirement.name for requirement in check.failures]
    (False, ['boundary', 'measure'])
    """
    mesh = as_mesh("mesh", mesh)
    check_cells(mesh)
    tolerance = as_tolerance("tolerance", tolerance)
    share, least = (
        as_number(name, value, lower=0.0, upper=1.0)
        for name, value in (("share_in_band", share_in_band), ("share_served", share_served))
    )
    count = as_whole_number("n_places", n_places, lower=0, upper=10**9)
    if original is not None:
        original = as_mesh("original", original)
        if mesh.dim != original.dim or original.cell_dim < mesh.dim - 1:
            raise ValueError(
                f"original must be a mesh or a boundary in {mesh.dim}-D, "
                f"got {original!r} for {mesh!r}"
            )
        if original.diagonal == 0.0:
            raise ValueError(f"original must not be a single point, got {original!r}")
    return checked_mesh(
        mesh, original, size, tolerance, share_in_band=share, share_served=least, count=count
    )


def checked_mesh(
    mesh: SimplexMesh,
    original: SimplexMesh | None,
    size: SizeLike | None,
    tolerance: float,
    *,
    solid: Solid | None = None,
    share_in_band: float = SHARE_IN_BAND,
    share_served: float = SHARE_SERVED,
    count: int = 5,
) -> MeshCheck:
    """Return `check_mesh` of checked arguments; ``solid`` is what ``original`` encloses, if known.

    So that several meshes of the same surface can be compared with it.
    """
    requirements, notes = [_cells(mesh, count)], list[str]()
    if mesh.cell_dim == mesh.dim:
        requirements.append(_facets(mesh, count))
        notes += [str(found) for found in unconnected(mesh)]
    if mesh.cell_dim == 3:
        requirements.append(_overlaps(mesh))
    if original is not None:
        requirements += _same_domain(mesh, original, tolerance, count, notes, solid)
    if size is not None:
        requirements += size_requirements(mesh, size, share_in_band, share_served, count)
        requirements += angles_requirement(mesh, original, tolerance, count)
    return MeshCheck(tuple(requirements), tuple(notes))


def _cells(mesh: SimplexMesh, count: int) -> Requirement:
    again = repeated_cells(mesh)[:, 0]
    measures = mesh.signed_measures if mesh.cell_dim == mesh.dim else mesh.measures
    bad = np.flatnonzero(inverted_cells(mesh))
    text = f"{len(bad)} of {mesh.n_cells} inverted or flat"
    if len(again):
        text += f", {len(again)} with the nodes of another"
    bad = np.union1d(bad, again)
    worst = bad[np.argsort(measures[bad])]
    centroids = mesh.points[mesh.cells[worst[:count]]].mean(axis=1)
    places = _places(centroids, measures[worst], count)
    return Requirement("cells", _none(len(bad)), text, places=places)


def _facets(mesh: SimplexMesh, count: int) -> Requirement:
    bad = np.flatnonzero(mesh.facet_cell_counts > 2)
    text = f"{len(bad)} of {len(mesh.facets)} in more than two cells"
    centres = mesh.points[mesh.facets[bad[:count]]].mean(axis=1)
    counts = mesh.facet_cell_counts[bad].astype(np.float64)
    return Requirement("facets", _none(len(bad)), text, places=_places(centres, counts, count))


def _overlaps(mesh: SimplexMesh) -> Requirement:
    found = overlapping_cells(mesh)
    if found is None:
        return Requirement("overlaps", "met", "no point in two cells")
    return Requirement("overlaps", "missed", str(found), places=(Place(found.place, found.volume),))


def _none(count: int) -> Status:
    return "met" if count == 0 else "missed"


def _at_most(value: float, limit: float) -> Status:
    """Return the status of a figure that must not be above its limit, up to rounding."""
    if value <= limit * (1.0 + _ROUNDING) + _ROUNDING:
        return "met"
    return "near" if value <= (1.0 + NEAR) * limit else "missed"


def _at_least(share: float, limit: float) -> Status:
    """Return the status of a share that must not be below its limit."""
    if share >= limit:
        return "met"
    return "near" if share >= (1.0 - NEAR) * limit else "missed"


class _Domain(NamedTuple):
    """The domain that a mesh must fill."""

    boundary: SimplexMesh
    is_closed: bool
    diagonal: float
    solid: Solid | None
    """What a surface encloses, if the domain is given by one."""

    @classmethod
    def of(cls, original: SimplexMesh, mesh: SimplexMesh, solid: Solid | None) -> _Domain:
        """Return the domain of the original; ``solid``: what it encloses, if known."""
        if mesh.cell_dim == 3 and original.cell_dim == 2:
            solid = Solid.of(original) if solid is None else solid
            return cls(solid.skin, solid.is_closed, original.diagonal, solid)
        boundary = skin_of(original)[0]
        return cls(boundary, boundary.is_closed, original.diagonal, solid)

    def left_out(self) -> Iterator[str]:
        """Yield what of a solid is not compared."""
        if self.solid is None:
            return
        if self.solid.is_divided and not self.solid.skin.is_closed:
            yield "the topology is not compared: bodies of the original overlap or touch"
        elif self.is_closed and self.solid.hidden.any():
            text = "facets of the original are inside of it, and are not compared"
            yield f"{np.count_nonzero(self.solid.hidden)} {text}"

    def distances(self, skin: SimplexMesh, allowed: float, notes: list[str]) -> list[Distances]:
        """Return the distances of the boundaries from each other, as far as they are compared."""
        if self.solid is not None:
            away, opening = distances_from_solid(skin, self.solid, allowed)
            notes += [] if opening is None else [str(opening)]
            return away
        away = [distances_from(self.boundary, skin)]
        if self.is_closed:
            return [*away, distances_from(skin, self.boundary)]
        notes.append("the original is open: only its distance from the mesh is compared")
        return away

    def enclosed(self, topology: Topology | None) -> float:
        """Return the volume or area that it encloses, NaN if unknown."""
        if self.solid is not None and not np.isnan(self.solid.volume):
            return self.solid.volume
        return np.nan if topology is None else topology.enclosed


def _same_domain(
    mesh: SimplexMesh,
    original: SimplexMesh,
    tolerance: float,
    count: int,
    notes: list[str],
    solid: Solid | None,
) -> Iterator[Requirement]:
    """Yield the requirements that compare two domains; notes say what cannot be compared."""
    skin, domain = skin_of(mesh)[0], _Domain.of(original, mesh, solid)
    diagonal, allowed = domain.diagonal, tolerance * domain.diagonal
    notes += domain.left_out()
    away = domain.distances(skin, allowed, notes)
    yield _near("boundary", away, allowed, diagonal, count)
    has_inside = original.cell_dim == original.dim == mesh.cell_dim
    inside = interface_distances(mesh, original) if has_inside else None
    if inside:
        yield _near("interface", inside, allowed, diagonal, count)
    tagged = original if domain.solid is None else domain.solid.skin
    yield from _tags(mesh, tagged, allowed, diagonal, count, notes)
    if has_inside and original.cell_tags is not None:
        if mesh.cell_tags is not None:
            yield _regions(mesh, original, allowed)
        else:
            notes.append("regions are not compared: the mesh has none")
    # Twice, since the distance is integrated from samples.
    between = 2.0 * max(found.integral for found in away)
    explained = min(allowed * float(domain.boundary.measures.sum()), between)
    yield from _measure_and_topology(mesh, skin, domain, explained, notes)


def _measure_and_topology(
    mesh: SimplexMesh, skin: SimplexMesh, domain: _Domain, explained: float, notes: list[str]
) -> Iterator[Requirement]:
    """Yield the requirements on volume and topology; the tolerance explains a change of volume."""
    new, old = topology_of(skin), topology_of(domain.boundary)
    enclosed = domain.enclosed(old)
    if np.isnan(enclosed) and old is None:
        notes.append("volume and topology are not compared: the original is no closed manifold")
        return
    if enclosed <= _NO_VOLUME * domain.diagonal**mesh.dim:
        notes.append("the volume is not compared: the original encloses none")
    elif np.isfinite(enclosed) and (mesh.cell_dim == mesh.dim or new):
        yield _measure(mesh, new, enclosed, explained)
    else:
        notes.append("the volume is not compared: the original is not consistently oriented")
    if old is not None:
        yield _topology(new, old)


def _tags(
    mesh: SimplexMesh,
    original: SimplexMesh,
    allowed: float,
    diagonal: float,
    count: int,
    notes: list[str],
) -> Iterator[Requirement]:
    """Yield the requirement on tagged facets, and on tagged triangles of a surface."""
    common, missing, has_no_faces = tagged_parts(mesh, original)
    if has_no_faces:
        notes.append("tags of the surface are not compared: the mesh has none")
    if missing:
        text = f"{len(missing)} of {len(missing) + len(common)} missing: {', '.join(missing)}"
        yield Requirement("tags", "missed", text)
    elif common:
        away = {
            tag: [distances_from(old, new), distances_from(new, old)]
            for tag, (old, new) in common.items()
        }
        worst = max(away, key=lambda tag: max(found.largest for found in away[tag]))
        samples = [found for pair in away.values() for found in pair]
        requirement = _near("tags", samples, allowed, diagonal, count)
        yield replace(requirement, text=f"{len(away)}; {worst} {requirement.text}")


def _near(
    name: str, away: list[Distances], allowed: float, diagonal: float, count: int
) -> Requirement:
    points = np.concatenate([found.points for found in away])
    distance = np.concatenate([found.distance for found in away])
    largest = float(distance.max())
    limit = f"{allowed:.3g} ({allowed / diagonal:.3g}) allowed"
    text = f"within {length_text(largest, diagonal)}, {limit}"
    bad = np.flatnonzero(distance > allowed * (1.0 + _ROUNDING))
    worst = bad[np.argsort(-distance[bad])][:count]
    places = _places(points[worst], distance[worst], count)
    status: Status = "met"
    if len(bad):
        status = "near" if largest <= (1.0 + NEAR) * allowed else "missed"
    return Requirement(name, status, text, largest / diagonal, allowed / diagonal, places)


def _regions(mesh: SimplexMesh, original: SimplexMesh, allowed: float) -> Requirement:
    new, old = region_measures(mesh), region_measures(original)
    if new.keys() != old.keys():
        texts = [", ".join(map(str, found)) or "none" for found in (new, old)]
        return Requirement("regions", "missed", "; original: ".join(texts))
    changes = {}
    for tag, measure in old.items():
        region = SimplexMesh(original.points, original.cells[original.cell_tags == tag])
        most = allowed * float(region.boundary().mesh.measures.sum()) / measure
        changes[tag] = new[tag] / measure - 1.0, most
    worst = max(changes, key=lambda tag: abs(changes[tag][0]) / (changes[tag][1] + _ROUNDING))
    change, most = changes[worst]
    text = f"{len(old)}; {worst} {_changed(change, most)}"
    return Requirement("regions", _at_most(abs(change), most), text, change, most)


def _changed(change: float, allowed: float) -> str:
    return f"changed by {100.0 * change:+.3g}%, {100.0 * allowed:.3g}% allowed"


def _measure(mesh: SimplexMesh, new: Topology | None, old: float, explained: float) -> Requirement:
    """Return the requirement on the volume or area, of which the tolerance explains a change."""
    if mesh.cell_dim == mesh.dim:
        measure = float(mesh.measures.sum())
    else:
        measure = float("nan") if new is None else new.enclosed
    change, most = measure / old - 1.0, max(VOLUME_CHANGE, explained / old)
    text = _changed(change, most) + (" by the tolerance" if most > VOLUME_CHANGE else "")
    return Requirement("measure", _at_most(abs(change), most), text, change, most)


def _topology(new: Topology | None, old: Topology) -> Requirement:
    if new is None:
        return Requirement("topology", "missed", f"boundary is no closed manifold; original: {old}")
    is_same = new[:2] == old[:2]
    return Requirement("topology", "met" if is_same else "missed", f"{new}; original: {old}")


def edges_requirement(
    mesh: SimplexMesh, size: SizeLike, share: float = SHARE_IN_BAND, count: int = 5
) -> Requirement:
    """Return the requirement on the lengths of edges.

    Edges across walls that are shorter than their size are left out: they are as long as the wall
    is thick, in every mesh.
    """
    ratio = edge_ratios(mesh, size)
    known = ~np.isnan(ratio)
    bound = known & (ratio < BAND[0]) & across_walls(mesh)
    if not (known & ~bound).any():
        bound[:] = False
    left_out = float(bound.sum() / known.sum())
    known = np.flatnonzero(known & ~bound)
    in_band = is_in_band(ratio[known])
    found = float(in_band.mean())
    text = f"{found:.1%} within a factor sqrt 2 of the size, {share:.0%} required"
    if left_out >= 5e-4:
        text += f"; without {left_out:.1%} across walls thinner than their size"
    status = _at_least(found, share)
    if status == "met":
        return Requirement("edges", status, text, found, share)
    with np.errstate(divide="ignore"):  # edges between coincident nodes are the worst
        worst = known[np.argsort(-np.abs(np.log(ratio[known])))][:count]
    middles = mesh.points[mesh.edges[worst]].mean(axis=1)
    return Requirement("edges", status, text, found, share, _places(middles, ratio[worst], count))


def of_domain(check: MeshCheck) -> tuple[Requirement, ...]:
    """Return the requirements but for those on the sizes and the angles."""
    return tuple(
        requirement
        for requirement in check.requirements
        if requirement.name not in ("edges", "served", "angles")
    )


def size_requirements(
    mesh: SimplexMesh,
    size: SizeLike,
    share_in_band: float = SHARE_IN_BAND,
    share_served: float = SHARE_SERVED,
    count: int = 5,
) -> Iterator[Requirement]:
    """Yield the requirements on the sizes."""
    yield edges_requirement(mesh, size, share_in_band, count)
    yield from served_requirement(RequestedElements.of(mesh, size), share_served, count)


def served_requirement(
    elements: RequestedElements, share: float = SHARE_SERVED, count: int = 5
) -> Iterator[Requirement]:
    """Yield the requirement on the requested elements, unless none is requested."""
    found = elements.served()
    if found is None:
        return
    text = (
        f"{found.served:.1%} of the requested elements, {found.too_coarse:.1%} too coarse, "
        f"{share:.0%} required"
    )
    status = _at_least(found.served, share)
    if status == "met":
        yield Requirement("served", status, text, found.served, share)
        return
    ratios = elements.ratios
    off = np.where(elements.weights > 0.0, np.abs(np.log(np.maximum(ratios, 1e-300))), 0.0)
    worst = np.argsort(-off, kind="stable")
    cells = elements.cells[worst]
    worst = worst[np.sort(np.unique(cells, return_index=True)[1])][:count]  # one of each cell
    places = _places(elements.points[worst], ratios[worst], count)
    yield Requirement("served", status, text, found.served, share, places)


def angles_requirement(
    mesh: SimplexMesh, original: SimplexMesh | None, tolerance: float, count: int = 5
) -> Iterator[Requirement]:
    """Yield the requirement on the dihedral angles of tetrahedra; of triangles there is none.

    Where facets of the original meet at a smaller angle, further than the tolerance from the edge,
    no mesh within the tolerance has only larger ones.
    """
    if mesh.cell_dim < 3:
        return
    angles = minimum_angles(mesh)
    flat = np.flatnonzero(angles < LEAST_ANGLE)
    text = f"{len(flat)} of {mesh.n_cells} below {LEAST_ANGLE:g} degrees"
    if len(flat) == 0:
        yield Requirement("angles", "met", text)
        return
    text += f", the least {angles.min():.2g}"
    if original is not None:
        given, at = least_angle_between(skin_of(original)[0], tolerance * original.diagonal)
        if given < LEAST_ANGLE:
            text += f", where facets of the original meet at {given:.2g}, at {place_text(at)}"
            yield Requirement("angles", "met", text)
            return
    worst = flat[np.argsort(angles[flat])][:count]
    centroids = mesh.points[mesh.cells[worst]].mean(axis=1)
    yield Requirement("angles", "missed", text, places=_places(centroids, angles[worst], count))


def _places(points: FloatArray, values: FloatArray, count: int) -> tuple[Place, ...]:
    return tuple(
        Place(tuple(point), float(value))
        for point, value in zip(points[:count].tolist(), values[:count], strict=False)
    )
