"""Array aliases and the protocol of a background."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from typing_extensions import Unpack as Unpack  # noqa: PLC0414 - exported
else:
    Unpack = tuple  # annotations are not evaluated

__all__ = [
    "Background",
    "BoolArray",
    "FloatArray",
    "GradientLimit",
    "GradientOfSize",
    "IndexArray",
    "IntArray",
    "LongArray",
    "NodalMethod",
    "ProgressCallback",
]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int32]
LongArray: TypeAlias = npt.NDArray[np.int64]
IndexArray: TypeAlias = npt.NDArray[np.intp]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

#: ``g(h)``: takes an array of sizes and returns the gradient limit for each.
GradientOfSize: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
#: A gradient limit: a number, one per node or per cell, ``g(h)``, or a product ``(a, b)``.
GradientLimit: TypeAlias = npt.ArrayLike | GradientOfSize | tuple[npt.ArrayLike, GradientOfSize]
#: How a nodal field is transferred to another mesh.
NodalMethod: TypeAlias = Literal["interpolate", "project", "bounded"]
#: Called with a text and the share of the work done, 0 to 1 (None: unknown).
ProgressCallback: TypeAlias = Callable[[str, float | None], Any]


@runtime_checkable
class Background(Protocol):
    """A carrier of nodal sizes: a simplex mesh, a Cartesian grid or an octree.

    `SizeFunction` takes any other kind that has these attributes as well.
    """

    @property
    def dim(self) -> int:
        """Number of coordinates of a point."""
        ...

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        ...

    @property
    def nodal_shape(self) -> tuple[int, ...]:
        """Shape of an array of nodal values."""
        ...

    @property
    def points(self) -> FloatArray:
        """Nodes, float64[n_points, dim]."""
        ...

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the bounding box."""
        ...

    @property
    def locator(self) -> Any:
        """Point location: ``interpolate(values, points)`` returns values and distances."""
        ...
