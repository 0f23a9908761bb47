"""Meshes from a distance function and a size function, by smoothing: ``mesh_from_distance``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, as_points, refuse_where
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.remeshing._report import SmoothingReport, describe, warn_of_faults
from adaptsize.remeshing.distmesh.density import far_from
from adaptsize.remeshing.distmesh.finish import finish
from adaptsize.remeshing.distmesh.implicit_domain import ImplicitDomain, grid_of
from adaptsize.remeshing.distmesh.rejection import (
    ELEMENTS_PER_NODE,
    Size,
    examine,
    extended,
    sample,
    sized,
)
from adaptsize.remeshing.distmesh.relaxation import relax
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

#: What takes float64[n, dim] points and returns one number for each.
Field: TypeAlias = Callable[[FloatArray], Any]

#: How far a fixed point may lie outside, in sizes.
_FIXED_OUTSIDE = 0.01
#: How much deeper than this the domain may not be at the faces of the box, in sizes.
_CUT = 0.5


@overload
def mesh_from_distance(
    distance: Field,
    size: Field | float,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    *,
    fixed_points: npt.ArrayLike | None = None,
    clip: bool = False,
    seed: int | np.random.Generator = 2004,
    max_iter: int = 150,
    max_elements: float = 5_000_000,
    full_output: Literal[False] = False,
    progress: ProgressCallback | bool | None = None,
) -> SimplexMesh: ...


@overload
def mesh_from_distance(
    distance: Field,
    size: Field | float,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    *,
    fixed_points: npt.ArrayLike | None = None,
    clip: bool = False,
    seed: int | np.random.Generator = 2004,
    max_iter: int = 150,
    max_elements: float = 5_000_000,
    full_output: Literal[True],
    progress: ProgressCallback | bool | None = None,
) -> tuple[SimplexMesh, SmoothingReport]: ...


def mesh_from_distance(
    distance: Field,
    size: Field | float,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    *,
    fixed_points: npt.ArrayLike | None = None,
    clip: bool = False,
    seed: int | np.random.Generator = 2004,
    max_iter: int = 150,
    max_elements: float = 5_000_000,
    full_output: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> SimplexMesh | tuple[SimplexMesh, SmoothingReport]:
    """Return a mesh of the domain where a distance function is negative.

    Parameters
    ----------
    distance : callable
        Takes float64[n, dim] points and returns n values, negative inside, finite.
        Signed distances are best; any function will do that crosses zero at the boundary with
        a slope (interpolated, blended, ``min`` and ``max`` of several).
    size : callable or float
        Wanted edge length at float64[n, dim] points, finite and positive in the
        domain; a `SizeFunction` is one.  Limit its gradient first (`limit_gradient`).
    lower, upper : array_like of float, shape (dim,)
        Corners of a box around the domain, dim 2 or 3.
    fixed_points : array_like of float, shape (n, dim), optional
        Nodes that stay where they are, inside or on the boundary: corners, and in space
        points along edges.  They are the first nodes of the mesh.
    clip : bool
        Whether the domain may go on beyond the box, and is then cut off there.
    seed : int or numpy.random.Generator
        Of the random start.  The same seed gives the same mesh on the same machine.
    max_iter : int
        Most steps of the nodes, 1 or more.
    max_elements : float
        If the sizes ask for more elements than this, no mesh is made.
    full_output : bool
        Whether to return a report too.
    progress : callable, bool or None
        Called with a text and the share done; True shows a bar.

    Returns
    -------
    mesh : SimplexMesh
        Triangles or tetrahedra, positively oriented; each node is used.
    report : SmoothingReport
        Only with ``full_output``.

    Raises
    ------
    ValueError
        If an argument is wrong, distance or size return something else than n finite numbers
        (n finite positive ones in the domain), the domain is empty or reaches beyond
        the box, a fixed point is outside, or the sizes are too large for a single cell.
    TooManyElementsError
        If the sizes ask for more than ``max_elements``.

    Warns
    -----
    ConvergenceWarning
        If nodes still moved by more than 3 % of their size per step after ``max_iter`` steps.
    ResolutionWarning
        If the mesh misses a part of the domain, its measure differs from that of
        the domain by more than 10 %, it has slivers, nodes of its boundary are off that of
        the domain by more than 5 % of their size, or a fixed point is in no cell.

    See Also
    --------
    signed_distance : distances from surfaces, images and other functions.
    remesh : new meshes from meshes, by generators that keep regions and tags.

    Notes
    -----
    The loop of [1]_: random nodes by rejection, Delaunay triangulation, repulsive forces along
    the edges, nodes that leave the domain put back along the gradient of the distance, by
    difference quotients.  Nodes are added and removed where edges are far from their size [2]_.
    In the plane, corners between straight or curved sides are found and fixed; in space,
    nodes are brought to convex edges.  At the end the worst cells are improved: single nodes are
    moved, edges and faces of tetrahedra swapped [3]_.

    Guaranteed: positive cells, each once; nodes all used; fixed points where they are.
    Not guaranteed, but told in the report: that edges have their sizes (95 % and more within
    sqrt 2 as a rule, if the sizes are limited and the domain is not narrower than they are),
    angles (as a rule above 25 degrees in the plane, dihedral ones above 15 in space), boundary
    nodes within 1e-6 sizes of the boundary (1e-4 along edges in space).
    Parts narrower than about half of the size, and inner edges in space without fixed points
    along them, are not met.

    Time is that of some 20 triangulations and a call of ``distance`` with all nodes in each
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
    >>> mesh, report = mesh_from_distance(
    ...     distance, size, [-1.1, -1.1], [1.1, 1.1], full_output=True
    ... )
    >>> bool((mesh.signed_measures > 0.0).all()), report.n_components, report.n_slivers
    (True, 1, 0)
    >>> bool(np.abs(distance(mesh.boundary().mesh.points)).max() < 1e-6)
    True

    The size may be a number, and too many elements are refused:

    >>> mesh_from_distance(distance, 1e-5, [-1.1, -1.1], [1.1, 1.1])
    Traceback (most recent call last):
    ...
    adaptsize.errors.TooManyElementsError: the sizes ask for ... elements or more, ...
    """
    domain = _as_domain(distance, lower, upper)
    wanted = sized(_as_function(size), domain)
    max_iter = int(as_number("max_iter", max_iter, lower=1.0))
    limit = as_number("max_elements", max_elements, lower=1.0, allow_inf=True)
    rng = np.random.default_rng(seed)
    with reporting(progress) as report:
        report("placing nodes", None)
        if not clip:
            _refuse_cut(domain, wanted)
        fixed = _as_fixed(fixed_points, domain, wanted)
        sampling = sample(domain, wanted, rng, max_elements=limit)
        wanted = extended(wanted, sampling.probes)
        relaxed = relax(
            domain,
            wanted,
            np.concatenate([fixed, far_from(fixed, sampling.points, wanted)]),
            sampling.probes,
            n_fixed=len(fixed),
            max_iter=max_iter,
            max_nodes=1.5 * limit / ELEMENTS_PER_NODE[domain.dim],
            report=report,
        )
        points, cells = finish(
            domain, wanted, relaxed.points, n_fixed=relaxed.n_fixed, report=report
        )
        mesh, node_map = _without_unused(points, cells)
        made = describe(mesh, domain, wanted, sampling, relaxed, node_map[: len(fixed)])
    warn_of_faults(made)
    return (mesh, made) if full_output else mesh


def _as_domain(distance: Field, lower: npt.ArrayLike, upper: npt.ArrayLike) -> ImplicitDomain:
    if not callable(distance):
        raise ValueError(f"distance must be callable, got {type(distance).__name__}")
    low, high = as_float_array("lower", lower), as_float_array("upper", upper)
    if low.ndim != 1 or len(low) not in (2, 3):
        raise ValueError(f"lower must have shape (2,) or (3,), got {low.shape}")
    high = as_float_array("upper", upper, low.shape)
    refuse_where("lower", ~np.isfinite(low), low, "must be finite")
    refuse_where("upper", ~(np.isfinite(high) & (high > low)), high, "must be above lower")
    return examine(ImplicitDomain(distance, low, high))


def _as_function(size: Field | float) -> Field:
    if callable(size):
        return size
    number = as_number("size", size, lower=0.0, strict=True)
    return lambda points: np.full(len(points), number)


def _refuse_cut(domain: ImplicitDomain, size: Size) -> None:
    """Raise a ValueError if the domain reaches beyond the box."""
    extent = domain.upper - domain.lower
    counts = np.maximum(2, np.ceil(40 * extent / extent.max()).astype(int) + 1)
    grid = grid_of(domain.lower, domain.upper, counts).reshape(-1, domain.dim)
    skin = grid[((grid == domain.lower) | (grid == domain.upper)).any(axis=1)]
    depth = domain.depth(domain.given(skin))
    deep = depth > 0.0
    deep[deep] = depth[deep] > _CUT * size(skin[deep])
    if deep.any():
        first = skin[int(np.argmax(np.where(deep, depth, -np.inf)))]
        at = ", ".join(f"{float(x):.6g}" for x in first)
        raise ValueError(
            "distance must not be negative on the faces of the box from lower to upper, got "
            f"{domain.given(first[None])[0]:.4g} at ({at}); is it negative inside?  Take a larger "
            "box, or clip=True to cut the domain off there"
        )


def _as_fixed(points: npt.ArrayLike | None, domain: ImplicitDomain, size: Size) -> FloatArray:
    if points is None:
        return np.empty((0, domain.dim))
    fixed = as_points("fixed_points", points, domain.dim)
    if len(fixed) == 0:
        return fixed
    depth = domain.depth(domain.phi(fixed))
    h = size(fixed)
    # On the boundary a size may be unknown; it is then as good as inside.
    outside = (depth < 0.0) & ~(depth >= -_FIXED_OUTSIDE * h)
    refuse_where("fixed_points", outside, depth, "must lie in the domain (depths are told)")
    _, first = np.unique(fixed, axis=0, return_index=True)
    double = np.ones(len(fixed), np.bool_)
    double[first] = False
    if double.any():
        raise ValueError(
            f"fixed_points must be different, got fixed_points[{int(np.argmax(double))}] twice"
        )
    return fixed


def _without_unused(points: FloatArray, cells: IntArray) -> tuple[SimplexMesh, IntArray]:
    """Return the mesh of the nodes that cells have, and the new number of each node, or -1."""
    used, local = np.unique(cells, return_inverse=True)
    node_map = np.full(len(points), -1, np.int32)
    node_map[used] = np.arange(len(used))
    return SimplexMesh(points[used], local.reshape(cells.shape)), node_map
