"""Fields on the next mesh of a loop, and what the report says about their transfer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.adaptation._fields import Arrays, methods_of
from adaptsize.adaptation.element_fields import CheckedFields
from adaptsize.adaptation.field_transfer import integral
from adaptsize.adaptation.transfer import transferred
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.bisection import Resolved
from adaptsize.options import AdaptOptions
from adaptsize.typing import ProgressCallback

_HOW = {"interpolate": "interpolated", "project": "projected", "bounded": "projected in bounds"}
#: Of fields on parts of cells.
_SAME = "the same function"


@dataclass(frozen=True)
class NextFields:
    """Fields on a mesh; the records by name are empty if they are not transferred."""

    nodal: dict[str, Any]
    by_cell: Arrays
    how: dict[str, str] = field(default_factory=dict)
    """How each field was transferred."""
    integrals: dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]] = field(default_factory=dict)
    """Over the old and the new mesh."""
    magnitudes: dict[str, float] = field(default_factory=dict)
    """Integrals of the absolute values over the old mesh, the largest of the components."""

    def add(
        self,
        name: str,
        how: str,
        integrals: tuple[npt.NDArray[Any], npt.NDArray[Any]],
        magnitude: float,
    ) -> None:
        """Add what is known of the transfer of a field with integrals."""
        self.how[name], self.integrals[name], self.magnitudes[name] = how, integrals, magnitude


def kept_fields(fields: CheckedFields, by_cell: Arrays) -> NextFields:
    """Return the fields of a mesh that stays."""
    return NextFields(fields.kept([*fields.arrays, *fields.elements]), by_cell)


def moved_fields(
    old: AnyMesh,
    new: AnyMesh,
    fields: CheckedFields,
    by_cell: Arrays,
    options: AdaptOptions,
    progress: ProgressCallback,
    divided: Resolved | None = None,
) -> NextFields:
    """Return the fields on a new mesh, with their integrals; collective.

    ``divided`` says how the cells of the old mesh were bisected, if they were.
    """
    nodal, cells = transferred(old, new, fields, by_cell, options, progress, divided)
    found = NextFields(nodal, cells)
    methods = methods_of(options["method"], fields.arrays, old)
    of_nodes = {name: _HOW[method] for name, method in methods.items()}
    conservative = "conservative" if options["conservative"] else "value at the centroid"
    if divided is not None:
        of_nodes, conservative = dict.fromkeys(methods, _SAME), _SAME
    for name, values in fields.arrays.items():
        if values.dtype.kind in "biu":
            found.how[name] = "nearest node"
            continue
        both = integral(old, values, nodal=True), integral(new, nodal[name], nodal=True)
        size = integral(old, np.abs(values), nodal=True)
        found.add(name, of_nodes[name], both, float(size.max(initial=0.0)))
    for name, values in by_cell.items():
        if values.dtype.kind in "biu":
            found.how[name] = "value at the centroid"
            continue
        both = integral(old, values), integral(new, cells[name])
        found.add(name, conservative, both, float(integral(old, np.abs(values)).max(initial=0.0)))
    if isinstance(old, SimplexMesh) and isinstance(new, SimplexMesh):
        for name, element in fields.elements.items():
            before, magnitude = element.before(old)
            both = before, element.integral(nodal[name], new)
            found.add(name, element.how, both, magnitude)
    return found
