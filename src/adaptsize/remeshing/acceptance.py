"""Check that a generated mesh fills the domain that was given, at least roughly.

`adaptsize.check_mesh` measures it exactly.  What is refused here is no result at all.
"""

from __future__ import annotations

import warnings

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendError, BoundaryWarning
from adaptsize.quality.boundary import skin_of, topology_of
from adaptsize.remeshing.protocol import Problem
from adaptsize.typing import FloatArray

#: A boundary farther away than this, over the diagonal, is another one.  Coarse sizes and cut
#: corners give less.
_FAR = 0.05
#: Distances of a boundary over the tolerance that are warned of.  Mmg on a first volume by fTetWild
#: reaches 4 times the tolerance, everything else less.
_MUCH = 4.0
#: Allowed change of the volume or area of a mesh.
_CHANGE = 0.25


def refuse_other_domain(new: SimplexMesh, problem: Problem, backend: str) -> None:
    """Refuse a mesh of another domain.

    Of an open surface, which a generator closes as it likes, only the bounding box counts.

    Raises
    ------
    BackendError
        If the bounding box, the boundary or the volume is far from the given one.
    """
    old = problem.mesh
    far = max(_FAR * old.diagonal, 10.0 * problem.tolerance)
    ends = np.stack([[mesh.points.min(axis=0), mesh.points.max(axis=0)] for mesh in (new, old)])
    _refuse_beyond(far, float(np.abs(ends[0] - ends[1]).max()), "bounding box", problem, backend)
    old_skin = skin_of(old)
    if not old_skin.is_closed:
        return
    # An inner part of a surface may end up inside the volume, hence not the boundary of new.
    lost = _farthest(old_skin.points, new, far)[0]
    added = _farthest(skin_of(new).points, old_skin, far)[0]
    _refuse_beyond(far, max(lost, added), "boundary", problem, backend)
    if old.cell_dim == new.cell_dim == new.dim:
        change = float(new.measures.sum() / old.measures.sum() - 1.0)
        allowed = max(_CHANGE, problem.tolerance * old_skin.measures.sum() / old.measures.sum())
        if abs(change) > allowed:
            raise BackendError(
                f"{backend} returned a mesh of another domain: its measure differs by {change:+.0%}"
            )


def _refuse_beyond(far: float, distance: float, what: str, problem: Problem, backend: str) -> None:
    if distance > far:
        share = distance / problem.mesh.diagonal
        raise BackendError(
            f"{backend} returned a mesh of another domain: its {what} is off by {share:.2g} of the "
            f"diagonal, at most {far / problem.mesh.diagonal:.2g} is accepted"
        )


def warn_of_deviation(
    new: SimplexMesh, old: SimplexMesh, tolerance: float, *, may_be_joined: bool = False
) -> None:
    """Warn if the boundary of a mesh is much farther from the given one than the tolerance.

    Only nodes are measured.  At any distance, another topology is warned of.  An open surface is
    left out: of that `warn_of_surface` warns.

    Parameters
    ----------
    new, old : SimplexMesh
    tolerance : float
        In the unit of the coordinates.
    may_be_joined : bool
        Whether parts of the old surface may be inside the mesh, or be joined, without a warning.

    Warns
    -----
    BoundaryWarning
        With the largest distance and its place, or both topologies.
    """
    old_skin, skin = skin_of(old), skin_of(new)
    if not old_skin.is_closed:
        return
    far = _MUCH * tolerance
    deviations = (
        (
            "the mesh misses part of the domain: its boundary is",
            *_farthest(old_skin.points, new, far),
        ),
        ("the boundary of the mesh is", *_farthest(skin.points, old_skin, far)),
    )
    what, distance, where = max(deviations, key=lambda deviation: deviation[1])
    advice = "lower the tolerance if thin parts are lost, or use strict=True"
    if distance == 0.0 and not may_be_joined:
        distance, where = _farthest(old_skin.points, skin, far)
        what = "the mesh fills both sides of a part of the surface: its boundary is"
        advice = "a body inside another one is a cavity only if its triangles have the other side"
    if distance == 0.0:
        if not may_be_joined:
            _warn_of_topology(skin, old_skin)
        return
    place = ", ".join(f"{x:.4g}" for x in where)
    warnings.warn(
        f"{what} {distance:.3g} from the given one at ({place}), where the tolerance is "
        f"{tolerance:.3g}; {advice}",
        BoundaryWarning,
        stacklevel=3,
    )


def _warn_of_topology(skin: SimplexMesh, old_skin: SimplexMesh) -> None:
    """Warn if a boundary has other components or handles than a given closed manifold.

    A thin wall or gap may be lost within the distance that is not warned of.
    """
    old = topology_of(old_skin)
    if old is None:
        return
    new = topology_of(skin)
    given = f"{old.n_components} component(s) with Euler number {old.euler_number}"
    if new is None:
        found = "no closed manifold"
    elif (new.n_components, new.euler_number) == (old.n_components, old.euler_number):
        return
    else:
        found = f"{new.n_components} component(s) with Euler number {new.euler_number}"
    warnings.warn(
        f"the boundary of the mesh has another topology than the given one: {found}, given: "
        f"{given}; walls or gaps about as thin as the tolerance may be lost or filled; lower the "
        "tolerance or use strict=True",
        BoundaryWarning,
        stacklevel=4,
    )


def _farthest(points: FloatArray, mesh: SimplexMesh, far: float) -> tuple[float, FloatArray]:
    """Return the distance and the place of the farthest point; 0 if none is beyond ``far``."""
    from scipy.spatial import cKDTree

    near = cKDTree(mesh.points).query(points, distance_upper_bound=far)[0]
    rest = points[~np.isfinite(near)]  # few, unless cells are large
    if not len(rest):
        return 0.0, points[0]
    distance = mesh.locator.nearest(rest)[2]
    k = int(distance.argmax())
    return float(distance[k] if distance[k] > far else 0.0), rest[k]
