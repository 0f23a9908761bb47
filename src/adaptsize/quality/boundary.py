"""Boundaries of meshes: their distance from each other, and their topology."""

from typing import NamedTuple

import numpy as np

from adaptsize._checks import place_text
from adaptsize._kernels.farthest import SHARE, find_farthest, new_pieces
from adaptsize._kernels.trees import new_stack
from adaptsize._workers import in_all_threads
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import interfaces
from adaptsize.background.location import in_space
from adaptsize.background.topology import compacted, components_of
from adaptsize.geometry.distance.orientation import is_cycle
from adaptsize.geometry.distance.winding import Rule, WindingNumber
from adaptsize.geometry.enclosed import cone_measures, enclosed_measure
from adaptsize.geometry.solid import Solid, sides_of
from adaptsize.typing import BoolArray, FloatArray

#: Distances below this share of the diagonal are not looked at more closely.
_NOTHING = 1e-6
#: A facet takes up to a millisecond.
_FACETS_PER_CALL = 256


class Distances(NamedTuple):
    """Distances of samples of one boundary from another, the farthest place among them."""

    points: FloatArray
    """float64[n, dim]"""
    distance: FloatArray
    """float64[n]"""
    integral: float
    """Of the distance over the boundary: about the volume or area between the two."""

    @property
    def largest(self) -> float:
        """The largest distance; no point of the boundary is farther away by more than 1 %."""
        return float(self.distance.max())


class Opening(NamedTuple):
    """The part of a new boundary that closes holes of a surface."""

    area: float
    """Area of the facets farther away from the surface than the tolerance."""
    place: tuple[float, ...]
    """The centroid of the largest connected part."""
    n_parts: int
    """Number of connected parts."""

    def __str__(self) -> str:
        """Return the area, and the place of the largest part."""
        many = self.n_parts > 1
        parts, largest = (f"{self.n_parts} parts", ", the largest") if many else ("1 part", "")
        where = f"{largest} around {place_text(self.place, 4)}"
        return f"openings are closed by {parts} with an area of {self.area:.3g}{where}"


class Topology(NamedTuple):
    """Topology of a closed surface, or of closed curves in the plane."""

    n_components: int
    euler_number: int
    """Nodes minus edges plus triangles: 2 less 2 per handle, summed over the components.  0 for
    curves."""
    enclosed: float
    """Enclosed volume or area; NaN unless all facets have the same side in common."""

    def __str__(self) -> str:
        """Return the numbers that two surfaces of the same topology have in common."""
        return f"{self.n_components} component(s) with Euler number {self.euler_number}"


class OverlappingCells(NamedTuple):
    """Cells of a mesh that have points in common with others."""

    n_cells: int
    """Number of cells whose centroid is in another cell, or that are at the boundary and have a
    point there in another cell."""
    volume: float
    """Volume of the cells less that of their union."""
    place: tuple[float, ...]
    """A point that is in two cells."""

    def __str__(self) -> str:
        """Return the number of cells and the volume."""
        return f"{self.n_cells} cells overlap others, by a volume of {self.volume:.3g}"


def overlapping_cells(mesh: SimplexMesh) -> OverlappingCells | None:
    """Return the tetrahedra that overlap others, or None.

    A point is in as many cells as the boundary winds around it, if cells are positive and on both
    sides of their common facets.  So the cost is that of the boundary, unless there are overlaps.
    Overlaps less deep than 1e-6 of the diagonal count as contacts.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra.
    """
    skin, _, cells = mesh.boundary()
    if (mesh.facet_cell_counts > 2).any() or not is_cycle(skin):
        return None
    winding = WindingNumber(skin)
    sides = sides_of(skin, winding, Rule(is_closed=True))
    twice = np.maximum(sides.front, sides.back) > 1.5
    if not twice.any():
        return None
    overlap = winding(mesh.points[mesh.cells].mean(axis=1)) > 1.5
    overlap[cells[sides.owner[twice]]] = True
    corners = sides.skin()[0]
    union = SimplexMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    volume = float(mesh.measures.sum() - cone_measures(union, skin.points.mean(axis=0)).sum())
    place = sides.centre[twice][sides.area[twice].argmax()]
    return OverlappingCells(int(np.count_nonzero(overlap)), volume, tuple(place.tolist()))


def interface_distances(mesh: SimplexMesh, original: SimplexMesh) -> list[Distances]:
    """Return the distances of the interfaces of two meshes from each other, in both directions.

    Interfaces are facets between regions and tagged facets inside of them.  The list is empty if
    one of the meshes has none.
    """
    if mesh.cell_dim < mesh.dim or original.cell_dim < original.dim:
        return []
    found = [interfaces(mesh), interfaces(original)]
    surfaces = [one[0] for one in found if one is not None]
    if len(surfaces) < 2:
        return []
    new, old = surfaces
    return [distances_from(old, new), distances_from(new, old)]


class TaggedParts(NamedTuple):
    """Tagged facets of two meshes, or triangles of surfaces, by the tags with their names."""

    common: dict[str, tuple[SimplexMesh, SimplexMesh]]
    """The old and the new facets."""
    missing: list[str]
    """Tags of old facets that no new ones have."""
    has_no_faces: bool
    """Whether the old surface has tagged triangles, and the mesh none."""


def tagged_parts(mesh: SimplexMesh, original: SimplexMesh) -> TaggedParts:
    """Return the tagged facets that a mesh has in common with another, and the missing ones.

    A surface is compared with another, or with the boundary of a volume.
    """
    both = {original.cell_dim, mesh.cell_dim}
    dims = {mesh.dim - 1} | ({mesh.cell_dim - 1} if len(both) == 1 else set[int]())
    common, missing, has_no_faces = dict[str, tuple[SimplexMesh, SimplexMesh]](), list[str](), False
    for dim in sorted(dims - {0}):
        old, new = parts_by_tag(original, dim), parts_by_tag(mesh, dim)
        if old and not new and dim in both:
            has_no_faces = True
            continue
        for tag, part in old.items():
            name = original.tag_names.get((dim, tag))
            text = str(tag) if name is None else f'{tag} "{name}"'
            if tag in new:
                common[text] = part, new[tag]
            else:
                missing.append(text)
    return TaggedParts(common, missing, has_no_faces)


def parts_by_tag(mesh: SimplexMesh, dim: int) -> dict[int, SimplexMesh]:
    """Return the cells or facets of a mesh, those of the given dimension, by tag."""
    is_cells = dim == mesh.cell_dim
    cells = mesh.cells if is_cells else mesh.tagged_facets
    tags = mesh.cell_tags if is_cells else mesh.facet_tags
    if cells is None or tags is None:
        return {}
    return {tag: SimplexMesh(mesh.points, cells[tags == tag]) for tag in np.unique(tags).tolist()}


def region_measures(mesh: SimplexMesh) -> dict[int, float]:
    """Return the volume or area of each region."""
    if mesh.cell_tags is None:
        return {}
    tags, number = np.unique(mesh.cell_tags, return_inverse=True)
    sums = np.bincount(number.reshape(-1), weights=mesh.measures)
    return dict(zip(tags.tolist(), sums.tolist(), strict=True))


class FarPlaces(NamedTuple):
    """The place of each facet that is farthest from another surface or curve."""

    points: FloatArray
    """float64[n, dim]"""
    distance: FloatArray
    """float64[n]"""
    bound: FloatArray
    """float64[n]: no place of the facet is farther away than this."""


def farthest_places(skin: SimplexMesh, other: SimplexMesh, enough: float) -> FarPlaces:
    """Return the place of each facet of a surface or curve that is farthest from another.

    Facets are divided until this is certain to 1 %, or until they are nearer than ``enough``, or
    than 1e-6 of the diagonal: where both are flat, all else is rounding.
    """
    enough = max(enough, _NOTHING * skin.diagonal)
    locator, k = other.locator, skin.cell_dim + 1
    facets = in_space(skin.points[skin.cells].reshape(-1, skin.dim) * locator.scale)
    n = skin.n_cells
    found = np.empty((n, 5))
    corners, near = facets.reshape(n, k, 3), enough * locator.scale

    def task(first: int, last: int) -> None:
        scratch = new_stack(), new_pieces()
        find_farthest(locator.tree, corners, first, last, near, *scratch, found)

    in_all_threads(task, n, _FACETS_PER_CALL)
    found /= locator.scale
    # Facets with too many pieces count with what is certain.
    left = found[:, 4] > (1.0 + 2.0 * SHARE) * np.maximum(found[:, 3], enough)
    found[left, 3] = found[left, 4]
    return FarPlaces(found[:, : skin.dim], found[:, 3], found[:, 4])


def distances_from(skin: SimplexMesh, other: SimplexMesh) -> Distances:
    """Return the distances of a surface or curve from another.

    Samples are the nodes in cells, the midpoints of the edges and the centroids of the cells, and
    places farther away than these, so that no point of the surface is farther away than the
    largest of all distances, to 1 % of that or 1e-6 of the diagonal.
    The integral uses nodes and centroids; it is exact for quadratic polynomials.
    """
    sampled = _sampled(skin, other)
    return _completed(sampled, farthest_places(skin, other, sampled.largest))


def _sampled(skin: SimplexMesh, other: SimplexMesh) -> Distances:
    """Return the distances of nodes, midpoints of edges and, last, centroids."""
    used, cells = compacted(skin.cells)
    samples = [skin.points[used]]
    samples += [skin.points[rows].mean(axis=1) for rows in (skin.edges, skin.cells)]
    points = np.concatenate(samples)
    distance = other.locator.nearest(points)[2]
    n = skin.cell_dim
    at_nodes = distance[cells].sum(axis=1)
    at_centroids = distance[-skin.n_cells :]
    means = (at_nodes / (n + 1) + (n + 1) * at_centroids) / (n + 2)
    return Distances(points, distance, float((skin.measures * means).sum()))


def _completed(sampled: Distances, far: FarPlaces) -> Distances:
    """Return samples and farther places."""
    more = far.distance > sampled.distance.max(initial=0.0)
    return sampled._replace(
        points=np.concatenate([sampled.points, far.points[more]]),
        distance=np.append(sampled.distance, far.distance[more]),
    )


def distances_from_solid(
    skin: SimplexMesh, solid: Solid, allowed: float
) -> tuple[list[Distances], Opening | None]:
    """Return the distances of the boundary of a solid and a new one from each other.

    Of a surface with holes, only the facets where the winding number crosses one half are compared.
    The new boundary may be farther than ``allowed`` from these where the number is between 1/4 and
    3/4 (see `Solid.is_opening`): this is how the holes were closed.  A facet whose farthest place
    is there counts with its samples only.

    Returns
    -------
    list of Distances
        Of the solid from the new boundary, and vice versa without what closes holes.
    Opening or None
        What closes holes; None if nothing does.
    """
    old = solid.skin
    lost = distances_from(old, skin)
    if solid.is_closed:
        return [lost, distances_from(skin, old)], None
    new = _sampled(skin, old)
    closing = new.distance > allowed
    closing[closing] = solid.is_opening(new.points[closing])
    rest = new._replace(points=new.points[~closing], distance=new.distance[~closing])
    far = farthest_places(skin, old, max(allowed, float(rest.distance.max(initial=0.0))))
    counts = far.distance > allowed
    counts[counts] = ~solid.is_opening(far.points[counts])
    rest = _completed(rest, FarPlaces(*(values[counts] for values in far)))
    away = [lost, rest] if len(rest.points) else [lost]
    return away, _opening(skin, closing[-skin.n_cells :])


def _opening(skin: SimplexMesh, closing: BoolArray) -> Opening | None:
    """Return area and place of the facets that close holes."""
    if not closing.any():
        return None
    cells, areas = skin.cells[closing], skin.measures[closing]
    label = components_of(np.concatenate([cells[:, :2], cells[:, 1:]]), skin.n_points)[cells[:, 0]]
    parts, number = np.unique(label, return_inverse=True)
    sums = np.bincount(number.reshape(-1), areas)
    largest = number.reshape(-1) == sums.argmax()
    centroids = skin.points[cells[largest]].mean(axis=1)
    place = np.average(centroids, axis=0, weights=areas[largest])
    return Opening(float(areas.sum()), tuple(place.tolist()), len(parts))


def topology_of(skin: SimplexMesh) -> Topology | None:
    """Return the topology of a surface or curve; None if it is not a closed manifold.

    Only facets are looked at: components that touch in a node count as one.
    """
    if not (skin.facet_cell_counts == 2).all():
        return None
    euler = len(np.unique(skin.cells)) - len(skin.edges) + (skin.cell_dim == 2) * skin.n_cells
    return Topology(n_components(skin), int(euler), enclosed_measure(skin))


def keeps_topology(skin: SimplexMesh, old: SimplexMesh) -> bool:
    """Return whether a boundary has the topology of another one; true if that is no manifold."""
    before, after = topology_of(old), topology_of(skin)
    return before is None or (after is not None and after[:2] == before[:2])


def n_components(mesh: SimplexMesh) -> int:
    """Return the number of components, which have no node in common."""
    return len(np.unique(components_of(mesh.edges, mesh.n_points)[mesh.cells[:, 0]]))
