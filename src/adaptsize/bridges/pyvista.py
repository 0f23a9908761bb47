"""The accessor ``dataset.adaptsize`` of PyVista's data sets.

PyVista imports this module by its entry point ``pyvista.accessors`` on the first use of the name.
Results are new data sets; the one at hand is not changed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pyvista

from adaptsize._checks import warn_caller
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.errors import InputWarning

if TYPE_CHECKING:
    from adaptsize.quality.conformity import Conformity


@pyvista.register_dataset_accessor("adaptsize", pyvista.DataSet)
class AdaptsizeAccessor:
    """Sizes and remeshing of a PyVista data set.

    Parameters
    ----------
    dataset : pyvista.DataSet
        Triangles or tetrahedra, or cells that can be cut into them.

    Examples
    --------
    >>> import pyvista
    >>> ball = pyvista.Sphere(theta_resolution=20, phi_resolution=20)
    >>> sized = ball.adaptsize.size(hmax=0.1)  # doctest: +SKIP
    >>> sized.plot(scalars="h")  # doctest: +SKIP
    >>> solid = ball.adaptsize.remesh(hmax=0.1)  # doctest: +SKIP
    """

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    @property
    def mesh(self) -> SimplexMesh:
        """The data set as a `SimplexMesh`."""
        return SimplexMesh.from_object(self._dataset)

    def size(self, **options: Any) -> Any:
        """Return a copy with the sizes of `adaptsize.size_function` as point data ``h``."""
        from adaptsize.domain_size import size_function

        return self._with_sizes(size_function(self.mesh, **options))

    def limit(self, h0: str | npt.ArrayLike, g: float = GRADIENT_LIMIT, **options: Any) -> Any:
        """Return a copy with the limited sizes as point data ``h``.

        Parameters
        ----------
        h0 : str or array_like of float, shape (n_points,)
            Upper bounds, or the name of the point data that holds them.
        g : float
            Gradient limit.
        **options
            As for `adaptsize.limit_gradient`.
        """
        from adaptsize.limiting import limit_gradient

        mesh = self.mesh
        if isinstance(h0, str):
            if h0 not in mesh.point_data:
                known = ", ".join(mesh.point_data) or "none"
                raise ValueError(f"h0 must name point data of the data set ({known}), got {h0!r}")
            h0 = mesh.point_data[h0]
        return self._with_sizes(SizeFunction(mesh, limit_gradient(mesh, h0, g, **options)))

    def remesh(self, size: SizeFunction | float | None = None, **options: Any) -> Any:
        """Return a new mesh as ``pyvista.UnstructuredGrid``, with the point data ``h``.

        Other point and cell data are transferred, unless a surface is filled.  A warning names
        those with values that are not finite, which are left out.

        Parameters
        ----------
        size : SizeFunction or float, optional
            Requested sizes.  By default the point data ``h``, if there is one, otherwise those of
            `adaptsize.size_function`.
        **options
            As for `adaptsize.remesh`; without ``size`` and ``h``, ``g``, ``hmin``, ``hmax`` and
            ``max_elements`` are those of `adaptsize.size_function`.
        """
        from adaptsize.adaptation.transfer import carry_fields
        from adaptsize.domain_size import size_function
        from adaptsize.remeshing import remesh

        mesh = self.mesh
        if size is None and "h" in mesh.point_data:
            size = SizeFunction(mesh, mesh.point_data["h"])
        if size is None:
            of_sizes = ("g", "hmin", "hmax", "max_elements")
            given = {name: options.pop(name) for name in of_sizes if name in options}
            size = size_function(mesh, **given)
        new = remesh(mesh.without_data(), size, **options)
        if new.cell_dim == mesh.cell_dim:
            new, left_out = carry_fields(mesh, new)
            for text in left_out:
                warn_caller(text, InputWarning)
        if isinstance(size, SizeFunction):
            new = new.with_data(point_data={"h": size(new.points)})
        return new.to_pyvista()

    def conformity(self, size: SizeFunction | None = None) -> Conformity:
        """Return how closely the edges follow ``size``, by default the point data ``h``."""
        from adaptsize.quality.conformity import size_conformity

        mesh = self.mesh
        if size is None and "h" not in mesh.point_data:
            raise ValueError("size must be given: the data set has no point data 'h'")
        return size_conformity(mesh, mesh.point_data["h"] if size is None else size)

    def _with_sizes(self, size: SizeFunction) -> Any:
        copy = self._dataset.copy()
        points = np.asarray(copy.points, dtype=np.float64)[:, : size.background.dim]
        copy.point_data["h"] = size(points)
        return copy
