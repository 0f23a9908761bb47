"""Methods that draw meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptsize.background.methods.group import MeshMethods
from adaptsize.typing import Unpack

if TYPE_CHECKING:
    from adaptsize.options import ScaledPictureOptions
    from adaptsize.plot.pictures import Picture


class PictureMethods(MeshMethods):
    """Pictures, in windows and in notebooks."""

    def plot(self, *, color: str | None = None, **options: Unpack[ScaledPictureOptions]) -> Picture:
        """Show this mesh in a window, or as a picture where no window can open.

        A window opens where there is a display, unless a ``path`` is given.  Notebooks show
        pictures.

        Parameters
        ----------
        color, **options
            As for `plot_mesh`.  ``window=False`` only draws, as that does; so does the environment
            variable ``PYVISTA_OFF_SCREEN=true``.

        Returns
        -------
        Picture
            ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.

        Raises
        ------
        ValueError
            If an argument is bad.

        Examples
        --------
        >>> from adaptsize import SimplexMesh
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> mesh.plot(color="quality")  # doctest: +SKIP
        """
        from adaptsize.plot.pictures import plot

        return plot(self._mesh, color=color, **options)

    def _repr_html_(self) -> str:
        """Return a table and, of up to a million cells, a picture where this machine can draw."""
        from adaptsize.plot.notebook import html_of

        return html_of(self._mesh)
