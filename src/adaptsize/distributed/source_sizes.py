"""Sizes from sources on distributed meshes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from functools import partial
from hashlib import sha256
from typing import Any, Literal

import numpy as np

from adaptsize._checks import as_float_array, as_sizes, as_slope, check_type
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.sizes._touched import SourceMesh
from adaptsize.sizes.sources import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
    SizeOfPoint,
    Source,
    as_sources,
)
from adaptsize.typing import FloatArray, IntArray

_KNOWN = (PointSource, CurveSource, BoundarySource, RegionSource, BoxSource, BallSource)


def size_from_sources(
    part: PartitionedMesh,
    sources: Source | SizeOfPoint | Iterable[Source | SizeOfPoint],
    *,
    g: float = GRADIENT_LIMIT,
) -> FloatArray:
    """Return the smallest of the sizes from several sources at each node; collective.

    The result equals that of `adaptsize.size_from_sources` on the whole mesh, bit by bit.

    Parameters
    ----------
    part : PartitionedMesh
    sources : source, callable, or several of them
        As for `adaptsize.size_from_sources`; the same on all ranks.  Sources of classes of your
        own get the mesh of each rank, and must set the nodes of each cell by this cell alone.
    g : float, default 0.25
        As for `adaptsize.size_from_sources`; the same on all ranks.

    Returns
    -------
    ndarray of float64, shape (n_local,)
        Ranks that share a node get the same size.

    Raises
    ------
    ValueError
        On all ranks, if the input of any rank is bad.  A tag must occur on one of the ranks.

    Notes
    -----
    Each rank searches its own cells for all sources, and sets the nodes of those that it finds.
    What is sent: for each point, and for each sample of a curve or of the edges of a box, its
    distance from the part of each rank, as one number in a reduction; for samples a second one, the
    length of the cells there; at the end the sizes at shared nodes (one exchange).  The number of
    reductions is one for points and balls; for curves it is two, and two more for each halving of
    the longest segment until pieces are shorter than the cells.  `BoundarySource` without tags
    compares the facets between parts (two exchanges).

    Examples
    --------
    >>> from adaptsize import PointSource
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> part = PartitionedMesh.from_serial(square)
    >>> size_from_sources(part, PointSource([0.5, 0.5], 0.1), g=0.2).round(3)
    array([0.241, 0.241, 0.241, 0.241])
    """
    check_type("part", part, PartitionedMesh)
    comm = part.ranks

    several, slope = comm.agree(lambda: (as_sources(sources), as_slope("g", g)))
    digests = [_digest(source) for source in several]
    comm.require_equal(sources=len(several), g=slope)
    comm.require_equal(**{f"sources[{k}]": digest for k, digest in enumerate(digests)})
    mesh = _MeshOfParts(part)
    h0 = np.full(part.n_points, np.inf)
    for number, source in enumerate(several):
        if isinstance(source, _KNOWN):
            source.lower_sizes(mesh, slope, h0)
        else:
            comm.agree(partial(_lower_on, part, number, source, slope, h0))
    return part.minimum(h0)


def _lower_on(part: PartitionedMesh, number: int, source: Any, g: float, h0: FloatArray) -> None:
    """Lower the sizes (In/Out: h0) of a part by a function, or a source of another class."""
    if isinstance(source, Source):
        if part.mesh is not None:
            source.lower_sizes(part.mesh, g, h0)
    else:
        sizes = as_sizes(f"sources[{number}](points)", source(part.points), h0.shape)
        np.minimum(h0, sizes, out=h0)


def _digest(source: Any) -> str:
    """Return the class of a source, with the values of those that are searched by all ranks."""
    name = type(source).__name__
    if not (isinstance(source, _KNOWN) and is_dataclass(source)):
        return name
    found = sha256()
    for field in fields(source):
        value = getattr(source, field.name)
        if isinstance(value, SimplexMesh):
            found.update(value.points.tobytes() + value.cells.tobytes())
            continue
        try:
            found.update(as_float_array(field.name, value).tobytes())
        except ValueError:
            found.update(repr(value).encode())
    return f"{name} {found.hexdigest()[:8]}"


class _MeshOfParts(SourceMesh):
    """A part of a mesh as sources see it."""

    def __init__(self, part: PartitionedMesh) -> None:
        super().__init__(part.mesh, (part.dim, part.cell_dim))
        self._part = part
        self._diagonal = part.diagonal
        self.speaks = part.ranks.rank == 0

    @property
    def diagonal(self) -> float:
        return self._diagonal

    def least(self, values: FloatArray) -> FloatArray:
        found: FloatArray = self._part.ranks.allreduce(values, "min")
        return found

    def boundary_nodes(self) -> IntArray:
        if self.cell_dim == 1:
            raise ValueError("the boundary of segments is not a mesh; cells must have 3 or 4 nodes")
        facets = boundary_facets(self._part)
        if self._part.ranks.allreduce(len(facets), "sum") == 0:
            raise ValueError("the mesh is closed: it has no boundary")
        return np.unique(facets).astype(np.int32)

    def every_tag(self, kind: Literal["cell", "facet"]) -> IntArray | None:
        every = self._part.ranks.allgather(super().every_tag(kind))
        found = [tags for tags in every if tags is not None]
        return np.unique(np.concatenate(found)) if found else None
