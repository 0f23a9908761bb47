"""Initial points by rejection, with the density that elements of the requested size need.

A tree of boxes is refined to boxes of the requested size, so the cost is proportional to the
number of points kept, for any range of sizes.  A box of edge s (in the plane s by sqrt(3) s)
holds two points.  Together the points form the triangular lattice of spacing s in the plane and
the body-centred cubic lattice in space, whose Delaunay triangulations are the most regular.  A
point is kept with probability (s / h)^dim, as in [1]_.  Where h = s, the lattice is unchanged.

References
----------
.. [1] P.-O. Persson, G. Strang, "A simple mesh generator in MATLAB", SIAM Review 46 (2004)
   329-345.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptsize._checks import count_text
from adaptsize._messages import Message
from adaptsize.errors import TooManyElementsError
from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.implicit_domain import DistanceDomain, grid_of
from adaptsize.typing import BoolArray, FloatArray, LongArray

#: Edges of a box that holds two points of a lattice whose mean edge is 1.  In space the
#: body-centred cubic lattice has 3 edges of length a and 4 of sqrt(3)/2 a per point.
_BOX = {2: np.array([1.0, math.sqrt(3.0)]), 3: np.full(3, 7.0 / (3.0 + 2.0 * math.sqrt(3.0)))}
#: Positions of the two points in their box.
_PLACES = (0.25, 0.75)
_MAX_LEVEL = 40


@dataclass(frozen=True)
class Sampling:
    """Points for the nodes of a mesh of the requested sizes.

    Attributes
    ----------
    points : float64[n, dim]
        Inside the domain.
    probes : float64[m, dim]
        Points inside that the mesh should cover, one in each box.
    measure : float
        Area or volume of the domain, estimated from the boxes to about one per cent.
    """

    points: FloatArray
    probes: FloatArray
    measure: float


class _Boxes(NamedTuple):
    """Some boxes of a level of the lattice."""

    lower: FloatArray
    spacing: float
    cells: LongArray
    """Their numbers along the axes, int64[n, dim]."""

    @property
    def edges(self) -> FloatArray:
        return _BOX[len(self.lower)] * self.spacing

    def at(self, place: float) -> FloatArray:
        return np.asarray(self.lower + (self.cells + place) * self.edges)


def sample(domain: DistanceDomain, rng: np.random.Generator, *, max_elements: float) -> Sampling:
    """Return random points with the density of the requested size.

    Raises
    ------
    ValueError
        If no point inside the domain is found, or a size there is not finite and positive.
    TooManyElementsError
        If the sizes require more elements than ``max_elements``.
    """
    boxes = _root(domain)
    coarsest = boxes.spacing
    limit = max_elements / tuning.ELEMENTS_PER_NODE[domain.dim]
    points, probes = [], []
    measure, expected = 0.0, 0.0
    for level in range(_MAX_LEVEL + 1):
        boxes, is_leaf, to_come = _leaves(domain, boxes, coarsest)
        leaves = boxes._replace(cells=boxes.cells[is_leaf | (level == _MAX_LEVEL)])
        index = boxes.cells[~is_leaf]
        kept, weight = _draw(domain, leaves, rng)
        inside, volume = _probe(domain, leaves, rng)
        points.append(kept)
        probes.append(inside)
        expected += weight
        measure += volume
        if expected + to_come > limit:
            elements = (expected + to_come) / limit * max_elements
            raise TooManyElementsError(
                Message(
                    "the sizes require at least {} elements, more than {max_elements} = {:.0f}"
                    "; increase the sizes or raise {max_elements}",
                    *(count_text(elements), max_elements),
                ),
                elements,
            )
        if len(index) == 0:
            break
        offsets = np.indices((2,) * domain.dim).reshape(domain.dim, -1).T
        index = (2 * index[:, None] + offsets).reshape(-1, domain.dim)
        boxes = boxes._replace(spacing=0.5 * boxes.spacing, cells=index)
    places = np.concatenate(probes)
    if len(places) == 0:
        raise ValueError(
            "distance must be negative in the domain, got nothing negative between "
            f"lower = {domain.lower.tolist()} and upper = {domain.upper.tolist()}; "
            "is it negative inside?"
        )
    return Sampling(np.concatenate(points), places, measure)


def _root(domain: DistanceDomain) -> _Boxes:
    """Return the boxes of level 0, which cover the domain.

    The smallest size found is the spacing of some level, so a constant size gives the lattice.
    """
    extent = domain.upper - domain.lower
    first = float(extent.max()) / tuning.FIRST[domain.dim]
    counts = np.maximum(3, np.ceil(extent / first).astype(int))
    grid = grid_of(domain.lower, domain.upper, counts).reshape(-1, domain.dim)
    h = domain.size(grid[domain.phi(grid) < 0.0])
    least = float(h.min()) if len(h) else first
    spacing = math.ldexp(least, max(0, math.floor(math.log2(first / least))))
    box = _BOX[domain.dim]
    shape = np.ceil(extent / (box * spacing) - 1e-9).astype(np.int64)
    # Centred, so that the lattice does not depend on the position of the box.
    lower = domain.lower - 0.5 * (shape * box * spacing - extent)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    return _Boxes(lower, spacing, index.reshape(-1, domain.dim))


def _leaves(
    domain: DistanceDomain, boxes: _Boxes, coarsest: float
) -> tuple[_Boxes, BoolArray, float]:
    """Return the boxes that may meet the domain, and which of them are small enough.

    The number is a lower bound on the number of points from the other boxes.
    """
    spacing = boxes.spacing
    radius = 0.5 * spacing * float(np.linalg.norm(_BOX[domain.dim]))
    phi = domain.phi(boxes.at(0.5))
    near = phi <= domain.slope * radius
    boxes, phi = boxes._replace(cells=boxes.cells[near]), phi[near]
    sizes = np.stack([domain.size(boxes.at(place)) for place in (0.5, *_PLACES)])
    known = np.where(np.isnan(sizes), np.inf, sizes).min(axis=0)
    # Where the size is unknown, outside the domain: the smallest size on this level.
    known[np.isinf(known)] = known.min(initial=coarsest)
    is_leaf = spacing <= known * (1.0 + 1e-9)
    whole = ~is_leaf & (phi < -domain.slope * radius)
    to_come = 2.0 * float(((spacing / sizes[:, whole].max(axis=0)) ** domain.dim).sum())
    return boxes, is_leaf, to_come


def _draw(
    domain: DistanceDomain, leaves: _Boxes, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """Return the points that are kept, and their expected number."""
    points = np.concatenate([leaves.at(place) for place in _PLACES])
    points = points[domain.phi(points) < 0.0]
    share = np.minimum((leaves.spacing / domain.size(points)) ** domain.dim, 1.0)
    share[share > 1.0 - 1e-6] = 1.0
    return points[rng.random(len(points)) < share], float(share.sum())


def _probe(
    domain: DistanceDomain, leaves: _Boxes, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """Return points inside the domain, and the measure of the domain in these boxes."""
    edges, centres = leaves.edges, leaves.at(0.5)
    phi = domain.phi(centres)
    crossed = np.abs(phi) <= domain.slope * 0.5 * float(np.linalg.norm(edges))
    n = tuning.SUBSAMPLES[domain.dim]
    offsets = grid_of(-0.5 * edges, 0.5 * edges, [n + 1] * domain.dim)
    offsets = offsets[(slice(0, n),) * domain.dim].reshape(-1, domain.dim) + 0.5 * edges / n
    # Jittered: a boundary parallel to the boxes could be off by a whole sub-sample otherwise.
    jitter = rng.uniform(-0.5, 0.5, (int(crossed.sum()), *offsets.shape)) * edges / n
    fine = centres[crossed][:, None] + offsets + jitter
    values = domain.phi(fine.reshape(-1, domain.dim)).reshape(fine.shape[:2])
    deepest = values.argmin(axis=1)
    rows = np.flatnonzero(values.min(axis=1, initial=np.inf) < 0.0)
    whole = centres[~crossed & (phi < 0.0)]
    volume = len(whole) + np.count_nonzero(values < 0.0) / len(offsets)
    return np.concatenate([whole, fine[rows, deepest[rows]]]), float(edges.prod()) * volume
