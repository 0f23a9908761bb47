"""`limit_on_sphere`: gradient limiting along great circles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_points, as_slope, as_threads, refuse_where
from adaptsize._workers import Workers
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.limiting.exact import limit_points
from adaptsize.limiting.problem import as_nodal_sizes
from adaptsize.typing import FloatArray

#: Mean radius of the Earth in metres (IUGG).
EARTH_RADIUS = 6_371_008.8


def limit_on_sphere(
    lon_lat: SimplexMesh | CartesianGrid | npt.ArrayLike,
    h0: npt.ArrayLike,
    g: float,
    *,
    radius: float = EARTH_RADIUS,
    threads: int | None = None,
) -> FloatArray:
    r"""Return the largest size below ``h0`` that grows by at most ``g`` along great circles.

    The result is

    .. math:: h(x) = \min_i \, h_0(x_i) + g \, d(x, x_i), \qquad
        d(x, y) = R \arccos(\hat x \cdot \hat y),

    the gradient limited size on the whole sphere, as `limit_gradient` gives it in convex domains.
    There is no seam at 180 degrees and no singularity at the poles.

    Parameters
    ----------
    lon_lat : SimplexMesh, CartesianGrid or array_like of float, shape (n, 2)
        Longitude and latitude in degrees, as coordinates of a mesh or grid, or as points.
        Longitudes are periodic, latitudes are -90 to 90.
    h0 : float or array_like of float, of the nodal shape
        Upper bound on the size, in the unit of the radius; inf means that there is no bound.
        It must be finite at one node at least.
    g : float
        Gradient limit (length per length), 0 to 1e30.
    radius : float, optional
        Radius of the sphere.  The default is the mean radius of the Earth in metres.
    threads : int, optional
        Number of threads, by default that of numba.  The result does not depend on it.

    Returns
    -------
    ndarray of float64, of the nodal shape
        Finite and at most ``h0``.  ``h[i] - h[j]`` is at most g times the distance of the two
        nodes, to rounding.  Inactive nodes of a grid have inf.

    Raises
    ------
    ValueError
        If a shape is wrong, a latitude is out of range, ``h0`` is not positive or inf
        throughout, or ``g``, ``radius`` or ``threads`` is out of range.

    See Also
    --------
    limit_gradient : distances within a domain, in the plane, in space or on any surface.

    Notes
    -----
    Sizes propagate over land as well as over water.  If they must not, use `limit_gradient` on a
    mesh of the water in space, whose distances run along its triangles.

    ``h0`` bounds the size at the nodes only, so limiting is idempotent.  The angle of a chord c is
    computed as :math:`2\,\mathrm{atan2}(c, \sqrt{4 R^2 - c^2})`, which is accurate for short
    distances.  Near the opposite point, distances are right to about 1e-8 R.

    Bounds that another one makes unnecessary are dropped, and a tree finds those that matter,
    as chords are not longer than arcs.  The cost is O(n log n) in practice.

    Examples
    --------
    1 km at one point, and the sizes in km there, across the 180th meridian, and at the North Pole:

    >>> points = [[179.0, 0.0], [-179.0, 0.0], [0.0, 90.0]]
    >>> limit_on_sphere(points, [1.0, np.inf, np.inf], 0.2, radius=6371.0).round(1)
    array([1.0000e+00, 4.5500e+01, 2.0025e+03])
    """
    of_points = lon_lat.points if isinstance(lon_lat, SimplexMesh | CartesianGrid) else lon_lat
    where = as_points("lon_lat", of_points, 2)
    refuse_where("lon_lat", np.abs(where) > [np.inf, 90.0], where, "must have latitudes -90 to 90")
    shape: tuple[int, ...] = (len(where),)
    if isinstance(lon_lat, SimplexMesh | CartesianGrid):
        shape = lon_lat.nodal_shape
    active = getattr(lon_lat, "active", None)
    bound = as_nodal_sizes("h0", h0, shape, active)
    if not np.isfinite(bound).any():
        raise ValueError("h0 must be finite at one node at least, got inf at all of them")
    slope = as_slope("g", g)
    r = as_number("radius", radius, lower=0.0, strict=True)
    workers = Workers.of(as_threads(threads))
    sizes = bound.reshape(-1)
    h = limit_points(to_sphere(where, r), sizes, len(sizes), slope, workers, r).h.reshape(shape)
    if active is not None:
        h[~active] = np.inf
    return h


def to_sphere(lon_lat: FloatArray, radius: float) -> FloatArray:
    """Return points in space, float64[n, 3], of longitudes and latitudes in degrees."""
    lon, lat = np.deg2rad(lon_lat).T
    around = np.cos(lat)
    return radius * np.column_stack([around * np.cos(lon), around * np.sin(lon), np.sin(lat)])
