"""The judgement of a generated mesh, and warnings of what is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptsize._checks import length_text, place_text, warn_caller
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import skin_of
from adaptsize.errors import BackendError, BoundaryWarning
from adaptsize.geometry.solid import Solid
from adaptsize.quality.boundary import (
    farthest_places,
    interface_distances,
    keeps_topology,
    overlapping_cells,
    tagged_parts,
    topology_of,
)
from adaptsize.quality.certificate import (
    NEAR,
    MeshCheck,
    Requirement,
    angles_requirement,
    checked_mesh,
    size_requirements,
)
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing import tuning
from adaptsize.remeshing.protocol import MeshingProblem
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import FloatArray

#: Requirements on the cells, and on the domain.
_SOUND = frozenset({"cells", "facets", "overlaps"})
_DOMAIN = frozenset({"boundary", "interface", "tags", "regions", "measure", "topology"})


@dataclass(frozen=True)
class Verdict:
    """What the acceptance found on a mesh.

    Attributes
    ----------
    check : MeshCheck
    least_angle : float
        The least dihedral angle, or angle of triangles, in degrees.
    is_off : bool
        Whether nodes of the boundary are off the given one, a part of that is lost, or single
        facets are off where a surface was filled.  Coarse sizes alone, whose edges cut corners of
        the boundary everywhere, do not count: no generator helps.
    sizes : callable
        Returns the requirements on the sizes that are not in ``check``.  They take three times as
        long, and matter only for the rank.
    """

    check: MeshCheck
    least_angle: float
    is_off: bool
    sizes: Callable[[], tuple[Requirement, ...]] = tuple

    @property
    def faults(self) -> frozenset[str]:
        """What another generator may do better, whatever the sizes."""
        missed = {requirement.name for requirement in self.check.missed}
        found = missed & (_SOUND | {"topology"})
        if self.is_off:
            found.add("boundary")
        if self.least_angle < tuning.LEAST_DIHEDRAL:
            found.add("angles")
        return frozenset(found)

    @property
    def is_sound(self) -> bool:
        """Whether no cell is inverted, and no point is in two cells."""
        return not self.faults & _SOUND

    @cached_property
    def rank(self) -> tuple[float, ...]:
        """A better mesh has a smaller one.

        First come sound cells, then the requirements on the domain, the distance of the boundary by
        factors of two, flat cells, the sizes, requirements that are near, and the least angle.
        """
        requirements = [*self.check.requirements, *self.sizes()]
        missed = {
            requirement.name for requirement in requirements if requirement.status == "missed"
        }
        away = 0.0
        for requirement in self.check.missed:
            if requirement.name == "boundary" and requirement.value and requirement.limit:
                away = math.floor(math.log2(requirement.value / requirement.limit))
        return (
            len(missed & _SOUND),
            len(missed & _DOMAIN),
            away,
            self.least_angle < tuning.LEAST_DIHEDRAL,
            len(missed - _SOUND - _DOMAIN),
            sum(not requirement.is_met for requirement in requirements),
            -self.least_angle,
        )

    @property
    def text(self) -> str:
        """The requirements that are not met, with figures, and flat cells."""
        texts = [f"{requirement.name} {requirement.text}" for requirement in self.check.failures]
        if self.least_angle < tuning.LEAST_DIHEDRAL:
            texts.append(f"least angle {self.least_angle:.2g} degrees")
        return ", ".join(texts)


@dataclass(frozen=True)
class Judge:
    """The one acceptance function of `remesh`: compares meshes with the request.

    Attributes
    ----------
    old : SimplexMesh
        The repaired mesh.
    solid : Solid or None
        What a surface to be filled encloses.
    size : callable or None
        The checked sizes; None if they are not compared.
    tolerance : float
        Over the diagonal.
    strict : bool
        Whether a mesh must have the sizes, too.
    """

    old: SimplexMesh
    solid: Solid | None
    size: Size | None
    tolerance: float
    strict: bool = False

    def __call__(self, new: SimplexMesh) -> Verdict:
        """Return what is wrong with a mesh."""
        size, later = self.size, None
        if not self.strict:
            size, later = None, self.size

        def sizes() -> tuple[Requirement, ...]:
            if later is None:
                return ()
            angles = angles_requirement(new, self.old, self.tolerance)
            return *size_requirements(new, later), *angles

        check = checked_mesh(new, self.old, size, self.tolerance, solid=self.solid)
        allowed = self.tolerance * self.old.diagonal
        is_off = any(requirement.name == "boundary" for requirement in check.missed) and _is_off(
            new, self.old, allowed, self.solid
        )
        return Verdict(check, float(minimum_angles(new).min()), is_off, sizes)


def _is_off(new: SimplexMesh, old: SimplexMesh, allowed: float, solid: Solid | None) -> bool:
    """Return whether nodes of the boundary left the given one, or a part of that is lost."""
    old_skin, skin = skin_of(old)[0] if solid is None else solid.skin, skin_of(new)[0]
    if solid is None and not old_skin.is_closed:
        return False
    if _farthest(skin.points, old_skin, (1.0 + NEAR) * allowed, solid=solid)[0] > 0.0:
        return True
    if _farthest(old_skin.points, skin, tuning.FARTHEST_BOUNDARY * allowed, new)[0] > 0.0:
        return True
    return solid is not None and solid.is_closed and _are_few_off(skin, old_skin, allowed)


def _are_few_off(skin: SimplexMesh, old_skin: SimplexMesh, allowed: float) -> bool:
    """Return whether some facets are beyond the allowed distance, but few."""
    limit = (1.0 + NEAR) * allowed
    shares = [
        float((farthest_places(one, other, limit).distance > limit).mean())
        for one, other in ((skin, old_skin), (old_skin, skin))
    ]
    return 0.0 < max(shares) <= tuning.FEW_FACETS_OFF


def refuse_other_domain(new: SimplexMesh, problem: MeshingProblem, backend: str) -> None:
    """Refuse a mesh of another domain.

    Of an open surface, which a generator closes as it likes, only the bounding box counts.

    Raises
    ------
    BackendError
        If the bounding box, the boundary or the volume is far from the given one.
    """
    old = problem.mesh
    far = max(tuning.OTHER_BOUNDARY * old.diagonal, tuning.MOST_TOLERANCES * problem.tolerance)
    ends = np.stack([[mesh.points.min(axis=0), mesh.points.max(axis=0)] for mesh in (new, old)])
    off = {"bounding box": float(np.abs(ends[0] - ends[1]).max())}
    old_skin, skin = skin_of(old)[0], skin_of(new)[0]
    if old_skin.is_closed:
        # An inner part of a surface may end up inside the volume, hence not the boundary of new.
        lost = _farthest(old_skin.points, skin, far, new)[0]
        off["boundary"] = max(lost, _farthest(skin.points, old_skin, far)[0])
    for what, distance in off.items():
        if distance > far:
            raise BackendError(
                f"{backend} returned a mesh of another domain: its {what} is off by "
                f"{length_text(distance, old.diagonal)}, at most "
                f"{length_text(far, old.diagonal)} is accepted"
            )
    if old_skin.is_closed and old.cell_dim == new.cell_dim == new.dim:
        change = float(new.measures.sum() / old.measures.sum() - 1.0)
        moved = problem.tolerance * old_skin.measures.sum() / old.measures.sum()
        allowed = max(tuning.OTHER_MEASURE, moved)
        if abs(change) > allowed:
            raise BackendError(
                f"{backend} returned a mesh of another domain: its measure differs by {change:+.0%}"
            )


def refuse_flat(new: SimplexMesh, backend: str) -> None:
    """Refuse a mesh in the given coordinates with cells that have no measure.

    Generators work near the origin; far away from it, coordinates are rounded more.

    Raises
    ------
    BackendError
        With the number and the first place.
    """
    measures = new.signed_measures if new.cell_dim == new.dim else new.measures
    flat = np.flatnonzero(measures <= 0.0)
    if len(flat):
        place = place_text(new.points[new.cells[flat[0]]].mean(axis=0))
        raise BackendError(
            f"{len(flat)} cells of the mesh by {backend} are flat in the given coordinates, the "
            f"first at {place}: move the part nearer to the origin, or request larger sizes"
        )


def warn_of_deviation(
    new: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    solid: Solid | None = None,
    *,
    may_be_joined: bool = False,
) -> None:
    """Warn if boundary or interfaces are much farther from the given ones than the tolerance.

    Only nodes are measured.  At any distance, another topology is warned of.  Where a surface has
    holes, the boundary may close them.  Tetrahedra that overlap are warned of, too.

    Parameters
    ----------
    new, old : SimplexMesh
    tolerance : float
        In the unit of the coordinates.
    solid : Solid, optional
        What a surface encloses.
    may_be_joined : bool
        Whether parts of the old surface may be inside the mesh, or be joined, without a warning.

    Warns
    -----
    BoundaryWarning
        With the largest distance and its place, or both topologies.
    """
    found_twice = overlapping_cells(new) if new.cell_dim == 3 else None
    if found_twice is not None:
        place = place_text(found_twice.place)
        text = Message("{}, one at {}; use {strict:True}", found_twice, place)
        warn_caller(text, BoundaryWarning)
    old_skin, skin = skin_of(old)[0] if solid is None else solid.skin, skin_of(new)[0]
    if solid is None and not old_skin.is_closed:
        return
    far = tuning.FARTHEST_BOUNDARY * tolerance
    off = {
        "the mesh misses part of the domain: its boundary is": _farthest(
            old_skin.points, skin, far, new
        ),
        "the boundary of the mesh is": _farthest(skin.points, old_skin, far, solid=solid),
    }
    names = "the mesh misses part of an interface: it is", "an interface of the mesh is"
    for what, found in zip(names, interface_distances(new, old), strict=False):
        if found.largest > far:
            off[what] = found.largest, found.points[found.distance.argmax()]
    what, (distance, where) = max(off.items(), key=lambda item: item[1][0])
    advice = Message("lower the tolerance if thin parts are lost, or use {strict:True}")
    if distance == 0.0 and may_be_joined:
        return
    if distance == 0.0:
        distance, where = _farthest(old_skin.points, skin, far)
        what = "the mesh fills both sides of a part of the surface: its boundary is"
        advice = Message(
            "a body inside another one is a cavity only if its triangles have the other side"
        )
    if distance > 0.0:
        shift = f"{what} {distance:.3g} from the given one at {place_text(where, 4)}, where the "
        shift += f"tolerance is {tolerance:.3g}"
    else:
        # A thin wall or gap may be lost within the distance that is not warned of.
        if (solid is not None and not solid.is_closed) or keeps_topology(skin, old_skin):
            return
        shift = (
            "the boundary of the mesh has another topology than the given one: "
            f"{topology_of(skin) or 'no closed manifold'}, given: {topology_of(old_skin)}"
        )
        advice = Message(
            "walls or gaps about as thin as the tolerance may be lost or filled; lower the "
            "tolerance or use {strict:True}"
        )
    warn_caller(Message("{}; {}", shift, advice), BoundaryWarning)


def warn_of_lost_tags(new: SimplexMesh, old: SimplexMesh, backend: str) -> None:
    """Warn if a mesh has no facets with a tag that the old one has.

    Warns
    -----
    BoundaryWarning
        With these tags.
    """
    missing = tagged_parts(new, old).missing
    if missing:
        keeps = Message("; {backend:'mmg'} keeps tagged facets inside of regions")
        advice = "" if backend == "mmg" else keeps
        warn_caller(
            Message(
                "the mesh has lost the facets with the tags {}, which {} did not return{}",
                *(", ".join(missing), backend, advice),
            ),
            BoundaryWarning,
        )


def _farthest(
    points: FloatArray,
    skin: SimplexMesh,
    far: float,
    inside: SimplexMesh | None = None,
    solid: Solid | None = None,
) -> tuple[float, FloatArray]:
    """Return the distance and the place of the farthest point; 0 if none is beyond ``far``.

    The distance is that from a surface or curve, or from the mesh that it is the boundary of.
    Points where a mesh may close holes of a solid do not count.
    """
    from scipy.spatial import cKDTree

    rest, distance = points, np.empty(0)
    near = cKDTree(skin.points).query(rest, distance_upper_bound=far)[0]
    rest = rest[~np.isfinite(near)]
    for mesh in (skin, inside):  # the search tree of the cells is built for few points only
        if len(rest) and mesh is not None:
            distance = mesh.locator.nearest(rest)[2]
            rest, distance = rest[distance > far], distance[distance > far]
    if len(rest) and solid is not None:
        counts = ~solid.is_opening(rest)
        rest, distance = rest[counts], distance[counts]
    if not len(rest):
        return 0.0, points[0]
    k = int(distance.argmax())
    return float(distance[k]), rest[k]
