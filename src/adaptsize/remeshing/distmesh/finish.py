"""From converged nodes to a mesh: projection of boundary nodes, improvement of bad cells."""

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.smoothing import smooth_nodes
from adaptsize._kernels.swapping import MOST_AROUND, Tetrahedra, new_work, swap
from adaptsize.background.topology import marked, rings
from adaptsize.geometry.boundary import facet_normals
from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.implicit_domain import BoundaryFacets, DistanceDomain
from adaptsize.remeshing.distmesh.relaxation import ON_BOUNDARY, triangulate
from adaptsize.remeshing.taken_back import quality_of, take_back, worst_of_nodes
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

#: Tolerance of the projection of boundary nodes, in sizes.
TOLERANCE = 1e-6


def finish(
    domain: DistanceDomain, points: FloatArray, *, n_fixed: int, report: ProgressCallback
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return a mesh of these nodes with its boundary nodes on the boundary of the domain.

    The last array has the number of the region of each cell.

    Parameters
    ----------
    points : float64[n, dim]
        The first ``n_fixed`` stay where they are.
    """
    points = points.copy()
    for k in range(tuning.ROUNDS_OF_FITTING):
        report("fitting the boundary", k / tuning.ROUNDS_OF_FITTING)
        h = domain.size(points)
        cells = triangulate(domain, points, h)
        regions = domain.regions(points, cells)
        skin = domain.skin(points, cells, regions)
        at = np.flatnonzero(skin.nodes)
        at = at[at >= n_fixed]
        done = domain.adjust(points, cells, regions)
        there = domain.project(
            points[at],
            h[at],
            tolerance=TOLERANCE,
            max_steps=tuning.STEPS_OF_PROJECTION,
            walls=skin.walls_of(at),
        )
        near = np.linalg.norm(there - points[at], axis=1) <= ON_BOUNDARY * h[at]
        before = points.copy()
        points[at] = there
        if near.all() and done:
            break
    else:  # only nodes whose cells keep their quality are moved
        take_back(points, cells, before, at, np.full(len(points), 0.5 * tuning.FLAT_CELL))
    if len(cells) == 0:
        raise ValueError(
            "size must be small enough for the domain, got sizes for which no cell fits into it"
        )
    return improved(domain, points, (cells, regions), h, n_fixed=n_fixed, report=report)


def improved(
    domain: DistanceDomain,
    points: FloatArray,
    mesh: tuple[IntArray, IntArray],
    h: FloatArray,
    *,
    n_fixed: int,
    report: ProgressCallback,
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the mesh with its worst cells improved by swaps and moves of single nodes."""
    dim = points.shape[1]
    points, (cells, regions) = points.copy(), mesh
    best, wider = (-1.0, 0), 0
    for k in range(tuning.PASSES_OF_IMPROVEMENT):
        report("improving cells", k / tuning.PASSES_OF_IMPROVEMENT)
        if dim == 3:
            cells, regions = _swapped_in_regions(points, cells, regions)
        quality = quality_of(points, cells)
        bad = quality < tuning.BAD[dim]
        state = (round(float(quality.min()), 2), -int(bad.sum()))
        if state <= best:
            wider += 1
            bad = quality < tuning.FLAT_CELL
        best = max(state, best)
        # Layers of neighbours that are moved too if nothing else helps.
        if not bad.any() or wider > tuning.MOST_LAYERS:
            break
        nodes = np.unique(cells[bad])
        for _ in range(wider):  # the neighbours must move too
            nodes = np.unique(cells[np.isin(cells, nodes).any(axis=1)])
        skin = domain.skin(points, cells, regions)
        steps = (1 + wider) * tuning.FIRST_STEP * h
        _move_nodes(domain, points, cells, skin, h, nodes[nodes >= n_fixed], steps)
    return points, cells, regions


def _swapped_in_regions(
    points: FloatArray, cells: IntArray, regions: IntArray
) -> tuple[IntArray, IntArray]:
    """Return cells with edges and faces swapped inside each region, and their regions."""
    each = np.unique(regions)
    parts = [swapped(points, np.ascontiguousarray(cells[regions == k])) for k in each]
    numbers = np.repeat(each, [len(part) for part in parts]).astype(np.int32)
    return np.concatenate(parts), numbers


def swapped(points: FloatArray, cells: IntArray) -> IntArray:
    """Return tetrahedra with edges and faces swapped until no swap improves the quality."""
    work = new_work()
    for _ in range(tuning.ROUNDS_OF_SWAPPING):
        quality = quality_of(points, cells)
        bad = np.flatnonzero(quality < tuning.BAD[3])
        bad = bad[np.argsort(quality[bad])]
        ring_ptr, ring = rings(cells, len(points))
        removed = np.zeros(len(cells), np.bool_)
        made = np.empty((2 * MOST_AROUND * (len(bad) + 1), 4), np.int32)
        mesh = Tetrahedra(points, cells, ring_ptr, ring, quality, removed)
        n_made = swap(mesh, bad, work, made)
        if n_made == 0:
            break
        cells = np.concatenate([cells[~removed], made[:n_made]])
    return cells


def _move_nodes(
    domain: DistanceDomain,
    points: FloatArray,
    cells: IntArray,
    skin: BoundaryFacets,
    h: FloatArray,
    nodes: npt.NDArray[np.integer],
    steps: FloatArray,
) -> None:
    """Move nodes to better positions, on smooth boundaries along these.  Changes ``points``."""
    normals = np.zeros_like(points)
    at = nodes[skin.nodes[nodes]]
    normals[at] = domain.normals(points[at], h[at], skin.walls_of(at))
    sharp = at[~normals[at].any(axis=1) | _is_crease(points, skin.facets, normals)[at]]
    nodes = np.setdiff1d(nodes, sharp).astype(np.int64)
    before, old = worst_of_nodes(points, cells), points.copy()
    smooth_nodes(points, cells, rings(cells, len(points)), (nodes, normals, steps))
    at = np.setdiff1d(at, sharp)
    at = at[(points[at] != old[at]).any(axis=1)]
    points[at] = domain.project(
        points[at],
        h[at],
        tolerance=TOLERANCE,
        max_steps=tuning.STEPS_OF_PROJECTION,
        walls=skin.walls_of(at),
    )
    take_back(points, cells, old, at, before)


def _is_crease(points: FloatArray, skin: IntArray, normals: FloatArray) -> BoolArray:
    """Return at which nodes a boundary facet deviates from the normal of the domain."""
    across = facet_normals(points[skin])
    across /= np.linalg.norm(across, axis=1)[:, None]
    cosine = np.abs(np.einsum("ij,ikj->ik", across, normals[skin]))
    return marked(skin[cosine < tuning.SMOOTH_COSINE], len(points))
