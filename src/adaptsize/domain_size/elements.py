"""A mesh with a given number of elements or nodes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import warn_caller
from adaptsize._defaults import TOLERANCE
from adaptsize._messages import Message, message_of
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import AnyBackground, SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.background.merging import reordered
from adaptsize.background.simplex import as_mesh
from adaptsize.domain_size import tuning
from adaptsize.domain_size.budget import predicted_number, what_controls
from adaptsize.domain_size.complete_size import size_function
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.request import Goal, Implicit, goal_of
from adaptsize.domain_size.unknowns import unknowns_on
from adaptsize.errors import OptionError, ResolutionWarning, TooManyElementsError
from adaptsize.options import (
    BudgetOptions,
    DetailOptions,
    MeshOptions,
    RemeshToElementsOptions,
    checked,
    checked_before,
    options_of,
    with_options,
)
from adaptsize.remeshing.details import remove_details
from adaptsize.remeshing.driver import check_backend, remesh
from adaptsize.remeshing.tuning import MANY_MORE
from adaptsize.sizes.search import Search
from adaptsize.typing import ProgressCallback, Unpack


class MeshOfElements(NamedTuple):
    """A mesh, and the sizes that it was made for."""

    mesh: SimplexMesh
    size: SizeFunction

    def plot(self, **options: Any) -> Any:
        """Draw the mesh, with the options of `adaptsize.plot.plot_mesh`."""
        return self.mesh.plot(**options)

    @property
    def report(self) -> SizeReport:
        """The report on the sizes."""
        return report_of(self.size)


@with_options(RemeshToElementsOptions)
def remesh_to_elements(
    mesh: SimplexMesh,
    elements: float | None = None,
    *,
    nodes: float | None = None,
    background: AnyBackground | None = None,
    sources: Any = (),
    h0: npt.ArrayLike | Implicit | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[RemeshToElementsOptions],
) -> MeshOfElements:
    """Return a mesh of a domain with a given number of elements or nodes, within 5 %.

    The sizes are those of `size_function` with this predicted number.  If the mesh has another
    number, new sizes are predicted from those made: at most three meshes are made, and the one
    with the nearest number is returned.  A plane mesh is refined before the second one.

    Parameters
    ----------
    mesh : SimplexMesh
        As in `remesh`.
    elements : float, optional
        Requested number of cells of the new mesh, >= 1.
    nodes : float, optional
        Requested number of nodes, >= 1.  Either this or ``elements``.
    background, sources, h0, progress
        As in `size_function`.
    **options
        Those of the sizes are kept if they are given, and relaxed or tightened if not.

    Returns
    -------
    MeshOfElements
        The mesh and its size function, whose ``report`` has the parameters chosen.

    Raises
    ------
    ValueError
        As in `size_function` and `remesh`.
    BackendError
        As in `remesh`.

    Warns
    -----
    ResolutionWarning
        If none of the meshes has a number within 5 %.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> mesh, size = remesh_to_elements(square, 1000)
    >>> 950 <= mesh.n_cells <= 1050
    True
    >>> 950 <= remesh_to_elements(square, nodes=1000).mesh.n_points <= 1050
    True
    """
    mesh = as_mesh("mesh", mesh)
    given = checked(RemeshToElementsOptions, options)
    check_backend(mesh, given["target"], given["backend"])
    if (elements is None) == (nodes is None):
        number = "none" if nodes is None else "both"
        raise OptionError(Message("one of {elements} and {nodes} must be given, got {}", number))
    if given["least_detail"] is not None:
        mesh = remove_details(mesh, given["least_detail"], crease_angle=given["crease_angle"]).mesh
    request = {
        **given,
        **{"elements": elements, "nodes": nodes},
        **{"background": background, "sources": sources, "h0": h0},
    }
    tell = partial(logging.getLogger(__name__).info, "%s")
    with checked_before():
        return mesh_with_sizes(mesh, request, tell=tell, progress=progress)


def mesh_with_sizes(
    mesh: SimplexMesh,
    request: Mapping[str, Any],
    *,
    tell: Callable[[str], object],
    found: Callable[[SizeFunction], object] = report_of,
    progress: ProgressCallback | bool | None,
) -> MeshOfElements:
    """Return a mesh with the sizes of its domain, or the best of several for a requested number.

    Parameters
    ----------
    mesh : SimplexMesh
    request : mapping
        Options of `size_function` and of mesh generators, and further arguments of the former.
        Details are already removed.
    tell : callable
        Takes a text, see `reach_number`.
    found : callable
        Takes each size function before its mesh is made.
    progress : callable, bool or None
    """
    for_mesh = {name: request[name] for name in options_of(MeshOptions) if name in request}
    apart = {*for_mesh, *options_of(DetailOptions)}
    for_sizes = {name: value for name, value in request.items() if name not in apart}
    numbers = {name: request[name] for name in options_of(BudgetOptions) if name in request}
    budget = checked(BudgetOptions, numbers)
    goal = goal_of(budget)

    def sized(**number: float) -> SizeFunction:
        size = size_function(mesh, progress=progress, **for_sizes | number)
        found(size)
        return size

    def meshed(old: SimplexMesh, size: SizeFunction) -> SimplexMesh:
        # A cap is kept unless given parameters forbid it; a requested number is not capped.
        report, most = report_of(size), request.get("max_elements")
        enough = MANY_MORE * report.n_elements
        limit: dict[str, Any] = {}
        if most is not None or goal is not None:
            limit["max_elements"] = max(most or 0.0, enough)
        with checked_before():
            return remesh(
                old, size, progress=progress, g=report.g, hmax=report.hmax,
                tolerance=request.get("tolerance") or TOLERANCE, **for_mesh, **limit,
            )  # fmt: skip

    if goal is None:
        return _within_cap(mesh, budget["max_elements"], sized, meshed, tell)
    system = (budget["degree"], budget["components"])
    return reach_number(mesh, goal, sized, meshed, tell, system)


def _within_cap(
    mesh: SimplexMesh,
    most: float | None,
    sized: Callable[..., SizeFunction],
    meshed: Callable[[SimplexMesh, SizeFunction], SimplexMesh],
    tell: Callable[[str], object],
) -> MeshOfElements:
    """Return a mesh with at most a given number of elements, up to 10 %.

    If there are more, a second mesh is made for fewer.

    Raises
    ------
    TooManyElementsError
        If the second mesh has more elements, too, or fewer are not enough for the boundary.
    """
    size = sized()
    made = MeshOfElements(meshed(mesh, size), size)
    count = made.mesh.n_cells
    if most is None or count <= tuning.OVER_CAP * most:
        return made
    aim = most * report_of(size).n_elements / count
    text = "{} elements, more than {max_elements} = {:.6g}; a mesh is made for {:.0f}"
    tell(Message(text, count, most, aim))
    try:
        size = sized(max_elements=max(aim, 1.0))
    except TooManyElementsError as error:
        text = "the mesh has {} elements, more than {max_elements} = {:.6g}, and for fewer: {}"
        raise TooManyElementsError(Message(text, count, most, message_of(error))) from error
    made = MeshOfElements(meshed(mesh, size), size)
    if made.mesh.n_cells > tuning.OVER_CAP * most:
        raise TooManyElementsError(
            Message(
                "the meshes had {} and {} elements, more than {max_elements} = {:.6g}: {}",
                *(count, made.mesh.n_cells, most, what_controls(report_of(size))),
            )
        )
    return made


def reach_number(
    mesh: SimplexMesh,
    goal: tuple[Goal, float],
    sized: Callable[..., SizeFunction],
    meshed: Callable[[SimplexMesh, SizeFunction], SimplexMesh],
    tell: Callable[[str], object],
    system: tuple[int, int] = (1, 1),
) -> MeshOfElements:
    """Return the best of up to three meshes, by their numbers of elements, nodes or unknowns.

    A mesh of triangles in the plane is refined if the first new mesh misses the number.  Mmg
    leaves edges as they are within sqrt 2 of the size, so from a mesh with edges of a few lengths
    it cannot make any number: of 800 triangles in a regular grid it makes 800 or 417, not 641.
    From short edges it builds all new ones.  It visits them in the order of the file, so that they
    are also numbered at random: from regular grids in order, numbers were off by up to 35 %, and
    by up to 6 % without order.

    Parameters
    ----------
    mesh : SimplexMesh
    goal : tuple of str and float
        What there is a requested number of, and how large it is.
    sized : callable
        Returns the sizes for a predicted number of ``elements``, ``nodes`` or ``dofs``.
    meshed : callable
        Returns the mesh from a given mesh and sizes.
    tell : callable
        Takes a text before the last mesh is made: why the others are not near the number.
    system : tuple of int
        Degree and number of components, for ``dofs``.
    """
    what, requested = goal
    size = sized(**{what: requested})
    new = meshed(mesh, size)
    search: Search[MeshOfElements] = Search.by_meshes(requested, new.cell_dim, tuning.ACCEPTED)

    def add(new: SimplexMesh, size: SizeFunction) -> None:
        predicted = predicted_number(report_of(size), what, system)
        # Sizes larger by a factor s have s^-dim as many elements, and s^-cell_dim cells.
        factor = (predicted / requested) ** (-1.0 / new.dim)
        search.add(predicted, MeshOfElements(new, size), _number_on(new, what, system), factor)

    add(new, size)
    first = search.best
    old = mesh
    if search.factor is not None and mesh.dim == mesh.cell_dim == 2:
        old = without_order(mesh, size)
        # The first mesh says little about one from this.
        search = Search.by_meshes(requested, new.cell_dim, tuning.ACCEPTED, search.most - 1)
        add(meshed(old, size), size)
    while (factor := search.factor) is not None:
        wanted = max(requested * factor**-new.dim, 1.0)
        if len(search.trials) == search.most - 1:
            bound = what_controls(report_of(search.best.result.size))
            tell(
                f"{what} so far: {search.records}; {bound}; the last mesh is made for {wanted:.0f}"
            )
        try:
            size = sized(**{what: wanted})
        except TooManyElementsError:
            break  # fewer are predicted to be too few for the boundary
        add(meshed(old, size), size)
    best = min(first, search.best, key=lambda trial: abs(math.log(trial.number / requested)))
    if not search.is_met(math.log(best.number / requested)):
        warn_caller(
            f"the mesh has {best.number:.0f} {what} instead of {requested:.6g}; the meshes had "
            f"{search.records}; {what_controls(report_of(best.result.size))}",
            ResolutionWarning,
        )
    return best.result


def _number_on(mesh: SimplexMesh, what: Goal, system: tuple[int, int]) -> int:
    if what == "dofs":
        return int(unknowns_on(mesh, *system))
    return mesh.n_cells if what == "elements" else mesh.n_points


def without_order(mesh: SimplexMesh, size: SizeFunction) -> SimplexMesh:
    """Return triangles with edges of at most half the size, in a random order, always the same."""
    mesh = resolved(mesh, size, factor=0.5, accuracy=None, max_points=1e6).mesh
    rng = np.random.default_rng(mesh.n_cells)
    return reordered(mesh, rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells))
