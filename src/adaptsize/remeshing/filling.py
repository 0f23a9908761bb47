"""The routes to tetrahedra in a surface: what fills it first, and what adapts that."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from adaptsize._checks import count_text
from adaptsize._messages import Message
from adaptsize._progress import Stage
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import renumbered_edges
from adaptsize.errors import BackendError, BackendTimeoutError, TooManyElementsError
from adaptsize.quality.boundary import overlapping_cells
from adaptsize.remeshing import netgen, tuning
from adaptsize.remeshing.attempts import Candidate
from adaptsize.remeshing.crossing_repair import repair_crossings
from adaptsize.remeshing.crossings import crossing_facets, smaller_at
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.mmg import adapted
from adaptsize.remeshing.planning import Attempt
from adaptsize.remeshing.preparation import as_problem, number_regions, restore
from adaptsize.remeshing.protocol import Arrays, Backend, Facets, MeshingProblem
from adaptsize.remeshing.registry import available_backends
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.surface import refine_surface, remove_slivers, sliver_height
from adaptsize.sizes import predict
from adaptsize.sizes.prediction import Prediction
from adaptsize.typing import FloatArray, IntArray

_STAGE = Stage("adapting the surface", "Mmg")
FILLS_MORE = (
    "the mesh fills more than the surface encloses; close the surface or increase the sizes"
)
NOT_ADAPTED = "the tetrahedra are those that fill the surface, not adapted to the sizes inside"


class Filling:
    """The routes from a surface to tetrahedra that a generator adapts.

    Parameters
    ----------
    problem : MeshingProblem
        Of the task "surface to tetrahedra".
    surface : SimplexMesh
        The boundary of the solid, in the coordinates of the problem.
    predicted : Prediction
    max_elements : float
    most : float
        Number of cells beyond which a mesh is not improved at first, as another one may follow.
    left : float
        The tolerance of the problem over that of a mesh.
    """

    def __init__(
        self,
        problem: MeshingProblem,
        surface: SimplexMesh,
        predicted: Prediction,
        max_elements: float,
        most: float = math.inf,
        left: float = 1.0,
    ) -> None:
        self._problem, self.surface, self._left = problem, surface, left
        self._predicted, self._max_elements, self._most = predicted, max_elements, most
        self._keeps_edges: BackendError | None = None
        self._refined: dict[tuple[float, float], tuple[SimplexMesh, IntArray]] = {}

    def candidates(
        self, attempt: Attempt, backend: Backend, run: IsolatedRunner
    ) -> Iterator[Candidate]:
        """Yield the tetrahedra that fill the surface, if they follow the sizes, and the adapted.

        Raises
        ------
        BackendError
            If a generator fails.
        TooManyElementsError
            If the sizes require more than the allowed number of elements in the first volume, which
            may be larger than what an open surface encloses.
        """
        problem = replace(self._problem, tolerance=attempt.factor * self._problem.tolerance)
        note = ""
        if self._keeps_edges is not None and attempt.first != "tetwild":
            raise self._keeps_edges
        if attempt.first == "tetwild":
            generator = available_backends()["tetwild"]
            raw = generator.solve(replace(problem, size=None), replace(run, backend="tetwild"))
            inner = _inside(problem, raw, "tetwild")
            if not self.surface.is_closed:  # otherwise the predicted number is that of the inside
                note = number_note(inner, self._predicted.cells, self._max_elements)
        elif attempt.first == "netgen":
            inner = self._in_given_surface(problem, run)
        else:
            inner = self._in_adapted_surface(problem, run)
        if problem.in_volume is not None:
            inner = problem.in_volume(inner)
        if inner.is_adapted:
            yield self._improved(lambda: inner.mesh, inner, attempt, NOT_ADAPTED)
        raw = backend.solve(inner, run)
        yield self._improved(lambda: restore(raw, inner, backend.name), inner, attempt, note)

    def _improved(
        self, made: Callable[[], SimplexMesh], inner: MeshingProblem, attempt: Attempt, note: str
    ) -> Candidate:
        """Return a mesh to be improved, early given up if another attempt may follow.

        A mesh of too many cells is left as it is.
        """
        undone: list[bool] = []
        better = partial(
            improved_soundly, surface=self.surface, tolerance=inner.tolerance / self._left,
            size=inner.size,
        )  # fmt: skip

        def finish() -> SimplexMesh:
            mesh = made()
            if mesh.n_cells > self._most:
                undone.append(True)
                return mesh
            give_up = partial(undone.append, True) if attempt.is_followed else None
            return better(mesh, give_up=give_up)

        return Candidate(finish, note, lambda: better(made()) if undone else None)

    def _in_adapted_surface(self, problem: MeshingProblem, run: IsolatedRunner) -> MeshingProblem:
        """Return the request to adapt what Netgen makes of a surface of the requested sizes.

        Where facets of that cross each other and cannot be repaired, it is made again with smaller
        sizes around them.
        """
        given, ridges = self._without_crossings(problem)
        for left in range(tuning.MORE_SURFACES, -1, -1):
            surface, kept = adapt_surface(given, ridges, problem.sizes, problem.tolerance, run)
            if left == tuning.MORE_SURFACES:  # later ones have smaller sizes
                self._refuse_many_facets(surface, kept)
            surface, kept, crossings = _without_slivers(surface, kept, problem)
            if left == 0 or not 0 < len(crossings) <= tuning.MOST_CROSSINGS:
                break
            problem = replace(problem, size=smaller_at(problem.sizes, crossings))
        raw = netgen.fill(surface, run)
        return replace(_inside(problem, raw, "netgen"), ridges=kept, is_adapted=True)

    def _refuse_many_facets(self, surface: SimplexMesh, ridges: IntArray) -> None:
        """Raise if sharp edges make many more facets than predicted, in each attempt by Mmg.

        Mmg keeps the sharp edges of a rough surface, although they are closer than the sizes.
        Netgen rarely fills it, and the cells would be many more than requested.
        """
        made, predicted = surface.n_cells, self._predicted.facets
        is_rough = 2 * len(ridges) > tuning.MANY_RIDGES * made
        if is_rough and made > tuning.MANY_MORE_FACETS * predicted:
            self._keeps_edges = BackendError(
                f"mmg made {made} triangles of the surface instead of {count_text(predicted)}, "
                "since it keeps sharp edges that are closer than the sizes"
            )
            raise self._keeps_edges

    def _without_crossings(self, problem: MeshingProblem) -> tuple[SimplexMesh, IntArray]:
        """Return the surface with short edges, without its slivers if no facets cross then."""
        for thinnest in tuning.THINNEST:
            found = self._with_short_edges(problem, thinnest)
            if not len(crossing_facets(found[0]).cells):
                break
        return found

    def _in_given_surface(self, problem: MeshingProblem, run: IsolatedRunner) -> MeshingProblem:
        """Return the request to adapt what Netgen makes of the surface with divided edges.

        If it cannot be filled without its slivers, only the thinner ones are removed.
        """
        for thinnest in tuning.THINNEST:
            surface, ridges = self._with_short_edges(problem, thinnest)
            try:
                raw = netgen.fill(surface, run)
            except BackendTimeoutError:
                raise  # with more slivers it takes longer
            except BackendError:
                if thinnest == tuning.THINNEST[-1]:
                    raise
            else:
                break
        return replace(_inside(problem, raw, "netgen"), ridges=ridges)

    def _with_short_edges(
        self, problem: MeshingProblem, thinnest: float
    ) -> tuple[SimplexMesh, IntArray]:
        key = problem.tolerance, thinnest
        if key not in self._refined:
            self._refined[key] = refine_surface(
                problem.mesh, problem.sizes, problem.tolerance, thinnest
            )
        return self._refined[key]


def improved_soundly(
    mesh: SimplexMesh,
    surface: SimplexMesh,
    tolerance: float,
    size: Size | None,
    *,
    give_up: Callable[[], object] | None = None,
) -> SimplexMesh:
    """Return a mesh that fills a surface with better cells, or as it is if these would overlap.

    Nodes that are put onto a surface with walls much thinner than the tolerance may be put onto the
    wrong side, so that the boundary crosses itself although all cells are positive.
    """
    better = improved(mesh, surface, tolerance, size, give_up=give_up)
    return unless_overlapping(better, mesh)


def unless_overlapping(better: SimplexMesh, mesh: SimplexMesh) -> SimplexMesh:
    """Return a better mesh, or the one before if cells overlap in the better one only."""
    if overlapping_cells(better) is not None and overlapping_cells(mesh) is None:
        return mesh
    return better


def number_note(inner: MeshingProblem, n_cells: float, max_elements: float) -> str:
    """Return a note if the sizes require many more cells in a first volume than predicted.

    Of open surfaces, generators may fill more than what the surface encloses.

    Raises
    ------
    TooManyElementsError
        If these are also more than ``max_elements``.
    """
    found = predict(inner.mesh, inner.sizes, backend="mmg").cells
    if found <= tuning.MANY_MORE * n_cells:
        return ""
    text = (
        f"about {count_text(found)} elements instead of the predicted {count_text(n_cells)}: "
        f"{FILLS_MORE}"
    )
    if found > max_elements:
        advice = "{}, or raise {max_elements} = {:.0f}"
        raise TooManyElementsError(Message(advice, text, max_elements), found)
    return text


def _inside(problem: MeshingProblem, raw: Arrays, generator: str) -> MeshingProblem:
    """Return the request to adapt tetrahedra in the surface of another one."""
    volume = restore(raw, problem, generator)
    plain = as_problem("tetrahedra", volume, problem.tolerance / volume.diagonal)
    return replace(plain, size=problem.size, size_nodes=problem.size_nodes)


def _without_slivers(
    surface: SimplexMesh, ridges: IntArray, problem: MeshingProblem
) -> tuple[SimplexMesh, IntArray, FloatArray]:
    """Return an adapted surface to be filled, its ridges, and where facets cross."""
    given, size, tolerance = problem.mesh, problem.sizes, problem.tolerance
    # Where feature edges meet at small angles, Mmg makes edges much shorter than the size.  Those
    # shorter than this share of the tolerance are removed, unless facets cross only then.
    height = sliver_height(surface, size, 0.5 * tolerance)
    thicker, new_node = remove_slivers(surface, height)
    crossings = np.empty((0, 3))
    for one, edges in ((thicker, renumbered_edges(ridges, new_node)), (surface, ridges)):
        repaired, node = repair_crossings(one, given, tolerance)
        places = crossing_facets(repaired, tuning.SLACK_OF_ADAPTED).places
        if not len(places):
            return repaired, renumbered_edges(edges, node), places
        crossings = np.concatenate([crossings, places])
    return thicker, renumbered_edges(ridges, new_node), crossings


def adapt_surface(
    surface: SimplexMesh, ridges: IntArray, size: Size, tolerance: float, run: IsolatedRunner
) -> tuple[SimplexMesh, IntArray]:
    """Return a surface with the requested edge lengths, and the ridges as they are divided now.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Facets of different cell tags stay separate.
    ridges : int32[n, 2]
        Edges that stay sharp.
    size : callable
    tolerance : float
        Allowed distance, in the unit of the coordinates, of the boundary of a volume that Mmg
        makes afterwards.

    Raises
    ------
    BackendError
        If Mmg fails.
    """
    regions, tags = number_regions(surface)
    problem = MeshingProblem(
        "surface", surface, tolerance, Facets(), regions, tags, size=size, ridges=ridges
    )
    largest = tuning.CORRECTION_ON_SURFACE
    made = adapted(problem, tuning.HAUSD_ON_SURFACE, run, largest=largest, text=_STAGE)
    new_tags = None if surface.cell_tags is None else tags[made["regions"]]
    new = SimplexMesh(
        made["points"], made["cells"], cell_tags=new_tags, tag_names=surface.tag_names
    )
    return new, made["ridges"]
