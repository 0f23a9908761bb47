"""Which cause controls the size where: `SizeReport`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._causes import CAUSES
from adaptsize._checks import count_text
from adaptsize._printed import Printed
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.limiting.info import LimitingInfo
from adaptsize.typing import FloatArray, IntArray

#: The code of each cause in files: those of a file do not depend on the causes that it has.
CODES = {cause.name: cause.code for cause in CAUSES}
#: Cause of nodes outside the domain, and of nodes that no bound reaches.
NONE = -1


@dataclass(frozen=True, eq=False, repr=False)
class SizeReport(Printed):
    """Which cause controls the size where, and how much of the domain.

    A cause controls a node if the size there is its own bound, or if the size has grown, by the
    gradient limit, from a node where it is.
    """

    background: SimplexMesh | CartesianGrid | Octree
    causes: tuple[str, ...]
    """Names, such as ``"curvature"``.  ``"hmin"`` controls where a bound is smaller than that,
    ``"hmax"`` where there is no other bound."""
    cause: npt.NDArray[np.int8]
    """Index into ``causes`` at each node, of the nodal shape; -1 outside the domain."""
    domain_shares: dict[str, float]
    """Share of the length, area or volume of the domain that each cause controls."""
    element_shares: dict[str, float]
    """Estimated share of the elements of a mesh with these sizes."""
    smallest: dict[str, float]
    """Smallest size in the part that each cause controls."""
    largest: float
    """Largest size in the domain."""
    bounds: dict[str, FloatArray]
    """Upper bounds of each cause at the nodes, of the nodal shape; inf where there is none."""
    info: LimitingInfo | None
    """Information on the limiting of all bounds together; None for surfaces in space, from which
    sizes grow through the space around."""
    g: float
    hmin: float
    hmax: float
    n_elements: float
    """Predicted number of elements of a mesh with these sizes."""
    n_nodes: float = np.nan
    """Predicted number of nodes; nan if the domain is not given as a mesh."""
    n_facets: float = np.nan
    """Predicted number of facets of the boundary; nan as for nodes."""
    element_dim: int = 0
    """Dimension of these elements: 3 for the tetrahedra in a surface."""
    origin: IntArray | None = None
    """Node from which the size at each node has grown, or the nearest to that place; -1 outside.
    None on grids and octrees, and where fast marching limits."""
    elements_per_radian: float = 0.0
    """Elements per radian of curved boundaries; 0 if curvature is disabled."""
    elements_across: float = 0.0
    """Elements across narrow regions; 0 if the width is disabled."""
    elements_between: float = 0.0
    """Elements between features that do not meet; 0 if the separation is disabled."""
    is_rough: bool = False
    """Whether the boundary is rough, so that the separation is disabled unless requested."""
    tolerance: float = np.inf
    """Allowed distance of chords from curved boundaries, over the diameter; inf if not limited."""
    relaxation: float = 1.0
    """Factor by which parameters that were not given were relaxed.  Below 1 they were tightened."""

    @property
    def choices(self) -> str:
        """The parameters requested or chosen, and the resulting sizes, in one line."""
        parts = []
        if self.elements_per_radian > 0.0:
            parts.append(f"{self.elements_per_radian:.3g} elements per radian")
        if self.elements_across > 0.0:
            parts.append(f"{self.elements_across:.3g} across")
        if self.elements_between > 0.0:
            parts.append(f"{self.elements_between:.3g} between features")
        elif self.is_rough:
            parts.append("no separation of features (rough surface)")
        if np.isfinite(self.tolerance):
            parts.append(f"tolerance {self.tolerance:.3g}")
        least = min(self.smallest.values())
        limits = f"(hmin = {self.hmin:.3g}, hmax = {self.hmax:.3g})"
        return ", ".join(
            [
                *parts,
                f"g = {self.g:.3g}",
                f"h from {least:.3g} to {self.largest:.3g} {limits}",
                f"about {count_text(self.n_elements)} elements",
            ]
        )

    @property
    def codes(self) -> range:
        """Possible values of `cause` inside the domain."""
        return range(len(self.causes))

    def cause_codes(self) -> IntArray:
        """Return the cause at each node by its code in `CODES`, as in files; -1 outside."""
        codes = np.array([*(CODES[name] for name in self.causes), NONE], np.int32)
        return codes[self.cause]  # the last one where the cause is -1

    def __repr__(self) -> str:
        """Return the causes with their shares."""
        shares = ", ".join(f"{name} {share:.1%}" for name, share in self._by_share())
        return f"SizeReport({shares})"

    def __str__(self) -> str:
        """Return one line per cause, with the share it controls."""
        what = {1: "length", 2: "area", 3: "volume"}[measure_dim(self.background)]
        by_share = self._by_share()
        width = max(len(name) for name, _ in by_share)
        lines = [
            f"{name:{width}}  controls {share:6.1%} of the {what}, "
            f"{self.element_shares[name]:6.1%} of the elements, h from {self.smallest[name]:.4g}"
            for name, share in by_share
        ]
        return "\n".join(lines)

    def _by_share(self) -> list[tuple[str, float]]:
        """Return the causes that control some part, the largest share first."""
        shares = [item for item in self.domain_shares.items() if item[1] > 0.0]
        return sorted(shares, key=lambda item: -item[1])


def measure_dim(background: SimplexMesh | CartesianGrid | Octree) -> int:
    """Return the dimension of the measure of the cells of a background."""
    return background.cell_dim if isinstance(background, SimplexMesh) else background.dim
