"""What groups of methods have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adaptsize.background.simplex import SimplexMesh


class MeshMethods:
    """Base of a group of methods of `SimplexMesh`, which inherits all groups."""

    @property
    def _mesh(self) -> SimplexMesh:
        """The mesh of which these are the methods."""
        raise NotImplementedError
