"""What differs between versions of DOLFINx, which is not imported here."""

from __future__ import annotations

from typing import Any


def nodes_of_cells(geometry: Any) -> Any:
    """Return the nodes of the cells of a ``dolfinx.mesh.Geometry``, int[n_cells, k].

    ``dofmaps`` became an attribute in DOLFINx 0.11.
    """
    maps = getattr(geometry, "dofmaps", None)
    if maps is None:
        return geometry.dofmap
    return maps(0) if callable(maps) else maps[0]
