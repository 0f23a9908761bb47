"""The accessor ``dataset.adaptsize`` of PyVista's data sets.

PyVista imports this module by its entry point ``pyvista.accessors`` on the first use of the name.
Results are new data sets; the one at hand is not changed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
import numpy.typing as npt
import pyvista

from adaptsize import domain_size, remeshing
from adaptsize._checks import warn_caller
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation.transfer import carry_fields
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.errors import InputWarning
from adaptsize.limiting import limit_gradient
from adaptsize.options import SizeFunctionOptions, options_of
from adaptsize.options.sizes import MeshSizeOptions
from adaptsize.quality.certificate import check_mesh
from adaptsize.quality.conformity import size_conformity
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.quality.certificate import MeshCheck
    from adaptsize.quality.conformity import Conformity, SizeLike

_Method = TypeVar("_Method", bound=Callable[..., Any])

#: Field data that hold the size function behind the point data ``h``.
_STORED = "adaptsize.size."
#: Options of `size_function` for domains that are no meshes.
_OF_OTHERS = {"box", *options_of(SizeFunctionOptions)} - {*options_of(MeshSizeOptions)}
#: Point data ``h`` that differ more from a size function were changed, or made by others.
_SAME = 1e-6


def _options_of(*functions: Callable[..., Any]) -> Callable[[_Method], _Method]:
    """Return a decorator that shows the keyword options of functions in place of ``**options``."""
    shown: dict[str, inspect.Parameter] = {}
    for function in functions:
        parameters = inspect.signature(function).parameters.values()
        options = {
            p.name: p for p in parameters if p.kind is p.KEYWORD_ONLY and p.name not in _OF_OTHERS
        }
        shown = {**options, **shown}

    def decorated(method: _Method) -> _Method:
        own = list(inspect.signature(method).parameters.values())[:-1]
        names = {parameter.name for parameter in own}
        every = [*own, *(p for name, p in shown.items() if name not in names)]
        method.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
        return method

    return decorated


def _named(options: dict[str, Any], function: Callable[..., Any]) -> dict[str, Any]:
    """Return those of some options that a function has."""
    known = inspect.signature(function).parameters
    return {name: value for name, value in options.items() if name in known}


@pyvista.register_dataset_accessor("adaptsize", pyvista.DataSet)
class AdaptsizeAccessor:
    """Sizes and remeshing of a PyVista data set.

    `size` and `limit` return data sets that keep their size function, also between the nodes and
    inside a surface, and when they are saved and read again: as field data.  `remesh` and
    `conformity` use it, as long as the point data ``h`` stay what they were.

    Parameters
    ----------
    dataset : pyvista.DataSet
        Triangles or tetrahedra, or cells that can be cut into them.

    Notes
    -----
    Copies and files hold the sizes at the nodes of their background; between these, sizes are then
    linear, where the size function itself knows how they grow from their sources.  Of sources
    inside a part that is given by its surface, they hold what acts on its surface; a warning says
    so.

    Examples
    --------
    >>> import pyvista
    >>> ball = pyvista.Sphere(theta_resolution=20, phi_resolution=20)
    >>> sized = ball.adaptsize.size(hmax=0.1)  # doctest: +SKIP
    >>> sized.plot(scalars="h")  # doctest: +SKIP
    >>> solid = sized.adaptsize.remesh()  # doctest: +SKIP
    """

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset
        self._made: SizeFunction | None = None

    def __repr__(self) -> str:
        """Return the mesh and its sizes."""
        size = self.size_function
        return f"AdaptsizeAccessor({self.mesh!r}, {'no sizes' if size is None else repr(size)})"

    @property
    def mesh(self) -> SimplexMesh:
        """The data set as a `SimplexMesh`, without a stored size function."""
        return SimplexMesh.from_object(self._dataset)

    @property
    def size_function(self) -> SizeFunction | None:
        """The size function behind the point data ``h``; None if there are none.

        That of `size` or `limit`, unless the point data were changed since.
        """
        if "h" not in self._dataset.point_data:
            return None
        h = np.asarray(self._dataset.point_data["h"], np.float64)
        for known in (lambda: self._made, lambda: _stored(self._dataset)):
            size = known()
            if size is not None and np.allclose(self._at_points(size), h, rtol=_SAME, atol=0.0):
                return size
        return SizeFunction(mesh := self.mesh, mesh.point_data["h"])

    @_options_of(domain_size.size_function)
    def size(self, **options: Any) -> Any:
        """Return a copy with the sizes of `adaptsize.size_function` as point data ``h``.

        Parameters
        ----------
        **options
            As for `adaptsize.size_function`.
        """
        return self._with_sizes(domain_size.size_function(self.mesh, **options))

    @_options_of(limit_gradient)
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
        mesh = self.mesh
        if isinstance(h0, str):
            if h0 not in mesh.point_data:
                known = ", ".join(mesh.point_data) or "none"
                raise ValueError(f"h0 must name point data of the data set ({known}), got {h0!r}")
            h0 = mesh.point_data[h0]
        values = limit_gradient(mesh, h0, g, **options)
        grows = mesh.cell_dim < mesh.dim and isinstance(g, int | float)
        return self._with_sizes(SizeFunction(mesh, values, g=float(g) if grows else None))

    @_options_of(domain_size.size_function, remeshing.remesh)
    def remesh(self, size: SizeLike | None = None, **options: Any) -> Any:
        """Return a new mesh as ``pyvista.UnstructuredGrid``, with the point data ``h``.

        Other point and cell data are transferred, unless a surface is filled.  A warning names
        those with values that are not finite, which are left out.

        Parameters
        ----------
        size : SizeFunction, callable, array_like or float, optional
            Requested sizes, as for `adaptsize.remesh`.  By default `size_function`, if there is
            one, otherwise the result of `adaptsize.size_function`.
        **options
            As for `adaptsize.remesh`.  Where sizes are computed, also those of
            `adaptsize.size_function`, which gets ``max_elements``; others that both have, such as
            ``tolerance``, go to both.
        """
        mesh = self.mesh
        if size is None:
            size = self.size_function
        if size is None:
            of_sizes = _named(options, domain_size.size_function)
            size = domain_size.size_function(mesh, **of_sizes)
            used = {*of_sizes} - {*_named(options, remeshing.remesh)} | {"max_elements"}
            options = {name: value for name, value in options.items() if name not in used}
        new = remeshing.remesh(mesh.without_data(), size, **options)
        if new.cell_dim == mesh.cell_dim:
            new, left_out = carry_fields(mesh, new)
            for text in left_out:
                warn_caller(text, InputWarning)
        if not isinstance(size, SizeFunction):
            return new.to_pyvista()
        made = new.with_data(point_data={"h": size(new.points)}).to_pyvista()
        return _keep(made, size)

    @_options_of(size_conformity)
    def conformity(self, size: SizeLike | None = None, **options: Any) -> Conformity:
        """Return how closely the edges follow ``size``, by default `size_function`.

        Parameters
        ----------
        size : SizeFunction, callable, array_like or float, optional
            As for `adaptsize.size_conformity`.
        **options
            As for `adaptsize.size_conformity`.
        """
        size = self.size_function if size is None else size
        if size is None:
            raise ValueError("size must be given: the data set has no point data 'h'")
        return size_conformity(self.mesh, size, **options)

    @_options_of(check_mesh)
    def check(self, *, original: Any = None, size: Any = None, **options: Any) -> MeshCheck:
        """Return whether the mesh is valid, as `adaptsize.check_mesh` does.

        Parameters
        ----------
        original : pyvista.DataSet or other mesh, optional
            Of the same domain.
        size : SizeFunction, callable, array_like or float, optional
            By default `size_function`, if there is one.
        **options
            As for `adaptsize.check_mesh`.
        """
        size = self.size_function if size is None else size
        return check_mesh(self.mesh, original=original, size=size, **options)

    def _with_sizes(self, size: SizeFunction) -> Any:
        copy = self._dataset.copy()
        copy.point_data["h"] = self._at_points(size)
        return _keep(copy, size)

    def _at_points(self, size: SizeFunction) -> FloatArray:
        """Return sizes at the points of the data set, which may be in the plane z = 0."""
        points = np.asarray(self._dataset.points, dtype=np.float64)
        return size(points[:, : size.background.dim])


def _keep(dataset: Any, size: SizeFunction) -> Any:
    """Keep a size function with a data set, and return it."""
    dataset.adaptsize._made = size
    background, values = size.background, size.values
    if isinstance(background, CartesianGrid):  # its sizes are not linear in simplices
        return dataset
    mesh = background if isinstance(background, SimplexMesh) else cast(Octree, background).mesh
    has_sources = size.inner is not None and len(size.inner.sources) > 0
    stored = {
        "points": mesh.points,
        "cells": mesh.cells,
        "values": values.ravel(),
        "off": np.array([np.nan if size.g is None else size.g, size.hmax, has_sources]),
    }
    for name, array in stored.items():
        dataset.field_data[_STORED + name] = array
    return dataset


def _stored(dataset: Any) -> SizeFunction | None:
    """Return the size function in the field data, or None."""
    names = [_STORED + name for name in ("points", "cells", "values", "off")]
    if any(name not in dataset.field_data for name in names):
        return None
    points, cells, values, (g, hmax, has_sources) = (
        np.asarray(dataset.field_data[name]) for name in names
    )
    if has_sources:
        warn_caller(
            "the size function was read from field data: sources inside the part act as they do on "
            "its surface only",
            InputWarning,
        )
    mesh = SimplexMesh(points, cells)
    if np.isnan(g):
        return SizeFunction(mesh, values)
    return SizeFunction(mesh, values, g=float(g), hmax=float(hmax))
