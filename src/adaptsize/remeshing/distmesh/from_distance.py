"""Mesh generation from a distance function and a size function: ``mesh_from_distance``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_near_points, as_number, as_whole_number, place_text, refuse_where
from adaptsize._defaults import refused_above
from adaptsize._progress import Stage, reporting
from adaptsize._with_info import with_info
from adaptsize.background import SimplexMesh
from adaptsize.background.octree import as_box
from adaptsize.background.simplex import cut_out
from adaptsize.background.topology import places_among
from adaptsize.options import DistanceOptions, checked, with_options
from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.finish import finish
from adaptsize.remeshing.distmesh.implicit_domain import DistanceDomain, Field, grid_of
from adaptsize.remeshing.distmesh.nodes import far_from
from adaptsize.remeshing.distmesh.rejection import sample
from adaptsize.remeshing.distmesh.relaxation import relax
from adaptsize.remeshing.distmesh.report import SmoothingReport, describe, warn_of_faults
from adaptsize.typing import FloatArray, ProgressCallback, Unpack


@with_info
@recorded("mesh_from_distance")
@with_options(DistanceOptions)
def mesh_from_distance(
    distance: Field,
    size: Field | float,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    *,
    fixed_points: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[DistanceOptions],
) -> tuple[SimplexMesh, SmoothingReport]:
    """Return a mesh of the domain in which a distance function is negative.

    Parameters
    ----------
    distance : callable
        Takes float64[n, dim] points and returns n finite values, negative inside.
        Signed distances are best.  Any function works that crosses zero at the boundary with
        a nonzero slope (interpolated, blended, ``min`` and ``max`` of several).
    size : callable or float
        Requested edge length at float64[n, dim] points, finite and positive in the
        domain, for instance a `SizeFunction`.  Limit its gradient first (`limit_gradient`).
    lower, upper : array_like of float, shape (dim,)
        Corners of a box around the domain, dim 2 or 3.
    fixed_points : array_like of float, shape (n, dim), optional
        Fixed nodes inside or on the boundary: corners, and in space
        points along edges.  They are the first nodes of the mesh.
    progress : callable, bool or None
        Called with a text and the fraction completed.  True shows a progress bar.
    **options

    Returns
    -------
    SimplexMesh
        Triangles or tetrahedra, positively oriented; each node is used.
        ``mesh_from_distance.with_info`` returns the pair of the mesh and its `SmoothingReport`.

    Raises
    ------
    ValueError
        If an argument is invalid, ``distance`` does not return n finite numbers, ``size`` does
        not return n numbers that are finite and positive in the domain, the domain is empty or
        extends beyond the box, a fixed point is outside, or no cell fits into the domain.
    TooManyElementsError
        If the sizes require more than ``max_elements`` elements.

    Warns
    -----
    ConvergenceWarning
        If nodes still moved by more than 3 % of their size per step after ``max_iter`` steps.
    ResolutionWarning
        If the mesh misses part of the domain, its measure differs from that of
        the domain by more than 10 %, it has slivers, its boundary nodes are off the boundary of
        the domain by more than 5 % of their size, or a fixed point is in no cell.

    See Also
    --------
    signed_distance : distances from surfaces, images and other functions.
    remesh : new meshes from meshes, by generators that keep regions and tags.

    Notes
    -----
    The algorithm is that of [1]_.  Initial nodes are random points by rejection.  Each step
    moves the nodes by repulsive forces along the edges of their Delaunay triangulation.
    Nodes that leave the domain are projected back along the gradient of the distance, which is
    computed by finite differences.  Nodes are added and removed where edge lengths are far from
    the size [2]_.  In the plane, corners between straight or curved sides are detected and fixed.
    In space, nodes are moved to convex edges.  Finally the worst cells are improved by moving
    single nodes, and by swapping edges and faces of tetrahedra [3]_.

    Guaranteed are positive cells without duplicates, no unused nodes, and the positions of fixed
    points.  The following is not guaranteed but included in the report.  Usually 95 % or more of
    the edges are within sqrt 2 of the size, if the sizes are limited and the domain is not
    narrower than the size.  Angles are usually above 25 degrees in the plane, and dihedral
    angles above 15 degrees in space.  Boundary nodes are usually within 1e-6 sizes of the
    boundary (1e-4 along edges in space).

    Regions narrower than about half of the size are not resolved.  In space, neither are
    concave edges without fixed points along them.

    The cost is about 20 triangulations, and one call of ``distance`` with all nodes in each
    step: about 9 s for 26 000 nodes in the plane, and 18 s for 7 000 in space.

    References
    ----------
    .. [1] P.-O. Persson, G. Strang, "A simple mesh generator in MATLAB", SIAM Review 46
       (2004) 329-345.
    .. [2] F. J. Bossen, P. S. Heckbert, "A pliant method for anisotropic mesh generation", 5th
       International Meshing Roundtable (1996) 63-74.
    .. [3] L. A. Freitag, C. Ollivier-Gooch, "Tetrahedral mesh improvement using swapping and
       smoothing", Int. J. Numer. Methods Eng. 40 (1997) 3979-4002.

    Examples
    --------
    A disc with a hole, finer at the hole:

    >>> def distance(x):
    ...     r = np.linalg.norm(x, axis=1)
    ...     return np.maximum(r - 1.0, 0.25 - r)
    >>> def size(x):
    ...     return 0.08 + 0.2 * (np.linalg.norm(x, axis=1) - 0.25)
    >>> mesh, report = mesh_from_distance.with_info(distance, size, [-1.1, -1.1], [1.1, 1.1])
    >>> bool((mesh.signed_measures > 0.0).all()), report.n_components, report.n_slivers
    (True, 1, 0)
    >>> bool(np.abs(distance(mesh.boundary().mesh.points)).max() < 1e-6)
    True

    The size may be a number.  Too many elements are refused:

    >>> mesh_from_distance(distance, 1e-5, [-1.1, -1.1], [1.1, 1.1])
    Traceback (most recent call last):
    ...
    adaptsize.errors.TooManyElementsError: the sizes require at least ... elements, ...
    """
    if not callable(distance):
        raise ValueError(f"distance must be callable, got {type(distance).__name__}")
    if not callable(size):
        number = as_number("size", size, lower=0.0, strict=True)
    requested = size if callable(size) else lambda points: np.full(len(points), number)
    domain = DistanceDomain(distance, requested, *as_box(lower, upper))
    given = checked(DistanceOptions, options)
    limit, seed = refused_above(given["max_elements"]), given["seed"]
    if not isinstance(seed, np.random.Generator):
        seed = as_whole_number("seed", seed, lower=0, upper=2**53)
    with reporting(progress) as report:
        report(Stage("meshing"), None)
        report("placing nodes", None)
        if not given["clip"]:
            _refuse_cut(domain)
        fixed = _as_fixed(fixed_points, domain)
        mesh, made = mesh_of_domain(
            domain, fixed, seed=seed, max_iter=given["max_iter"], max_elements=limit, report=report
        )
    warn_of_faults(made)
    return SimplexMesh(mesh.points, mesh.cells), made


def mesh_of_domain(
    domain: DistanceDomain,
    fixed: FloatArray,
    *,
    seed: int | np.random.Generator,
    max_iter: int,
    max_elements: float,
    report: ProgressCallback,
) -> tuple[SimplexMesh, SmoothingReport]:
    """Return a mesh of a domain, with the numbers of its regions as cell tags, and the report."""
    sampling = sample(domain, np.random.default_rng(seed), max_elements=max_elements)
    domain = replace(domain, probes=sampling.probes)
    relaxed = relax(
        domain,
        np.concatenate([fixed, far_from(domain, fixed, sampling.points)]),
        n_fixed=len(fixed),
        max_iter=max_iter,
        max_nodes=tuning.NODES_OVER_ALLOWED * max_elements / tuning.ELEMENTS_PER_NODE[domain.dim],
        report=report,
    )
    points, cells, regions = finish(domain, relaxed.points, n_fixed=relaxed.n_fixed, report=report)
    mesh, used = cut_out(points, cells)
    fixed_nodes = places_among(used, len(points))[: len(fixed)]
    made = describe(mesh, domain, sampling, relaxed, fixed_nodes)
    return SimplexMesh(mesh.points, mesh.cells, cell_tags=regions), made


def _refuse_cut(domain: DistanceDomain) -> None:
    """Raise a ValueError if the domain extends beyond the box."""
    extent = domain.upper - domain.lower
    counts = np.maximum(2, np.ceil(tuning.SAMPLES_OF_BOX * extent / extent.max()).astype(int) + 1)
    grid = grid_of(domain.lower, domain.upper, counts).reshape(-1, domain.dim)
    skin = grid[((grid == domain.lower) | (grid == domain.upper)).any(axis=1)]
    depth = domain.depth(domain.given(skin))
    deep = depth > 0.0
    deep[deep] = depth[deep] > tuning.DEPTH_AT_BOX * domain.size(skin[deep])
    if deep.any():
        first = skin[int(np.argmax(np.where(deep, depth, -np.inf)))]
        raise ValueError(
            "distance must not be negative on the faces of the box from lower to upper, got "
            f"{domain.given(first[None])[0]:.4g} at {place_text(first)}; is it negative inside?  "
            "Take a larger box, or clip=True to cut the domain off there"
        )


def _as_fixed(points: npt.ArrayLike | None, domain: DistanceDomain) -> FloatArray:
    if points is None:
        return np.empty((0, domain.dim))
    fixed = as_near_points("fixed_points", points, domain.dim)
    depth = domain.depth(domain.phi(fixed))
    h = domain.size(fixed)
    # On the boundary the size may be unknown.  The size inside is used then.
    outside = (depth < 0.0) & ~(depth >= -tuning.FIXED_OUTSIDE * h)
    refuse_where("fixed_points", outside, depth, "must lie in the domain (depths are given)")
    _, first = np.unique(fixed, axis=0, return_index=True)
    double = np.setdiff1d(np.arange(len(fixed)), first)
    if len(double):
        raise ValueError(f"fixed_points must be distinct, got fixed_points[{double[0]}] twice")
    return fixed
