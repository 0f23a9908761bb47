"""`limit_gradient` on distributed meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize import limiting
from adaptsize.distributed.mesh import PartitionedMesh
from adaptsize.typing import FloatArray, GradientLimit, ProgressCallback


def limit_gradient(
    part: PartitionedMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: str = "auto",
    face_sources: bool = True,
    threads: int | None = None,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    """Return the sizes of `adaptsize.limit_gradient` on the nodes of this rank; collective."""
    whole = part.gather()
    bounds = part.gather_nodal(np.asarray(h0, dtype=np.float64))

    def solve() -> FloatArray | None:
        if whole is None or bounds is None:
            return None
        options: Any = {"method": method, "face_sources": face_sources, "threads": threads}
        h: FloatArray = limiting.limit_gradient(whole, bounds, g, **options)
        return h

    return part.scatter_nodal(part.comm.agree(solve))
