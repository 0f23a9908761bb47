"""Requests for small elements of which too few were made."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import count_text, place_text
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.quality import tuning
from adaptsize.quality.by_place import BAND, RequestedElements, Served, nodes_near
from adaptsize.typing import Background

#: Share of the elements of a request that must be there.
SHARE_SERVED = 0.8


class Unserved(NamedTuple):
    """A request of which too much is missing."""

    what: str
    """The cause of the sizes."""
    found: Served

    @property
    def missing(self) -> str:
        """What was requested where, and what was made."""
        worst = self.found.worst
        return (
            f"{self.what}: {self.found.too_coarse:.0%} of about "
            f"{count_text(self.found.elements)} requested elements are missing, since the cells "
            f"there are too large; worst at {place_text(worst.point, 4)}: edges of "
            f"{worst.edge:.3g} where the size {worst.size:.3g} is requested"
        )

    def __str__(self) -> str:
        """Return what was requested where, what was made, and what helps."""
        return f"{self.missing}; remesh the new mesh with the same size function"


def unserved(
    elements: RequestedElements, size: object, share: float = SHARE_SERVED
) -> list[Unserved]:
    """Return the requests of which less than a share was served because cells are too large.

    A request is what one connected set of nodes asks for: those from which sizes grow, for the same
    reason.  That is each of the given sources, each curved face, each narrow region.  Sizes
    without a report are one request.

    Parameters
    ----------
    elements : RequestedElements
        Those of ``size`` in a mesh.
    size : as in `size_conformity`
    share : float
        Of the elements of each request.

    Returns
    -------
    list of Unserved
        Those with the largest edges over the sizes first.  Requests for fewer than 30 elements are
        left out.
    """
    if not isinstance(size, SizeFunction) or size.report is None:
        found = elements.served()
        is_missing = found is not None and found.too_coarse > 1.0 - share
        return (
            [Unserved("metric" if elements.is_of_metric else "sizes", found)]
            if found is not None and is_missing
            else []
        )
    too_large = elements.weights[elements.ratios > BAND[1]].sum() * elements.unit
    if too_large < (1.0 - share) * tuning.FEW_REQUESTED:
        return []
    names, request_of_node = _requests(size.background, size.report)
    near = nodes_near(size, elements.points[:: elements.together])
    request = np.repeat(request_of_node[near], elements.together)
    count = len(names)
    known = request >= 0
    weights, number = elements.weights[known], request[known]
    total = np.bincount(number, weights, count) * elements.unit
    missing = np.where(elements.ratios[known] > BAND[1], weights, 0.0)
    above = np.bincount(number, missing, count) * elements.unit
    lost = np.flatnonzero((above > (1.0 - share) * total) & (total >= tuning.FEW_REQUESTED))
    result = []
    for k in lost.tolist():
        served = elements.only(request == k).served()
        if served is not None:
            result.append(Unserved(names[k], served))
    return sorted(result, key=lambda one: -one.found.worst.ratio)


def _requests(
    background: Background, report: SizeReport
) -> tuple[list[str], npt.NDArray[np.int64]]:
    """Return the causes of the requests, and the request that controls each node, or -1."""
    cause = report.cause.ravel().astype(np.int64)
    if report.origin is None or not isinstance(background, SimplexMesh):
        return list(report.causes), cause
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = background.n_points
    is_source = np.zeros(n, np.bool_)
    is_source[report.origin[report.origin >= 0]] = True
    i, j = background.edges.T
    joined = is_source[i] & is_source[j] & (cause[i] == cause[j])
    graph = coo_array((np.ones(joined.sum()), (i[joined], j[joined])), shape=(n, n))
    component = connected_components(graph, directed=False)[1]
    found = np.where(report.origin >= 0, component[report.origin], -1)
    used, number = np.unique(found[found >= 0], return_inverse=True)
    request = np.full(n, -1)
    request[found >= 0] = number
    names = [""] * len(used)
    for node in np.flatnonzero(found >= 0)[np.unique(number, return_index=True)[1]]:
        names[request[node]] = report.causes[cause[node]]
    return names, request
