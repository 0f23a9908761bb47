"""Mmg, through mmgpy: adapted tetrahedra, triangles in the plane, surfaces.

Observed behaviour that is handled here:

* A metric of zero hangs the second call in a process, so sizes are checked before.
* The geometric tolerance is absolute, and 0.01 by default.
* Boundary faces that are not passed come back with numbers of regions.  Therefore all
  are passed, numbered after the regions.
* Vertices of bent edges get averaged normals, and Mmg rounds the triangles there.  Long triangles
  beside a fillet then bulge by more than the tolerance, unless the edge is passed as a ridge.
* In the plane, edges of the boundary that meet at less than the ridge angle count as one smooth
  curve.  Nodes where it may bulge too far, and ends of required edges, are passed as corners.
* Between the sides of plates much thinner than the sizes it may run without end.
* A gradation at least as steep as the sizes leaves them unchanged.  Without gradation,
  Mmg's own small sizes at curved boundaries end in jumps.
* Metrics are passed as rows of the upper triangle: xx, xy, yy or xx, xy, xz, yy, yz, zz.  For
  these, the gradation is off.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize.errors import BackendError, BackendTimeoutError, ResolutionWarning
from adaptsize.remeshing._worker import limit_processor_time
from adaptsize.remeshing.protocol import Backend, Problem, RawMesh, Runner, Task
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.remeshing.sizing import MetricAt, Size

#: Reference number of edges that are passed as ridges.
_RIDGE = 1
_CLASSES = {"tetrahedra": "MmgMesh3D", "plane triangles": "MmgMesh2D", "surface": "MmgMeshS"}
_ENTITIES = {
    "MmgMesh3D": ("tetrahedra", "triangles"),
    "MmgMesh2D": ("triangles", "edges"),
    "MmgMeshS": ("triangles", "edges"),
}
#: Ridge angle in degrees.  20 keeps the area of plane domains.  30 detects the shallow feature
#: edges of parts, which Mmg's default of 45 rounds off, and not the facets of coarse surfaces.
RIDGE_ANGLE = {"MmgMesh3D": 30.0, "MmgMesh2D": 20.0, "MmgMeshS": 30.0}

#: Mmg's ``hausd`` over the tolerance.  In space, on closed parts with sizes for the same tolerance,
#: the measured distance was .2 to 1.1 times ``hausd``.  Mmg reduces larger sizes.  In the plane,
#: with sizes too large for the tolerance, it was up to 1.5 times ``hausd`` on circles.  With a
#: factor of 1.6 it was up to 7 times, and with .7 a notch of coarse arcs was rounded farther.
_TOLERANCE_FACTOR = {"MmgMesh3D": 1.0, "MmgMesh2D": 1.3, "MmgMeshS": 1.0}
#: Factor of ``hausd`` for a volume whose surface has the requested sizes already.
_ADAPTED_FACTOR = 1.2
#: Mmg reads sizes at the nodes of its input mesh.  If that is coarse, they are read again on the
#: new mesh.
#: Mmg does not change edges within sqrt 2 of the requested length.  If this shifts the median,
#: the next run requests sizes corrected by the same factor.  A first run on a coarse mesh shifts
#: it more, which says nothing about the next.
_MAX_TURNS = 3
#: With a metric, cells of the input are farther from the requested ones.
_MAX_METRIC_TURNS = 6
GOOD_SHARE = 0.9
_LARGEST_FACTOR = 1.1


class MmgBackend(Backend):
    """Adapter to mmgpy 0.17, which brings Mmg 5.8."""

    name = "mmg"
    package = "mmgpy"
    install = 'pip install "adaptsize[mmg]"'
    tasks: frozenset[Task] = frozenset(
        {"surface to tetrahedra", "tetrahedra", "plane triangles", "surface"}
    )
    needs_volume = True
    keeps_required_facets = True
    follows_metrics = True

    def solve(self, problem: Problem, run: Runner) -> RawMesh:
        """Return the adapted mesh with its regions and groups of facets."""
        assert problem.size is not None
        made, options = job_of(problem)
        if problem.is_adapted:  # as in the runs on the surface, see `first_volume`
            options["hausd"] *= _ADAPTED_FACTOR
        best, best_share = made, -1.0
        # From a first volume with a surface of the requested sizes, edges come out shorter by this
        # factor.
        factor = 1.06 if problem.is_adapted else 1.0
        most = _MAX_TURNS if problem.metric is None else _MAX_METRIC_TURNS
        for _ in range(most - int(problem.is_adapted)):
            try:
                made = run_adapt(made, _requested(problem, made["points"], factor), options, run)
            except BackendTimeoutError:
                raise
            except BackendError as error:
                if not problem.is_adapted:
                    raise
                warnings.warn(
                    "the tetrahedra are those that fill the surface, not adapted to the sizes "
                    f"inside: {error}",
                    ResolutionWarning,
                    stacklevel=5,
                )
                break
            if len(made["cells"]) == 0:
                return _raw(made)
            share, median = band_and_median(problem.size, made, problem.metric)
            if share > best_share:
                best, best_share = made, share
            if share >= GOOD_SHARE:
                break
            if median > 0.0:  # Mmg may return coincident nodes
                factor = float(np.clip(factor / median, 1.0 / _LARGEST_FACTOR, _LARGEST_FACTOR))
        return _raw(best)


def job_of(problem: Problem) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
    """Return the arrays and options of `adapt`, except for the sizes."""
    kind = _CLASSES[problem.task]
    options = {
        "class": kind,
        "hausd": _TOLERANCE_FACTOR[kind] * problem.tolerance,
        "ridge_angle": RIDGE_ANGLE[kind],
        "n_regions": int(problem.regions.max()) + 1,
        "n_groups": int(problem.facets.groups.max(initial=-1)) + 1,
        "required_groups": np.unique(problem.facets.groups[problem.facets.required]).tolist(),
        "open_boundaries": problem.facets.has_free,
        "seconds": problem.seconds,
    }
    arrays: dict[str, npt.NDArray[Any]] = {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
        "regions": problem.regions,
        "facets": problem.facets.nodes,
        "facet_groups": problem.facets.groups,
        "ridges": problem.ridges,
    }
    return arrays, options


def run_adapt(
    made: Mapping[str, npt.NDArray[Any]],
    sizes: FloatArray,
    options: Mapping[str, Any],
    run: Runner,
    text: str = "adapting with Mmg",
) -> dict[str, npt.NDArray[Any]]:
    """Run `adapt` in a child process, with a gradation that leaves the sizes unchanged.

    Raises
    ------
    BackendError
        If Mmg fails, or returns cells with nodes out of range, as it may for meshes with flaws.
    """
    hgrad = -1.0
    if sizes.ndim == 1:
        # Gradation of Mmg's own sizes at curved boundaries, as |grad h|.
        edges, lengths = _edges(made)
        rise = np.abs(sizes[edges[:, 0]] - sizes[edges[:, 1]])
        gradient = max(0.25, float((rise / np.maximum(lengths, np.finfo(float).tiny)).max()))
        # Upper limit of the gradation passed to Mmg.  A larger one has no effect.
        hgrad = float(np.exp(min(gradient, 3.0)))
    new = run(
        "adaptsize.remeshing.mmg:adapt",
        text,
        {**made, "sizes": sizes, "corners": _corners(made, options)},
        {**options, "hgrad": hgrad},
    )
    # The result is checked as a whole later, but its edges are measured before.
    if not ((new["cells"] >= 0) & (new["cells"] < len(new["points"]))).all():
        raise BackendError("mmg returned cells whose nodes do not exist")
    return new


def _requested(problem: Problem, points: FloatArray, factor: float) -> FloatArray:
    """Return sizes times a factor, float64[n], or rows of the metric, float64[n, 3 or 6]."""
    from adaptsize.remeshing.sizing import upper_triangles

    assert problem.size is not None
    if problem.metric is None:
        return factor * problem.size(points)
    return upper_triangles(problem.metric(points).scaled(factor).matrices)


def _raw(made: Mapping[str, npt.NDArray[Any]]) -> RawMesh:
    return RawMesh(
        made["points"], made["cells"], made["regions"], made["facets"], made["facet_groups"]
    )


def _edges(made: Mapping[str, npt.NDArray[Any]]) -> tuple[npt.NDArray[Any], FloatArray]:
    from adaptsize.background.topology import edges_of

    edges = edges_of(made["cells"], len(made["points"]))
    ends = made["points"][edges]
    return edges, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def band_and_median(
    size: Size, made: Mapping[str, npt.NDArray[Any]], metric: MetricAt | None = None
) -> tuple[float, float]:
    """Return the share of edges within sqrt 2 of the requested length, and the median ratio.

    If there are many edges, an even sample of them is taken.
    """
    from adaptsize.quality.conformity import is_in_band

    edges, lengths = _edges(made)
    if metric is None:
        # Sizes are evaluated at so many edges.  The share in the band is then known within .005.
        step = len(edges) // 20_000 + 1
        edges, lengths = edges[::step], lengths[::step]
        ratio = lengths / size(made["points"][edges].mean(axis=1))
    else:
        ratio = metric(made["points"]).edge_lengths(made["points"], edges)
    return float(is_in_band(ratio).mean()), float(np.median(ratio))


def adapt(
    arrays: Mapping[str, npt.NDArray[Any]], options: Mapping[str, Any]
) -> dict[str, npt.NDArray[Any]]:
    """Call Mmg.  Runs in the child process.

    Parameters
    ----------
    arrays : points, cells, regions, facets, facet_groups, sizes as in ``Problem``
    options : class, hausd (absolute), hgrad, ridge_angle, n_regions, n_groups,
        required_groups, open_boundaries, seconds (of processor time, or inf)

    Returns
    -------
    points, cells, regions, facets, facet_groups
    """
    import mmgpy

    if np.isfinite(options["seconds"]):
        limit_processor_time(options["seconds"])
    cell_name, facet_name = _ENTITIES[options["class"]]
    groups = arrays["facet_groups"]
    mesh = getattr(mmgpy, options["class"])()
    counts = {cell_name: len(arrays["cells"]), facet_name: len(groups)}
    required = np.isin(groups, options["required_groups"])
    ridges = arrays["ridges"]
    if len(ridges):
        counts["edges"] = len(ridges)
    mesh.set_mesh_size(vertices=len(arrays["points"]), **counts)
    mesh.set_vertices(np.ascontiguousarray(arrays["points"]))
    # References: regions from 1, then groups of facets.  Entities that Mmg adds get 0.
    first_group = options["n_regions"] + 1
    set_cells = getattr(mesh, f"set_{cell_name}")
    set_cells(np.ascontiguousarray(arrays["cells"]), _references(arrays["regions"], 1))
    if len(groups):
        set_facets = getattr(mesh, f"set_{facet_name}")
        set_facets(np.ascontiguousarray(arrays["facets"]), _references(groups, first_group))
        if required.any():
            set_required = getattr(mesh, f"set_required_{facet_name}")
            set_required(np.flatnonzero(required).astype(np.int32))
    if len(arrays["corners"]):
        mesh.set_corners(arrays["corners"])
    if len(ridges):
        mesh.set_edges(np.ascontiguousarray(ridges), np.full(len(ridges), _RIDGE, np.int32))
        mesh.set_ridge_edges(np.arange(len(ridges), dtype=np.int32))
    sizes = np.ascontiguousarray(arrays["sizes"])
    if sizes.ndim == 1:
        mesh["metric"] = sizes.reshape(-1, 1)
    else:
        mesh["tensor"] = sizes
    settings = {"hausd": options["hausd"], "hgrad": options["hgrad"]}
    settings["verbose"] = 1 if options.get("verbose", False) else -1
    settings |= {"ar": options["ridge_angle"], "nosizreq": 1}
    if options["open_boundaries"] and cell_name == "tetrahedra":
        settings["opnbdy"] = 1
    mesh.remesh(**settings)
    return _result(mesh, cell_name, facet_name, first_group, options["n_groups"])


def _corners(
    made: Mapping[str, npt.NDArray[Any]], options: Mapping[str, Any]
) -> npt.NDArray[np.int32]:
    """Return the nodes at which curves must not be rounded.

    These are the ends of required edges in the plane, and nodes of the boundary, of feature edges
    and of edges between groups where a smooth curve would bulge too far.
    """
    kind, ends = options["class"], np.empty(0, np.int32)
    curves = made["facets"]
    if kind == "MmgMesh2D":
        required = np.isin(made["facet_groups"], options["required_groups"])
        ends = np.intersect1d(curves[required], curves[~required])
    else:
        curves = _curves(made, kind)
    tolerance = options["hausd"] / _TOLERANCE_FACTOR[kind]
    kept = _nodes_to_keep(made["points"], curves, tolerance)
    return np.union1d(ends, kept).astype(np.int32)


def _curves(made: Mapping[str, npt.NDArray[Any]], kind: str) -> npt.NDArray[np.int32]:
    """Return the edges in space that Mmg keeps on curves, int32[n, 2]."""
    from adaptsize.background import SimplexMesh
    from adaptsize.background.topology import are_among, regions_beside
    from adaptsize.geometry.faces import normals_of, sharp_facets

    names = ("cells", "regions") if kind == "MmgMeshS" else ("facets", "facet_groups")
    triangles, groups = (made[name] for name in names)
    surface = SimplexMesh(made["points"], triangles)
    lowest, highest = regions_beside(surface.cell_facets, groups, len(surface.facets))
    kept = sharp_facets(surface, normals_of(surface), np.radians(RIDGE_ANGLE[kind]))
    kept |= (lowest != highest) | are_among(surface.edges, made["ridges"])
    return np.asarray(surface.edges[kept])


def _nodes_to_keep(
    points: FloatArray, curves: npt.NDArray[np.integer], tolerance: float
) -> npt.NDArray[np.intp]:
    """Return the nodes of two edges at which a smooth curve would bulge too far.

    A smooth curve through the ends of an edge of length l bulges by about l a / 8 if its direction
    turns by the angle a on the way to the next edge.  Nodes of other numbers of edges are kept by
    Mmg.
    """
    nodes = curves.ravel()
    order = np.argsort(nodes, kind="stable")
    number, first, count = np.unique(nodes[order], return_index=True, return_counts=True)
    first = first[count == 2]
    (one, at_one), (other, at_other) = (np.divmod(order[first + k], 2) for k in (0, 1))
    middle = points[number[count == 2]]
    arriving = middle - points[curves[one, 1 - at_one]]
    leaving = points[curves[other, 1 - at_other]] - middle
    lengths = np.linalg.norm([arriving, leaving], axis=2)
    cosine = np.einsum("ij,ij->i", arriving, leaving) / np.maximum(
        lengths.prod(axis=0), np.finfo(float).tiny
    )
    bulge = np.arccos(np.clip(cosine, -1.0, 1.0)) * lengths.max(axis=0) / 8.0
    return np.union1d(number[count > 2], number[count == 2][bulge > 0.2 * tolerance])


def _references(numbers: npt.NDArray[Any], first: int) -> npt.NDArray[np.int32]:
    return np.ascontiguousarray(numbers + first, dtype=np.int32)


def _result(
    mesh: Any, cell_name: str, facet_name: str, first_group: int, n_groups: int
) -> dict[str, npt.NDArray[Any]]:
    cells, regions = getattr(mesh, f"get_{cell_name}_with_refs")()
    facets, groups = getattr(mesh, f"get_{facet_name}_with_refs")()
    groups = np.asarray(groups) - first_group
    known = (groups >= 0) & (groups < n_groups)
    return {
        "points": np.asarray(mesh.get_vertices()),
        "cells": np.asarray(cells, np.int32),
        "regions": np.asarray(regions, np.int32) - 1,
        "facets": np.asarray(facets, np.int32)[known],
        "facet_groups": groups[known].astype(np.int32),
        "ridges": _ridges(mesh),
    }


def _ridges(mesh: Any) -> npt.NDArray[np.int32]:
    """Return the edges that were passed as ridges, as they are divided now."""
    if type(mesh).__name__ == "MmgMesh2D":
        return np.empty((0, 2), np.int32)
    edges, references = mesh.get_edges_with_refs()
    kept = np.asarray(references) == _RIDGE
    return np.asarray(np.asarray(edges, np.int32).reshape(-1, 2)[kept])
