"""Images: pixels or voxels with their spacing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_plain_array, describe
from adaptsize._pickling import ReadOnlyState
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.grid import as_spacing
from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Image(ReadOnlyState):
    """An image: pixels (2-D) or voxels (3-D) with their spacing.

    Parameters
    ----------
    values : array_like, 2-D or 3-D
        Labels (bool or integers) or intensities (floats).  ``values[i, j]`` belongs to the
        point ``origin + spacing * (i, j)``; axis 0 is x.  The array is copied and read-only.
    spacing : float or array_like of float, shape (dim,)
        Distance between neighbouring pixel centres, 1e-60 to 1e60: one number for all axes, or
        one for each.
    origin : array_like of float, shape (dim,), optional
        Centre of the first pixel; zeros by default.

    Raises
    ------
    ValueError
        If a shape is wrong, the values are not numbers, or a spacing is not positive.

    Examples
    --------
    >>> Image([[True, False], [True, True], [False, False]], spacing=0.5)
    Image(3 x 2 pixels of bool, spacing 0.5, 0.5)
    """

    values: npt.NDArray[Any]
    spacing: FloatArray
    origin: FloatArray

    def __init__(
        self,
        values: npt.ArrayLike,
        spacing: npt.ArrayLike = 1.0,
        origin: npt.ArrayLike | None = None,
    ) -> None:
        self._keep("values", values, spacing, origin)

    @classmethod
    def of(cls, name: str, values: npt.ArrayLike, spacing: npt.ArrayLike) -> Image:
        """Return an image of an argument, whose name is that in messages."""
        image = cls.__new__(cls)
        image._keep(name, values, spacing, None)
        return image

    def _keep(
        self,
        name: str,
        values: npt.ArrayLike,
        spacing: npt.ArrayLike,
        origin: npt.ArrayLike | None,
    ) -> None:
        """Store the checked arrays."""
        pixels = as_plain_array(name, values).copy()
        if pixels.ndim not in (2, 3) or pixels.dtype.kind not in "biuf" or 0 in pixels.shape:
            raise ValueError(
                f"{name} must be numbers in a 2-D or 3-D array, got "
                f"{pixels.dtype} of shape {pixels.shape}"
            )
        steps = as_spacing(spacing, pixels.ndim)
        start = np.zeros(pixels.ndim) if origin is None else as_float_array("origin", origin)
        if start.shape != (pixels.ndim,) or not np.isfinite(start).all():
            raise ValueError(f"origin must be {pixels.ndim} finite numbers, got {describe(origin)}")
        for kept, array in (("values", pixels), ("spacing", steps), ("origin", start.copy())):
            object.__setattr__(self, kept, read_only(array))  # needed for a frozen dataclass

    @property
    def dim(self) -> int:
        """2 for pixels, 3 for voxels."""
        return self.values.ndim

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of pixels along x, y (and z)."""
        return self.values.shape

    def __repr__(self) -> str:
        """Return the number of pixels, their type and their spacing."""
        pixels = " x ".join(str(n) for n in self.shape)
        steps = ", ".join(f"{step:.4g}" for step in self.spacing)
        return f"Image({pixels} pixels of {self.values.dtype}, spacing {steps})"
