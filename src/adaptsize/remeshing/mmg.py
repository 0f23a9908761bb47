"""The programs of Mmg, which mmgpy brings: adapted tetrahedra, triangles in the plane, surfaces.

Observed behaviour that is handled here:

* A metric of zero hangs the second call in a process, so sizes are checked before.
* The geometric tolerance is absolute, and 0.01 by default.
* Boundary faces that are not passed come back with numbers of regions.  Therefore all
  are passed, numbered after the regions.
* Vertices of bent edges get averaged normals, and Mmg rounds the triangles there.  Long triangles
  beside a fillet then bulge by more than the tolerance, unless the edge is passed as a ridge.
* Facets at the interface of a region with the reference 2 are not oriented, since that marks one
  side of a level set.  Their edges then lose their marks, and are swapped or collapsed.
* Facets inside a region are dropped unless open boundaries are preserved, which is an option.  In
  the plane such edges come back twice.
* In the plane, edges of the boundary that meet at less than the ridge angle count as one smooth
  curve.  Nodes where it may bulge too far, and ends of required edges, are passed as corners.
* Tips of cones whose facets differ little from their neighbours are rounded unless they are
  corners.
* Between the sides of plates much thinner than the sizes it may run without end.
* A gradation at least as steep as the sizes leaves them unchanged.  Without gradation,
  Mmg's own small sizes at curved boundaries end in jumps.
* Metrics are passed as rows of the lower triangle: xx, xy, yy or xx, xy, yy, xz, yz, zz.  For
  these, the gradation is off.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._progress import Stage
from adaptsize.errors import BackendError
from adaptsize.remeshing import tuning
from adaptsize.remeshing._medit import read_medit, write_medit
from adaptsize.remeshing.metric_steps import first_mesh, in_steps, is_far
from adaptsize.remeshing.protocol import (
    Arrays,
    Backend,
    Made,
    MeshingProblem,
    Program,
    Task,
    mesh_of,
)
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.metrics import Metric
    from adaptsize.remeshing.isolation import IsolatedRunner
    from adaptsize.remeshing.sizing import MetricAt, Size

_RESULT = "out.meshb"
_ADAPTING = Stage("adapting", "Mmg")
#: Reference number of edges that are passed as ridges.
_RIDGE = 1
#: References of regions start here, followed by those of groups of facets.  Mmg uses 2, 3 and 10
#: for level sets.
_FIRST_REGION = 11
_PROGRAMS = {"tetrahedra": "mmg3d_O3", "plane triangles": "mmg2d_O3", "surface": "mmgs_O3"}
_ENTITIES = {
    "tetrahedra": ("tetrahedra", "triangles"),
    "plane triangles": ("triangles", "edges"),
    "surface": ("triangles", "edges"),
}


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

    def solve(self, problem: MeshingProblem, run: IsolatedRunner) -> Arrays:
        """Return the adapted mesh with its regions and groups of facets."""
        most = tuning.TURNS if problem.metric is None else tuning.TURNS_WITH_METRIC
        hausd = [tuning.HAUSD[problem.task]] * most
        if not problem.is_adapted:
            return adapted(problem, hausd, run)
        # From a first volume with a surface of the requested sizes, edges come out shorter by 1.06.
        return adapted(
            problem, [tuning.HAUSD_OF_ADAPTED] * (most - 1), run, factor=tuning.FACTOR_OF_ADAPTED
        )


def adapted(
    problem: MeshingProblem,
    hausd: Sequence[float],
    run: IsolatedRunner,
    *,
    factor: float = 1.0,
    largest: float | None = None,
    text: Stage = _ADAPTING,
) -> Arrays:
    """Return the best of several runs of Mmg, each on the result of the one before.

    Parameters
    ----------
    problem : MeshingProblem
    hausd : sequence of float
        For each run, Mmg's ``hausd`` over the tolerance.  Later runs are left out once enough edges
        follow the sizes, and enough of the elements that the first mesh requests are there.  If a
        metric is not served in the end, more runs approach it in steps, see `in_steps`.
    run : callable
    factor : float
        Of the sizes in the first run.  In later ones, the median of the edges over the sizes
        corrects it.
    largest : float, optional
        Limit of this factor; by default `tuning.CORRECTION`.
    text : Stage
        For progress reports.

    Raises
    ------
    BackendError
        If the first run fails.
    """
    first, options = job_of(problem)
    tolerances = [times * problem.tolerance for times in hausd]
    mmg = _Mmg(options, run, text)
    best = first
    if not is_far(problem):
        largest = tuning.CORRECTION if largest is None else largest
        best = _best_of_runs(problem, first, tolerances, mmg, factor, largest)
    if problem.metric is None:
        return best

    def once(mesh: Arrays, metric: Metric) -> Arrays:
        return mmg.adapt(mesh, _rows(metric), tolerances[0])

    return in_steps(problem, best, once)


def _best_of_runs(
    problem: MeshingProblem,
    best: Arrays,
    tolerances: Sequence[float],
    mmg: _Mmg,
    factor: float,
    largest: float,
) -> Arrays:
    """Return the result whose edges and elements follow the sizes best.

    Each run begins with the result of the one before, and with sizes corrected by its edges.  An
    error ends the runs, unless the first one fails.
    """
    made, best_share, before, elements = best, -1.0, -1.0, None
    for tolerance in tolerances:
        sizes = _requested(problem, made["points"], factor)
        try:
            made = mmg.adapt(made, sizes, tolerance)
        except BackendError:  # also if the time is over
            if best_share < 0.0:
                raise
            break
        share, median = _band_and_median(problem.sizes, made, problem.metric)
        if elements is None and problem.metric is None:
            elements = _Elements.of(problem.mesh, problem.sizes_at_nodes)
        if elements is not None:
            share = min(share, elements.served(made))
        if share > best_share:
            best, best_share = made, share
        if share >= tuning.GOOD_SHARE:
            break
        if problem.facets.required.any() and share < before + tuning.GAINED_BESIDE_REQUIRED:
            break  # edges beside facets that stay never follow the sizes
        before = share
        if median > 0.0:  # Mmg may return coincident nodes
            factor = float(np.clip(factor / median, 1.0 / largest, largest))
    return best


def job_of(problem: MeshingProblem) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and options of `MMG`, except for the sizes, ``hausd`` and ``hgrad``."""
    task = problem.task
    options = {
        "task": task,
        "ridge_angle": tuning.RIDGE_ANGLE[task],
        "n_regions": int(problem.regions.max()) + 1,
        "n_groups": int(problem.facets.groups.max(initial=-1)) + 1,
        "required_groups": np.unique(problem.facets.groups[problem.facets.required]).tolist(),
        "open_boundaries": problem.facets.has_free,
    }
    return first_mesh(problem), options


class _Mmg(NamedTuple):
    """Mmg with the options of a problem, in child processes."""

    options: Mapping[str, Any]
    run: IsolatedRunner
    text: Stage

    def adapt(self, made: Arrays, sizes: FloatArray, hausd: float) -> Made:
        """Run Mmg, with a gradation that leaves the sizes unchanged.

        Raises
        ------
        BackendError
            If Mmg fails, returns no cells, or cells with nodes out of range, as it may for meshes
            with flaws.
        """
        options = {
            **self.options,
            "hausd": hausd,
            "hgrad": _gradation(made, sizes),
            "megabytes": _memory(made, sizes),
        }
        arrays = {**made, "sizes": sizes, "corners": _corners(made, options)}
        new = Made(self.run(MMG, self.text, arrays, options))
        if len(new["cells"]) == 0:
            raise BackendError("mmg returned an empty mesh")
        # The result is checked as a whole later, but its edges are measured before.
        if not ((new["cells"] >= 0) & (new["cells"] < len(new["points"]))).all():
            raise BackendError("mmg returned cells whose nodes do not exist")
        return new


def _gradation(made: Arrays, sizes: FloatArray) -> float:
    """Return Mmg's ``hgrad``: as steep as the sizes at the nodes are, and off for metrics."""
    from adaptsize.background._mesh_arrays import lengths

    if sizes.ndim > 1:
        return -1.0
    gradient = tuning.LEAST_GRADIENT
    cells = made["cells"]
    for pair in combinations(range(cells.shape[1]), 2):
        ends = cells[:, pair]
        apart = np.maximum(lengths(made["points"], ends), np.finfo(float).tiny)
        rise = np.abs(sizes[ends[:, 0]] - sizes[ends[:, 1]]) / apart
        gradient = max(gradient, float(rise.max()))
    return float(np.exp(min(gradient, tuning.LARGEST_GRADIENT)))


def _memory(made: Arrays, sizes: FloatArray) -> int | None:
    """Return megabytes that are plenty for small meshes of tetrahedra, None for others.

    By default, Mmg sets up arrays for millions of them, whatever the mesh.
    """
    cells, points = made["cells"], made["points"]
    if cells.shape[1] != 4 or sizes.ndim != 1:
        return None
    from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE, mean_density

    corners = points[cells]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    wanted = ELEMENTS_PER_MEASURE[3] * float((volumes * mean_density(sizes[cells])).sum())
    number = len(cells) + wanted
    if number > tuning.CELLS_WITH_LIMITED_MEMORY:
        return None
    return round(tuning.MEGABYTES + tuning.MEGABYTES_PER_CELL * number)


def _requested(problem: MeshingProblem, points: FloatArray, factor: float) -> FloatArray:
    """Return sizes times a factor, float64[n], or rows of the metric, float64[n, 3 or 6]."""
    is_first = points is problem.mesh.points
    if problem.metric is None:
        return factor * (problem.sizes_at_nodes if is_first else problem.sizes(points))
    metric = problem.metric_at_nodes if is_first else problem.metric(points)
    return _rows(metric.scaled(factor))


def _rows(metric: Metric) -> FloatArray:
    """Return the lower triangles of the matrices by rows, float64[n, 3 or 6]."""
    i, j = np.tril_indices(metric.dim)
    return np.ascontiguousarray(metric.matrices[:, j, i])


def _band_and_median(size: Size, made: Arrays, metric: MetricAt | None) -> tuple[float, float]:
    """Return the share of edges within sqrt 2 of the requested length, and the median ratio.

    If there are many edges, an even sample of them is taken.
    """
    from adaptsize.background._mesh_arrays import centroids, lengths
    from adaptsize.quality.by_place import is_in_band

    points, edges = made["points"], mesh_of(made).edges
    if metric is None:
        edges = edges[:: len(edges) // tuning.SAMPLE + 1]
        ratio = lengths(points, edges) / size(centroids(points, edges))
    else:
        ratio = metric(points).edge_lengths(points, edges)
    return float(is_in_band(ratio).mean()), float(np.median(ratio))


class _Elements(NamedTuple):
    """Elements that sizes at the nodes of the first mesh request, a point for each of its cells.

    Edges show only what was made.  The first mesh is resolved to the sizes.
    """

    places: FloatArray
    sizes: FloatArray
    numbers: FloatArray

    @classmethod
    def of(cls, mesh: SimplexMesh, sizes: FloatArray) -> _Elements:
        """Return the elements of each cell: a sample might miss the one that requests most."""
        from adaptsize.background._mesh_arrays import centroids
        from adaptsize.sizes.budget import mean_density

        density = mean_density(sizes[mesh.cells])
        places = centroids(mesh.points, mesh.cells)
        return cls(places, density ** (-1.0 / mesh.cell_dim), mesh.measures * density)

    def served(self, made: Arrays) -> float:
        """Return the share of them at whose place the cells of a mesh have the size."""
        from adaptsize.quality.by_place import is_in_band, of_edges

        mesh = mesh_of(made)
        edges = of_edges(mesh, np.mean)[mesh.locator.nearest(self.places)[0]]
        near = is_in_band(edges / self.sizes)
        return float(self.numbers[near].sum() / self.numbers.sum())


def _write_job(folder: Path, arrays: Arrays, options: Mapping[str, Any]) -> list[str]:
    """Write the input of Mmg, and return the command.

    Parameters
    ----------
    arrays : points, cells, regions, facets, facet_groups, ridges, corners, sizes
        As in ``MeshingProblem``.
    options : task, hausd (absolute), hgrad, megabytes, ridge_angle, n_regions, n_groups,
        required_groups, open_boundaries
    """
    task, points, groups = options["task"], arrays["points"], arrays["facet_groups"]
    cells, facets = _ENTITIES[task]
    # References: regions, then groups of facets.  Facets that Mmg adds get those of regions.
    first_group = _FIRST_REGION + options["n_regions"]
    blocks = {
        "vertices": [points, np.zeros(len(points), np.int32)],
        cells: [_from_one(arrays["cells"]), np.int32(_FIRST_REGION) + arrays["regions"]],
        facets: [_from_one(arrays["facets"]), np.int32(first_group) + groups],
        f"required {facets}": [
            _from_one(np.flatnonzero(np.isin(groups, options["required_groups"])))
        ],
        "corners": [_from_one(arrays["corners"])],
    }
    ridges = _from_one(arrays["ridges"])
    if len(ridges):  # volumes, and surfaces without facets
        blocks["edges"] = [ridges, np.full(len(ridges), _RIDGE, np.int32)]
        blocks["ridges"] = [_from_one(np.arange(len(ridges)))]
    dim, sizes = points.shape[1], np.asarray(arrays["sizes"], np.float64)
    write_medit(
        folder / "in.meshb", dim, {name: rows for name, rows in blocks.items() if len(rows[0])}
    )
    write_medit(folder / "in.solb", dim, {"sizes": [sizes]})
    settings = {
        "-v": 1 if options.get("verbose", False) else -1, "-hausd": options["hausd"],
        "-hgrad": options["hgrad"], "-ar": options["ridge_angle"], "-in": "in.meshb",
        "-sol": "in.solb", "-out": _RESULT,
    }  # fmt: skip
    flags = ["-nosizreq"]
    if options["megabytes"] is not None:
        settings["-m"] = options["megabytes"]
    if options["open_boundaries"]:
        flags.append("-opnbdy")
    return [_executable(task), *flags, *(str(word) for pair in settings.items() for word in pair)]


def _read_job(result: Path, options: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """Return points, cells, regions, facets, facet_groups, and ridges as they are divided now."""
    task = options["task"]
    (points, _), (cells, regions), (facets, groups), (edges, references) = read_medit(
        result, "vertices", *_ENTITIES[task], "edges"
    )
    groups = groups - (_FIRST_REGION + options["n_regions"])
    known = (groups >= 0) & (groups < options["n_groups"])
    facets, groups = facets[known], groups[known]
    if task == "plane triangles":  # edges inside of regions are there once for each side
        keys = np.sort(facets, axis=1).astype(np.int64) @ [len(points), 1]
        first = np.sort(np.unique(keys, return_index=True)[1])
        facets, groups = facets[first], groups[first]
    return {
        "points": points,
        "cells": cells,
        "regions": regions - _FIRST_REGION,
        "facets": facets,
        "facet_groups": groups,
        "ridges": edges[(references == _RIDGE) & (task != "plane triangles")],
    }


#: Mmg as a program of `IsolatedRunner`: it starts in a few milliseconds, since its child imports
#: neither NumPy nor mmgpy.
MMG = Program(_write_job, _RESULT, _read_job)


@cache
def _executable(task: str) -> str:
    """Return the path of the program, in the package or on the search path."""
    name = _PROGRAMS[task]
    spec = find_spec("mmgpy")
    folder = "" if spec is None or spec.origin is None else os.path.dirname(spec.origin)
    found = shutil.which(name, path=os.path.join(folder, "bin")) or shutil.which(name)
    if found is None:
        raise BackendError(f"mmg failed: mmgpy has no program {name}")
    return found


def _corners(made: Arrays, options: Mapping[str, Any]) -> npt.NDArray[np.int32]:
    """Return the nodes at which curves must not be rounded.

    These are the ends of required edges in the plane, tips of cones in space, and nodes of the
    boundary, of feature edges and of edges between groups where a smooth curve would bulge too far.
    """
    task, curves = options["task"], made["facets"]
    if task == "plane triangles":
        required = np.isin(made["facet_groups"], options["required_groups"])
        ends = np.intersect1d(curves[required], curves[~required])
    else:
        from adaptsize.geometry.creases import tips_of_cones

        curves = _curves(made, task)
        triangles = made["cells" if task == "surface" else "facets"]
        tips = tips_of_cones(made["points"], triangles, np.radians(tuning.RIDGE_ANGLE[task]))
        ends = np.setdiff1d(tips, curves)
    tolerance = options["hausd"] / tuning.HAUSD[task]
    kept = _nodes_to_keep(made["points"], curves, tolerance)
    return np.union1d(ends, kept).astype(np.int32)


def _curves(made: Arrays, task: str) -> npt.NDArray[np.int32]:
    """Return the edges in space that Mmg keeps on curves, int32[n, 2]."""
    from adaptsize.background import SimplexMesh
    from adaptsize.background.topology import are_among, regions_beside
    from adaptsize.geometry.creases import normals_of, sharp_facets

    names = ("cells", "regions") if task == "surface" else ("facets", "facet_groups")
    triangles, groups = (made[name] for name in names)
    surface = SimplexMesh(made["points"], triangles)
    lowest, highest = regions_beside(surface.cell_facets, groups, len(surface.facets))
    kept = sharp_facets(surface, normals_of(surface), np.radians(tuning.RIDGE_ANGLE[task]))
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
    return np.union1d(number[count > 2], number[count == 2][bulge > tuning.BULGE * tolerance])


def _from_one(numbers: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    return np.asarray(numbers + 1, np.int32)
