"""Which routes to a mesh are tried, in which order, and why.

One function decides that from what is known before a generator has run.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from adaptsize.remeshing import tuning
from adaptsize.remeshing.protocol import Task

#: What fills a surface before another generator adapts the tetrahedra.  The last one takes the
#: facets between regions of given tetrahedra.
FirstVolume: TypeAlias = Literal[
    "netgen on the adapted surface", "netgen", "tetwild", "netgen in each region"
]

#: Faults of a mesh that another route may cure, see `adaptsize.remeshing.acceptance`.
CURABLE = frozenset({"cells", "facets", "overlaps", "boundary", "topology", "angles"})
_UNSOUND = frozenset({"cells", "facets", "overlaps"})
_OTHERWISE = "the mesh so far has faults, or there is none; fTetWild alone keeps the tolerance"


@dataclass(frozen=True)
class Known:
    """What is known about a request before a generator has run.

    Attributes
    ----------
    task : str
    generators : tuple of str
        The generators that may be used, the chosen one first.
    needs_volume : bool
        Whether the chosen one needs a first volume in a surface.
    n_cells : float
        Predicted number of cells.
    n_given : int
        Number of cells of the given mesh.
    tolerance : float
        Over the diagonal.
    can_fill : bool
        Whether Netgen is installed, and the surface is closed and oriented.
    is_closed : bool
        Whether the surface has no holes.
    is_crossed : bool
        Whether facets of the surface cross others, as those of bodies that overlap do.
    is_folded : bool
        Whether given tetrahedra overlap, or some are turned inside out.
    """

    task: Task
    generators: tuple[str, ...]
    needs_volume: bool
    n_cells: float
    n_given: int
    tolerance: float
    can_fill: bool = False
    is_closed: bool = False
    is_crossed: bool = False
    is_folded: bool = False


@dataclass(frozen=True)
class Attempt:
    """One way to a mesh.

    Attributes
    ----------
    backend : str
        The generator that makes the mesh.
    reason : str
        Why it is tried, and at this place.
    seconds : float
        Processor time after which a generator is stopped.  It is several times what is usual.
    first : str or None
        What fills the surface before that.
    factor : float
        The tolerance that is passed to the generator over the allowed one.
    cures : frozenset of str
        Faults of the best mesh so far for which this is tried.  If it is empty, this is tried only
        while there is no mesh, also if the same route has failed with another tolerance.
    is_sized : bool
        Whether the generator gets the sizes.
    is_followed : bool
        Whether another attempt may be made if the boundary of this mesh is off.
    """

    backend: str
    reason: str
    seconds: float
    first: FirstVolume | None = None
    factor: float = 1.0
    cures: frozenset[str] = CURABLE
    is_sized: bool = True
    is_followed: bool = False

    @property
    def route(self) -> str:
        """The generators in words."""
        if not self.is_sized:
            return f"{self.backend} without sizes"
        return self.backend if self.first is None else f"{self.first}, then {self.backend}"

    def __str__(self) -> str:
        """Return the route and the factor of the tolerance."""
        return self.route + ("" if self.factor == 1.0 else f" with {self.factor:g} x tolerance")


def plan(known: Known, *, strict: bool = False) -> list[Attempt]:
    """Return the attempts at a mesh in their order.

    Parameters
    ----------
    known : Known
    strict : bool
        Whether the mesh must meet all requirements: then smaller tolerances follow.

    Examples
    --------
    >>> generators = "mmg", "tetwild"
    >>> known = Known("surface to tetrahedra", generators, True, 4e4, 1000, 1e-3, True, True)
    >>> for attempt in plan(known):
    ...     print(attempt)
    netgen on the adapted surface, then mmg
    netgen, then mmg
    tetwild
    tetwild with 0.25 x tolerance
    tetwild, then mmg
    """
    if known.task == "tetrahedra" and known.generators[0] == "mmg":
        usual = list(_in_tetrahedra(known))
    elif known.task != "surface to tetrahedra":
        usual = list(_alone(known, "there are cells to start from", _UNSOUND))
    elif known.needs_volume:
        usual = list(_in_surface(known))
    else:
        usual = list(_alone(known, "it fills the surface without a first volume", CURABLE))
    attempts = list(_strict(known, usual)) if strict else usual
    return [
        replace(one, is_followed=any("boundary" in other.cures for other in attempts[k:]))
        for k, one in enumerate(attempts, 1)
    ]


def _seconds(rates: tuple[float, float, float], n_cells: float, n_given: float) -> float:
    """Return processor seconds: a start, and a rate for each requested and each given cell."""
    start, per_cell, per_given = rates
    return start + per_cell * n_cells + per_given * n_given


def _alone(known: Known, reason: str, cures: frozenset[str]) -> Iterator[Attempt]:
    """Yield an attempt for each generator."""
    seconds = _seconds(tuning.SECONDS_ALONE, known.n_cells, known.n_given)
    for name in known.generators:
        is_first = name == known.generators[0]
        why = reason if is_first else "another generator, if the others fail"
        if name == "tetwild" and known.task == "surface to tetrahedra":
            yield from _by_tetwild(known, why)
        else:
            yield Attempt(name, why, seconds, cures=cures)


def _in_tetrahedra(known: Known) -> Iterator[Attempt]:
    """Yield the attempts at adapted tetrahedra.

    Mmg fails, or does not end, where cells are turned inside out or overlap.  Their boundary and
    the facets between regions are sound.
    """
    first, *others = _alone(known, "there are cells to start from", _UNSOUND)
    anew = replace(first, first="netgen in each region")
    if known.is_folded:
        why = "cells overlap or are turned inside out, from which Mmg cannot start"
        yield replace(anew, reason=why)
        yield replace(first, reason="the regions cannot be filled anew", cures=frozenset())
    else:
        yield first
        yield replace(anew, reason="Mmg has failed on the given cells", cures=frozenset())
    yield from others


def _in_surface(known: Known) -> Iterator[Attempt]:
    """Yield the attempts at tetrahedra in a surface by a generator that adapts a first volume.

    What Netgen cannot fill goes to fTetWild alone.  On three pairs of bodies that cross it kept the
    boundary closer than Mmg on a first volume by fTetWild (.58 to .84 tolerances instead of .87 to
    1.12), with 2 to 14 % fewer cells, as many edges in the band, and in less time.  At the rims of
    open boxes, Mmg made cells that overlap.  Where their union could not be made exactly,
    facets nearly coincide: on the tetrahedra of a public part, Mmg reached its limit of time.
    """
    name, *others = known.generators
    start, each = tuning.SECONDS_IN_SURFACE
    first = Attempt(name, "", start + each * max(known.n_cells, known.n_given))
    can_fill = known.can_fill and not known.is_crossed
    if can_fill:
        why = "the surface is closed and does not cross itself"
        yield replace(first, first="netgen on the adapted surface", reason=why)
        why = "the adapted surface cannot be filled"
        yield replace(first, first="netgen", reason=why, cures=frozenset())
    if not known.is_closed:
        why = "the surface is open: fTetWild decides what it encloses"
    elif known.is_crossed:
        why = "facets of the surface cross others: fTetWild makes the union"
    elif can_fill:
        why = _OTHERWISE
    else:
        why = "Netgen is not installed, or the surface cannot be oriented"
    yield from _by_tetwild(known, why)
    seconds = _seconds(tuning.SECONDS_IN_TETWILD, known.n_cells, known.n_given)
    if known.is_crossed:
        why = "fTetWild is quicker without sizes where facets nearly coincide"
        none: frozenset[str] = frozenset()
        yield Attempt("tetwild", why, seconds, cures=none, is_sized=False)
    else:
        why = "fTetWild alone has failed, or cells overlap or are flat"
        cures = CURABLE - {"boundary"}
        yield replace(first, first="tetwild", seconds=seconds, reason=why, cures=cures)
    rest = replace(known, generators=tuple(other for other in others if other != "tetwild"))
    yield from _alone(rest, "another generator, if the others fail", frozenset())


def _by_tetwild(known: Known, reason: str) -> Iterator[Attempt]:
    seconds = _seconds(tuning.SECONDS_OF_TETWILD, known.n_cells, known.n_given)
    alone = Attempt("tetwild", reason, seconds)
    yield alone
    if known.tolerance <= tuning.ABSURD_TOLERANCE:
        why = "fTetWild may crash at one tolerance and not at another"
        yield replace(alone, reason=why, factor=tuning.TOLERANCE_AFTER_FAILURE, cures=frozenset())


def _strict(known: Known, usual: list[Attempt]) -> Iterator[Attempt]:
    """Yield the usual attempts, and those with smaller tolerances."""
    why = "a smaller tolerance keeps the boundary closer"
    done: set[str] = set()
    for attempt, following in zip(usual, [*usual[1:], None], strict=True):
        yield attempt
        name = attempt.backend
        if name in done or (following is not None and following.backend == name):
            continue
        done.add(name)
        first = next(one for one in usual if one.backend == name)
        yield replace(first, factor=tuning.SMALLER_TOLERANCE, reason=why, cures=CURABLE)
    yield replace(
        usual[0], factor=tuning.SMALLEST_TOLERANCE, reason=f"{why}, and takes long", cures=CURABLE
    )
