"""Metrics from the principal curvatures of the boundary."""

from __future__ import annotations

import numpy as np

from adaptsize._checks import as_aspect, as_number
from adaptsize._defaults import CREASE_ANGLE
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.creases import crease_edges
from adaptsize.geometry.curvatures import curvature, sector_curvatures
from adaptsize.metrics.layers import frames
from adaptsize.metrics.metric import Metric
from adaptsize.sizes.curvature import size_from_curvature
from adaptsize.typing import FloatArray, IntArray


def metric_from_curvature(
    mesh: SimplexMesh,
    *,
    elements_per_radian: float = 4.0,
    crease_angle: float = CREASE_ANGLE,
    smoothing: int = 0,
    hmin: float | None = None,
    hmax: float | None = None,
    max_aspect: float = 10.0,
) -> Metric:
    r"""Return the metric that resolves the principal curvatures of the boundary.

    At nodes on the boundary, the sizes along the principal directions are

    .. math:: h_i = 1 / (K |\kappa_i|)

    with K elements per radian: edges may be long along a cylinder and short around it.  At a node
    on feature edges, the metrics of all smooth parts are intersected, also with that of the
    curvature of the edge along its line.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in space, tetrahedra, or triangles in the plane.
    elements_per_radian, crease_angle, smoothing
        As in `size_from_curvature`.
    hmin, hmax : float, optional
        Limits of the sizes.
    max_aspect : float, default 10
        Limit of the aspect ratio, at least 1.

    Returns
    -------
    Metric
        At the nodes of the mesh; inf off the boundary and where it is flat, unless ``hmax`` is
        given.  The size along the normal is the larger of the two in the tangent plane.  In the
        plane the metric is isotropic.

    Raises
    ------
    ValueError
        If the mesh is of another kind or an option is out of range.

    See Also
    --------
    size_from_curvature : the same with one size for all directions.
    limit_metric : the next step, gradient limiting.

    Examples
    --------
    A cylinder of radius 1 and 4 elements per radian, with edges 10 times as long along it:

    >>> import numpy as np
    >>> angle, z = np.meshgrid(np.arange(32) * np.pi / 16, np.arange(4.0))
    >>> points = np.column_stack([np.cos(angle.ravel()), np.sin(angle.ravel()), z.ravel()])
    >>> i, j = (k.ravel() for k in np.meshgrid(np.arange(32), np.arange(3)))
    >>> a, b = 32 * j + i, 32 * j + (i + 1) % 32
    >>> tube = SimplexMesh(points, np.vstack([np.c_[a, b, a + 32], np.c_[b, b + 32, a + 32]]))
    >>> metric_from_curvature(tube).sizes[40].round(3)
    array([0.25, 2.5 , 2.5 ])
    """
    mesh = as_mesh("mesh", mesh)
    aspect = as_aspect("max_aspect", max_aspect)
    per_radian = as_number("elements_per_radian", elements_per_radian, lower=0.0, strict=True)
    if mesh.dim != 3 or mesh.cell_dim == 1:
        size = size_from_curvature(
            mesh, elements_per_radian=per_radian, crease_angle=crease_angle, smoothing=smoothing
        )
        return Metric.isotropic(size, mesh.dim).clip(hmin, hmax, aspect)
    surface, nodes = mesh, np.arange(mesh.n_points, dtype=np.int32)
    if mesh.cell_dim == 3:
        boundary = mesh.boundary()
        surface, nodes = boundary.mesh, boundary.nodes
    on_surface = _of_sectors(surface, per_radian, crease_angle, smoothing, aspect)
    on_surface = on_surface.intersect(_of_edges(surface, per_radian, crease_angle))
    sizes = np.full((mesh.n_points, 3), np.inf)
    directions = np.tile(np.eye(3), (mesh.n_points, 1, 1))
    sizes[nodes], directions[nodes] = on_surface.sizes, on_surface.directions
    return Metric.of(sizes, directions).clip(hmin, hmax, aspect)


def _of_sectors(
    surface: SimplexMesh, per_radian: float, crease_angle: float, smoothing: int, aspect: float
) -> Metric:
    """Return the intersection of the metrics of the smooth parts at each node."""
    node, normals, curvatures, tangents = sector_curvatures(
        surface, crease_angle=crease_angle, smoothing=smoothing
    )
    with np.errstate(divide="ignore"):
        tangential = 1.0 / (per_radian * np.abs(curvatures))
    tangential = np.minimum(tangential, aspect * tangential.min(axis=1)[:, None])
    sizes = np.column_stack([tangential.max(axis=1), tangential])
    directions = np.dstack([normals, tangents])
    metric = Metric.isotropic(np.full(surface.n_points, np.inf), 3)
    order = np.argsort(node, kind="stable")
    rank = np.arange(len(node)) - np.searchsorted(node[order], node[order])
    for number in range(int(rank.max(initial=-1)) + 1):
        some = order[rank == number]
        h, r = np.full((surface.n_points, 3), np.inf), np.array(metric.directions)
        h[node[some]], r[node[some]] = sizes[some], directions[some]
        metric = metric.intersect(Metric.of(h, r))
    return metric


def _of_edges(surface: SimplexMesh, per_radian: float, crease_angle: float) -> Metric:
    """Return the metric of the curvature of feature edges, with a size along the edges only."""
    sizes = np.full((surface.n_points, 3), np.inf)
    along = np.zeros((surface.n_points, 3))
    edges = crease_edges(surface, crease_angle=crease_angle)
    if len(edges):
        line = SimplexMesh(surface.points, edges)
        kappa = curvature(line, crease_angle=crease_angle)
        curved = np.flatnonzero(kappa).astype(np.int32)
        sizes[curved, 0] = 1.0 / (per_radian * kappa[curved])
        along[curved] = _chords(line, curved)
    return Metric.of(sizes, frames(along))


def _chords(line: SimplexMesh, nodes: IntArray) -> FloatArray:
    """Return the vectors between the two neighbours of nodes of two segments each."""
    start, ring = line.rings
    around = line.cells[ring[start[nodes][:, None] + np.arange(2)]]
    before, after = (around.sum(axis=2) - nodes[:, None]).T
    return np.asarray(line.points[after] - line.points[before])
