"""Sizes from the curvature of the boundary."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import describe
from adaptsize._defaults import CREASE_ANGLE, GRADIENT_LIMIT
from adaptsize.background import (
    AnyBackground,
    AnyMesh,
    CartesianGrid,
    Octree,
    PartitionedMesh,
    SimplexMesh,
)
from adaptsize.background.interfaces import interfaces, skin_of
from adaptsize.background.interpolation import places_of
from adaptsize.background.merging import ordered_by_place
from adaptsize.background.migration import whole_boundary
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.creases import crease_edges
from adaptsize.geometry.curvatures import curvature
from adaptsize.options import CurvatureOptions, checked, with_options
from adaptsize.ranks import rows_among
from adaptsize.sizes._from_distance import size_from_distance
from adaptsize.sizes.combine import SMALLEST_SHARE, minimum
from adaptsize.sizes.touched import nodes_beside
from adaptsize.typing import FloatArray, IntArray, Unpack

#: Squared size of a regular triangle over the radius of the sphere through its corners and its
#: distance from that.
CHORDS = 6.0


@recorded("size_from_curvature")
@with_options(CurvatureOptions)
def size_from_curvature(
    background: AnyMesh | CartesianGrid | Octree,
    boundary: SimplexMesh | npt.ArrayLike | None = None,
    **options: Unpack[CurvatureOptions],
) -> FloatArray:
    r"""Return the size that resolves the curvature of the boundary.

    .. math:: h_0 = 1 / (K \kappa)

    at nodes on the boundary [1]_, with K elements per radian, that is :math:`2 \pi K` around
    a circle.  :math:`\kappa` is the principal curvature of larger modulus.  Feature edges and
    corners do not count as curvature, but the curvature of a feature edge along its line does.

    Parameters
    ----------
    background : SimplexMesh, PartitionedMesh, CartesianGrid or Octree
        For tetrahedra, or triangles in the plane, the curvature of their boundary is used.  For
        triangles in space it is that of the surface, its boundary and its feature edges.
        For segments it is that of the line.  Grids and octrees need ``boundary``.
    boundary : SimplexMesh or array_like of float, optional
        Triangles in space, or segments in the plane or in space, whose curvature is used
        instead.  Nodes of ``background`` on it get the value of the closest point.
        Nodes of a grid or octree do not lie on it exactly; see ``tolerance``.  On a grid it may
        also be the signed distance phi at the nodes, negative inside; see the notes.
    **options

    Returns
    -------
    ndarray of float64, of ``background.nodal_shape``
        Sizes; ``inf`` off the boundary and where it is flat, unless ``hmax`` is given.
        At least 1e-6 of the diagonal of the boundary, for any curvature.

    Raises
    ------
    ValueError
        If an option is out of range, the background is 1-D, ``boundary`` is of another
        kind or missing on a grid or octree, or no node of the background lies on ``boundary``.
        Also if the background of distances is not a grid, or they are not signed distances.

    See Also
    --------
    adaptsize.geometry.curvature : the estimate of the curvature, and its accuracy.
    adaptsize.geometry.level_set_curvature : the same from distances.
    limit_gradient : the next step, after which the sizes grow gradually from the boundary.

    Notes
    -----
    Of a mesh in parts, every rank computes the curvature of the whole boundary.  Surfaces, lines
    and meshes with ``boundary`` are collected on rank 0.

    The cost is O(n) without ``boundary``, and O(n log n) with it.  The background must have nodes
    on the boundary that are close enough to resolve changes of its curvature.

    With distances, the nodes on both sides of the boundary get

    .. math:: h_0 = 1 / (K \kappa_b) - s \phi,

    where :math:`\kappa_b = \kappa / (1 - \kappa\phi)` is the curvature at the closest point of the
    boundary.  The size is then :math:`1 / (K \kappa_b)` on the boundary, between the nodes.
    Inside, :math:`s = g` up to the depth ``tolerance``.  Outside, only the corners of the boxes
    that the boundary passes are set, with :math:`s^2 = g^2 - m^2`, where m is the slope of
    :math:`1 / (K \kappa_b)` along the boundary.  With :math:`s = g`, as in [1]_, the slope of
    :math:`h_0` would be larger than g, and limiting would make the sizes too small.

    No size outside is less than half of that on the boundary.  If g is smaller than the limit used
    afterwards, the sizes inside are too small by the difference times ``tolerance``.  If it is
    larger, the sizes on the boundary are too small by the difference times the spacing.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and
       PDE-based gradient limiting", Engineering with Computers 22 (2006) 95-109.

    Examples
    --------
    Eight triangles in a circle of radius 2, and 4 elements per radian:

    >>> import numpy as np
    >>> angle = np.arange(8) * np.pi / 4
    >>> points = np.vstack([[0, 0], 2 * np.column_stack([np.cos(angle), np.sin(angle)])])
    >>> disk = SimplexMesh(points, [[0, i, i % 8 + 1] for i in range(1, 9)])
    >>> size_from_curvature(disk, crease_angle=50.0).round(12)
    array([inf, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])

    A disc of radius 2 on a grid, from its signed distance, at nodes just outside, just inside
    and 0.7 inside:

    >>> grid = CartesianGrid([-3.0, -3.0], 0.3, (21, 21))
    >>> phi = grid.sample(lambda x: np.linalg.norm(x, axis=1) - 2.0)
    >>> h0 = size_from_curvature(grid, phi, g=0.2)
    >>> (phi[10, [3, 4, 6]], h0[10, [3, 4, 6]].round(3))
    (array([ 0.1, -0.2, -0.8]), array([0.483, 0.543,   inf]))
    """
    background = as_mesh("background", background, PartitionedMesh, CartesianGrid, Octree)
    if isinstance(background, PartitionedMesh):
        return _in_parts(background, boundary, options)
    given = checked(CurvatureOptions, options)
    tolerance, g = given["tolerance"], given["g"]
    if boundary is None and tolerance is not None:
        raise ValueError(f"tolerance needs boundary, got {describe(tolerance)} without one")
    if g != GRADIENT_LIMIT and (boundary is None or isinstance(boundary, SimplexMesh)):
        raise ValueError(f"g is for a boundary that is given by distances, got g={g!r} without")
    if boundary is not None and not isinstance(boundary, SimplexMesh):
        if not isinstance(background, CartesianGrid):
            raise ValueError(
                f"boundary must be a SimplexMesh, or distances on a CartesianGrid, "
                f"got {describe(boundary)} on {background!r}"
            )
        h0 = size_from_distance(background, boundary, given)
        h0 = np.maximum(h0, SMALLEST_SHARE * background.diagonal)
        return minimum(h0, hmin=given["hmin"], hmax=given["hmax"])
    kappa = np.zeros(background.n_points)
    nodes: npt.NDArray[np.integer[Any]]
    if boundary is None:
        if not isinstance(background, SimplexMesh):
            raise ValueError(f"boundary must be given, as there is none in {background!r}")
        if background.dim == 1:
            raise ValueError(f"background must lie in 2-D or 3-D, got {background!r}")
        source, nodes = skin_of(background)
        kappa[nodes] = _nodal_curvature(source, given)
    else:
        source = boundary
        _refuse_other_boundary(boundary, background)
        nodes, within = nodes_beside(background, boundary, tolerance)
        if len(nodes) == 0:
            closest = boundary.locator.nearest(background.points)[2].min()
            raise ValueError(
                "boundary must pass through nodes of the background, got none within tolerance "
                f"{np.max(within, initial=0.0):g} (the closest is {closest:g} away)"
            )
        kappa[nodes] = _curvature_at(boundary, places_of(background)(nodes), within, given)
    with np.errstate(divide="ignore"):
        h0 = 1.0 / (given["elements_per_radian"] * kappa)
    h0 = np.maximum(h0, SMALLEST_SHARE * source.diameter)
    return minimum(h0.reshape(background.nodal_shape), hmin=given["hmin"], hmax=given["hmax"])


def _in_parts(
    part: PartitionedMesh, boundary: SimplexMesh | npt.ArrayLike | None, options: CurvatureOptions
) -> FloatArray:
    """Return the sizes on a mesh in parts; collective."""
    given = part.ranks.agree(lambda: checked(CurvatureOptions, options))
    part.ranks.require_equal(boundary=boundary is None, **given)
    if boundary is not None or part.cell_dim < part.dim or part.dim == 1:
        return part.on_whole(lambda whole: size_from_curvature(whole, boundary, **options))
    outer = whole_boundary(part)
    found = part.ranks.agree(lambda: size_from_curvature(outer.mesh, **options))
    row = rows_among(part.global_ids, outer.ids)
    h0 = np.where(row >= 0, found[row], np.inf)
    return minimum(h0, hmin=options.get("hmin"), hmax=options.get("hmax"))


def _nodal_curvature(mesh: SimplexMesh, given: CurvatureOptions) -> FloatArray:
    """Return the curvature at the nodes of a polyline, or of a surface and its feature edges.

    Sums run in the order of places, so that they do not depend on the numbers of nodes.
    """
    ordered, nodes = ordered_by_place(mesh)
    angle = given["crease_angle"]
    found = curvature(ordered, crease_angle=angle, smoothing=given["smoothing"])
    if mesh.cell_dim == 2:
        found = np.maximum(found, curvature(ordered, crease_angle=angle, of="creases"))
    kappa = np.empty(mesh.n_points)
    kappa[nodes] = found
    return kappa


def _refuse_other_boundary(boundary: SimplexMesh, background: AnyBackground) -> None:
    dim = background.dim
    cell_dim = background.cell_dim if isinstance(background, SimplexMesh) else dim
    if boundary.dim != dim or dim == 1 or boundary.cell_dim > min(dim - 1, cell_dim):
        kind = "segments" if min(dim - 1, cell_dim) == 1 else "segments or triangles"
        raise ValueError(f"boundary must consist of {kind} in {dim}-D, got {boundary!r}")


def _curvature_at(
    boundary: SimplexMesh,
    points: FloatArray,
    tolerance: float | FloatArray,
    given: CurvatureOptions,
) -> FloatArray:
    """Return the curvature of the boundary at the point closest to each of ``points``."""
    crease_angle, smoothing = given["crease_angle"], given["smoothing"]
    cells, weights, _ = boundary.locator.nearest(points)
    if boundary.cell_dim == 1:
        nodal = curvature(boundary, crease_angle=crease_angle, smoothing=smoothing)
        return np.asarray((weights * nodal[boundary.cells[cells]]).sum(axis=1))
    # By corner: the rim of a flat cap must not affect the middle of the cap.
    corners = curvature(boundary, crease_angle=crease_angle, smoothing=smoothing, of="corners")
    kappa = (weights * corners[cells]).sum(axis=1)
    edges = crease_edges(boundary, crease_angle=crease_angle)
    if len(edges) > 0:
        # On a feature edge the closest triangle may be on either side.  Use the larger value.
        nodal = curvature(boundary, crease_angle=crease_angle, of="creases")
        np.maximum.at(nodal, boundary.cells, corners)
        lines = SimplexMesh(boundary.points, edges)
        at_crease, distances = lines.locator.interpolate(nodal, points)
        near = distances <= tolerance
        kappa[near] = np.maximum(kappa[near], at_crease[near])
    return np.asarray(kappa)


def radius_at_curves(
    mesh: AnyMesh,
    crease_angle: float = CREASE_ANGLE,
    *,
    original: SimplexMesh | None = None,
    within: float = 0.0,
) -> FloatArray:
    """Return the radius 1 / kappa of the boundary of a mesh, and of interfaces inside.

    Mesh generators keep both within their tolerance.  Collective.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Or a surface, which is a boundary itself.  Interfaces inside a mesh in parts do not count.
    crease_angle
        As in `size_from_curvature`.
    original : SimplexMesh, optional
        A mesh of the same domain with these boundary and interfaces, or the boundary alone for a
        mesh in parts: the radii are then those at the closest points of its own.  The facets of a
        mesh that was made from them are finer than they are, and show their edges as curves of
        small radius.
    within : float
        How far the nodes may be from the original ones, a length.

    Returns
    -------
    float64[n_points]
        inf off the curves, and on lines in 1-D.
    """
    if mesh.dim == 1:
        return np.full(mesh.n_points, np.inf)
    given = checked(CurvatureOptions, {"crease_angle": crease_angle})
    radius = np.full(mesh.n_points, np.inf)
    if isinstance(mesh, PartitionedMesh):
        if original is None:
            return size_from_curvature(mesh, elements_per_radian=1.0, crease_angle=crease_angle)
        at = np.flatnonzero(rows_among(mesh.global_ids, whole_boundary(mesh).ids) >= 0)
        if len(at):
            radius[at] = _radius_at(original, mesh.points[at], within, given)
        return radius
    pairs = zip(curves_of(mesh), curves_of(mesh if original is None else original), strict=True)
    for own, first in pairs:
        if own is None or first is None:
            continue
        facets, nodes = own
        if original is None:
            with np.errstate(divide="ignore"):
                found = 1.0 / _nodal_curvature(facets, given)
            found = np.maximum(found, SMALLEST_SHARE * facets.diameter)
        else:
            found = _radius_at(first[0], facets.points, within, given)
        radius[nodes] = np.minimum(radius[nodes], found)
    return radius


def _radius_at(
    surface: SimplexMesh, points: FloatArray, within: float, given: CurvatureOptions
) -> FloatArray:
    """Return the radii at the points of a surface that are closest to given ones."""
    with np.errstate(divide="ignore"):
        radius = 1.0 / _curvature_at(surface, points, within, given)
    return np.maximum(radius, SMALLEST_SHARE * surface.diameter)


def curves_of(mesh: SimplexMesh) -> list[tuple[SimplexMesh, IntArray] | None]:
    """Return the boundary and the interfaces of a mesh, each with its nodes, or None."""
    if mesh.cell_dim < mesh.dim:
        return [skin_of(mesh), None]
    return [None if mesh.is_closed else skin_of(mesh), interfaces(mesh)]


def size_of_chords(radius: FloatArray, tolerance: float, chords: float = CHORDS) -> FloatArray:
    """Return the sizes that leave a mesh within a distance of curves of given radii.

    A regular triangle with sides of length l and its corners on a sphere of radius r leaves the
    distance l^2 / (6 r), so the size is at most sqrt(6 tolerance r).  Edges on a cylinder leave
    less, l^2 / (8 r), and generators divide edges that leave more than the tolerance: ``chords``
    may be up to that 8.

    No size is less than sqrt(6) times the tolerance, since a curve of a radius below the tolerance
    lies within it as a whole.
    """
    return np.asarray(np.sqrt(chords * tolerance * np.maximum(radius, tolerance)))
