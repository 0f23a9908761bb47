"""Check that a generated mesh fills the domain that was given, at least roughly.

`adaptsize.check_mesh` measures it exactly.  What is refused here is no result at all.
"""

from __future__ import annotations

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendError
from adaptsize.quality.boundary import skin_of
from adaptsize.remeshing.protocol import Problem
from adaptsize.typing import FloatArray

#: A boundary farther away than this, over the diagonal, is another one.  Coarse sizes and cut
#: corners give less.
_FAR = 0.05
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
    lost = _farthest(old_skin.points, new, far)
    added = _farthest(skin_of(new).points, old_skin, far)
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


def _farthest(points: FloatArray, mesh: SimplexMesh, far: float) -> float:
    """Return the largest distance of points from a mesh, or less than ``far``."""
    from scipy.spatial import cKDTree

    near = cKDTree(mesh.points).query(points, distance_upper_bound=far)[0]
    rest = points[~np.isfinite(near)]  # few, unless cells are large
    return float(mesh.locator.nearest(rest)[2].max()) if len(rest) else 0.0
