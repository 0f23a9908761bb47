"""Arguments on which ranks have to agree, and solutions of problems in parts on the whole."""

from dataclasses import replace
from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt

from adaptsize.background import PartitionedMesh
from adaptsize.limiting.exact import ExactSolution
from adaptsize.limiting.gradient_limit import Slope, in_space
from adaptsize.limiting.problem import PointBounds, Problem, Scheme, Solution
from adaptsize.typing import FloatArray, GradientOfSize

# Sizes at which the functions g(h) of the ranks are compared.
_PROBES = 9


def require_equal_arguments(
    part: PartitionedMesh,
    h0: FloatArray,
    g: tuple[npt.ArrayLike, GradientOfSize | None],
    point_sources: PointBounds | None,
    **others: Any,
) -> None:
    """Raise a ValueError on all ranks if the arguments of ranks do not fit together; collective.

    ``g`` holds the factors that depend on the place and on the size; arrays may differ.
    """
    of_place, of_size = g
    of_place = np.asarray(of_place)
    if of_place.ndim == 0:
        of_place = of_place.item()
    named = None
    if point_sources is not None:
        data = b"".join(array.tobytes() for array in point_sources)
        named = f"{len(point_sources.sizes)} points with the checksum {crc32(data)}"
    kinds = {"g": of_place if of_size is None else of_size, "g[0]": of_place}
    part.ranks.require_equal(**kinds, point_sources=named, **others)
    part.require_equal_values("h0", h0)


def slope_of_parts(part: PartitionedMesh, g: npt.ArrayLike, slope: Slope) -> Slope:
    """Return the gradient limit in space, of which each rank has its own; collective.

    An array is one of the nodes if it has their number on all ranks, as on a whole mesh.  Only
    then is it one of the cells, which may be as many as the nodes on some ranks.
    """
    shape = np.shape(g)
    if shape == ():
        return slope
    fits = np.array([shape == (part.n_points,), shape == (part.n_cells,)])
    at_nodes, in_cells = part.ranks.allreduce(fits, "min")
    if at_nodes:
        part.require_equal_values("g", np.asarray(g, np.float64))
    elif in_cells:
        slope = in_space(part, g, in_cells=True)
    else:
        raise ValueError("g must be an array per node on all ranks, or per cell on all ranks")
    return replace(slope, varies_elsewhere=True)


def require_equal_functions(
    part: PartitionedMesh, of_size: GradientOfSize, least: float, largest: float
) -> None:
    """Raise a ValueError on all ranks if the functions g(h) differ between two sizes."""
    sizes = np.geomspace(least, largest, _PROBES)
    found = part.ranks.agree(lambda: np.broadcast_to(np.asarray(of_size(sizes)), sizes.shape))
    part.ranks.require_equal(**{"g(h)": [f"{value:.12g}" for value in found]})


def solve_on_whole(scheme: Scheme, problem: Problem) -> Solution:
    """Return the part of this rank of the solution that rank 0 finds on the whole mesh; collective.

    Figures that ranks add up are those of the whole on rank 0, and 0 on the others.
    """
    part, slope = problem.part, problem.slope
    ranks = part.ranks
    whole, h0 = part.gather(), part.gather_nodal(problem.h0)
    limits = part.gather_cells(slope.values) if slope.varies else slope.values

    def solve() -> Solution | None:
        if whole is None or h0 is None or limits is None:
            return None
        of_whole = replace(slope, values=limits)
        return scheme.solve(replace(problem, domain=whole, h0=h0, slope=of_whole))

    found = ranks.agree(solve)
    h = part.scatter_nodal(None if found is None else found.h)
    n_hidden = 0
    if found is not None:
        figures: dict[str, Any] = {"h": h[:0], "missed_by": found.residual}
        if isinstance(found, ExactSolution):
            n_hidden = found.h.size - found.n_proved
            figures["parts"] = []
        found = replace(found, **figures)
    first = ranks.bcast(found)
    assert first is not None, "rank 0 has the whole mesh and solves on it"
    own = replace(first, h=h, iterations=first.iterations if ranks.rank == 0 else 0)
    return replace(own, n_proved=len(h) - n_hidden) if isinstance(own, ExactSolution) else own
