"""Local feature size without a grid: the largest spheres inside a boundary."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_points
from adaptsize._kernels import inscribed_spheres as kernels
from adaptsize._kernels import interpolate as tree_kernels
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.geometry._solid import Probes, Solid, along_curve
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# A compiled loop cannot be interrupted; one call of it should last about this long.
_SECONDS_PER_CALL = 0.3
# Two planes meet at an edge if it comes as near to their line as this, over the distance of
# the points where the ball touches them.
_AT_EDGE = 0.5
# Likewise for tips, over what a cone as sharp as the corner angle has.
_AT_TIP = 1.1


@dataclass(frozen=True, eq=False)
class InscribedSpheres:
    """Spheres that touch a boundary from inside, as large as they can be."""

    points: FloatArray
    """Where each touches the boundary, float64[n, dim]."""
    normals: FloatArray
    """Unit normals there, into the domain, float64[n, dim]."""
    radii: FloatArray
    """float64[n]; inf where nothing is opposite."""
    contacts: FloatArray
    """Where each touches the boundary again, float64[n, dim]; nan where it does not."""
    owners: IntArray
    """Node of the boundary, or number of the given point, int32[n]; may repeat at creases."""
    n_owners: int
    """Number of nodes, or of given points."""

    def __repr__(self) -> str:
        """Say how many of which radii."""
        finite = self.radii[np.isfinite(self.radii)]
        radii = f", radii {finite.min():.4g} to {finite.max():.4g}" if len(finite) else ""
        return f"InscribedSpheres({len(self.radii)} spheres at {self.n_owners} points{radii})"

    @property
    def centres(self) -> FloatArray:
        """Centres, float64[n, dim]: points of the medial axis; nan where the radius is inf."""
        radii = np.where(np.isfinite(self.radii), self.radii, np.nan)
        return self.points + radii[:, None] * self.normals

    def smallest(self) -> FloatArray:
        """Return the smallest radius of each owner, float64[n_owners]; inf where it has none."""
        radii = np.full(self.n_owners, np.inf)
        np.minimum.at(radii, self.owners, self.radii)
        return radii


def inscribed_spheres(
    boundary: SimplexMesh,
    points: npt.ArrayLike | None = None,
    *,
    crease_angle: float = 40.0,
    separation_angle: float = 40.0,
    corner_angle: float = 30.0,
    progress: ProgressCallback | bool | None = None,
) -> InscribedSpheres:
    """Return the largest spheres inside a boundary that touch it at given points."""
    finder = SphereFinder(
        boundary,
        crease_angle=crease_angle,
        separation_angle=separation_angle,
        corner_angle=corner_angle,
    )
    return finder.at_nodes(progress) if points is None else finder.near(points, progress)


class SphereFinder:
    """A boundary prepared for `inscribed_spheres`, to be asked several times.

    Parameters
    ----------
    boundary, crease_angle, separation_angle, corner_angle
        As for `inscribed_spheres`.
    """

    def __init__(
        self,
        boundary: SimplexMesh,
        *,
        crease_angle: float = 40.0,
        separation_angle: float = 40.0,
        corner_angle: float = 30.0,
    ) -> None:
        if (boundary.cell_dim, boundary.dim) not in {(1, 2), (2, 3)}:
            raise ValueError(
                f"boundary must consist of segments in 2-D or triangles in 3-D, got {boundary!r}"
            )
        crease = _as_angle("crease_angle", crease_angle)
        self._separation = _as_angle("separation_angle", separation_angle)
        self._corner = _as_angle("corner_angle", corner_angle)
        self._boundary = boundary
        self._solid = Solid.of(boundary, crease)

    def at_nodes(self, progress: ProgressCallback | bool | None = None) -> InscribedSpheres:
        """Return the spheres at the nodes of the boundary."""
        return self._spheres(self._solid.probes_at_nodes(), self._boundary.n_points, progress)

    def near(
        self, points: npt.ArrayLike, progress: ProgressCallback | bool | None = None
    ) -> InscribedSpheres:
        """Return the spheres at the points of the boundary that are closest to given ones."""
        given = as_points("points", points, self._boundary.dim)
        return self._spheres(self._solid.probes_near(given), len(given), progress)

    def _spheres(
        self, probes: Probes, n_owners: int, progress: ProgressCallback | bool | None
    ) -> InscribedSpheres:
        with reporting(progress) as report:
            radii, contacts = _shrink(self._solid, probes, self._separation, self._corner, report)
        dim = self._boundary.dim
        contacts = np.where(np.isfinite(radii)[:, None], contacts, np.nan)
        return InscribedSpheres(
            probes.points[:, :dim],
            probes.normals[:, :dim],
            radii,
            contacts[:, :dim],
            probes.owners.astype(np.int32),
            n_owners,
        )


def _shrink(
    solid: Solid, probes: Probes, separation: float, corner: float, report: ProgressCallback
) -> tuple[FloatArray, FloatArray]:
    """Return the radius at each probe, and where the sphere touches the boundary again."""
    n = len(probes.points)
    order = along_curve(probes.points)
    sine = max(math.sin(0.5 * math.radians(separation)), 0.01)
    opening = math.radians(corner)
    angles = np.array([
        sine, math.cos(opening), _AT_EDGE, _AT_TIP / max(math.tan(0.5 * opening), 1e-3),
        math.pi + opening + 1e-6,
    ])  # fmt: skip
    tree, bends = solid.tree, solid.bends
    # No point is farther than the diagonal, nor lower over the tangent plane than the angle.
    largest = 1.01 * solid.boundary.diagonal / (2.0 * sine)
    cells = (tree.points, tree.cells, solid.inward, tree.boxes, solid.slabs)
    corners = (bends.points, bends.cells, bends.boxes, solid.tips)
    where = (probes.starts, probes.normals, *_corners_near(solid, probes, order))
    radii, contacts, touched = np.empty(n), np.empty((n, 3)), np.empty(n, np.int32)
    first, step = 0, 1024
    while first < n:
        last = min(first + step, n)
        start = time.perf_counter()
        kernels.shrink_balls(
            *cells, *corners, *where, angles, largest, order, first, last,
            radii, contacts, touched,
        )  # fmt: skip
        seconds = time.perf_counter() - start
        step = 2 * step if seconds < 0.5 * _SECONDS_PER_CALL else max(step // 2, 1)
        first = last
        report("inscribed spheres", first / n)
    return radii, contacts


def _corners_near(
    solid: Solid, probes: Probes, order: npt.NDArray[np.intp]
) -> tuple[FloatArray, IntArray]:
    """Return the distance of each probe to the edges, and its nearest tip (-1: none)."""
    from scipy.spatial import cKDTree

    n, bends = len(probes.points), solid.bends
    reaches, nearest_tip = np.full(n, np.inf), np.full(n, -1, np.int32)
    if len(bends.cells) > 0:
        found, weights = np.empty(n, np.int32), np.empty((n, 2))
        tree = (bends.points, bends.cells, bends.boxes, False)
        tree_kernels.locate(*tree, probes.starts, order, 0, n, found, weights, reaches)
    if len(solid.tips) > 0:
        nearest_tip = cKDTree(solid.tips).query(probes.starts)[1].astype(np.int32)
    return reaches, nearest_tip


def _as_angle(name: str, value: float) -> float:
    angle = as_number(name, value, lower=0.0)
    if angle > 180.0:
        raise ValueError(f"{name} must be at most 180 degrees, got {angle:g}")
    return angle
