"""Transfer of fields to a mesh whose cells are parts of the old ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag
from adaptsize.adaptation._fields import as_field, as_method
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import Resolved
from adaptsize.typing import NodalMethod, ProgressCallback


class NestedTransfer(FieldTransfer):
    """Transfers fields to a mesh whose cells are parts of the old ones, without intersections.

    Old functions that are linear or constant in the old cells are so in the new ones: values are
    those of the same functions, whatever the method.
    """

    def __init__(
        self,
        old: SimplexMesh,
        divided: Resolved,
        *,
        progress: ProgressCallback | bool | None = None,
    ) -> None:
        super().__init__(old, divided.mesh, progress=progress)
        self._divided = divided

    def nodal(
        self, values: npt.ArrayLike, *, method: NodalMethod | None = None
    ) -> npt.NDArray[Any]:
        """Return a nodal field on the new mesh: at new nodes the mean at the ends of their edge."""
        field = as_field("values", values, self.old.n_points)
        as_method("method", method, self.old)
        if field.dtype.kind in "biu":
            return field[self._divided.first_ends()]
        return self._divided.extended(field)

    def cells(
        self, values: npt.ArrayLike, *, conservative: bool = True, keep_integral: bool = False
    ) -> npt.NDArray[Any]:
        """Return a cell field on the new mesh: the value of the old cell."""
        field = as_field("values", values, self.old.n_cells)
        as_flag("conservative", conservative)
        as_flag("keep_integral", keep_integral)
        return np.asarray(field[self._divided.parents])
