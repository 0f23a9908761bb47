"""Self-similar meshes for convergence studies, and the order observed on them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_float_array, as_number, as_tolerance, refusal, refuse_where
from adaptsize._defaults import TOLERANCE
from adaptsize._size_function import SizeFunction
from adaptsize._stopwatch import Stopwatch
from adaptsize.background import AnyBackground, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.domain_size.complete_size import size_function
from adaptsize.domain_size.elements import without_order
from adaptsize.domain_size.prescribed import Implicit
from adaptsize.domain_size.reports import report_of
from adaptsize.options import FamilyOptions, checked, options_of, with_options
from adaptsize.options.meshes import MeshOptions
from adaptsize.options.sizes import BudgetOptions, SizeOptions
from adaptsize.remeshing.driver import check_backend, remesh
from adaptsize.sizes.sources import SourcesLike
from adaptsize.typing import FloatArray, ProgressCallback, Unpack

#: Orders among which the observed one is searched.
_ORDERS = (0.05, 10.0)


@dataclass(frozen=True, eq=False)
class Convergence:
    """How a number converges with the mesh size: a value, an order and an uncertainty."""

    order: float
    """Observed order p of f = f0 + c h^p, or the given one."""
    value: float
    """f0, the value extrapolated to h = 0 (Richardson)."""
    gci: float
    """Grid convergence index: the relative uncertainty of the number on the finest mesh."""
    misfit: float
    """Largest difference between the numbers and the formula, over the range of the numbers.  It
    is 0 for as many numbers as unknowns."""

    @classmethod
    def of(
        cls, sizes: npt.ArrayLike, values: npt.ArrayLike, *, order: float | None = None
    ) -> Convergence:
        r"""Return the order, the extrapolated value and the uncertainty of numbers.

        Parameters
        ----------
        sizes : array_like of float, shape (n,)
            Mean sizes of the meshes, as `MeshFamily.mean_sizes`, in any order.
        values : array_like of float, shape (n,)
            One number per mesh, such as a force or a largest stress.
        order : float, optional
            The order, if it is known.  Then two numbers are enough.

        Returns
        -------
        Convergence

        Raises
        ------
        ValueError
            If there are fewer than three numbers (two with ``order``), sizes are not positive or
            equal, or the numbers do not approach a value with any order from 0.05 to 10.

        Notes
        -----
        :math:`f_0 + c \, h^p` is fitted by least squares.  For three numbers it passes through
        them, which is the procedure of [2]_ and [3]_.  The index is [1]_

        .. math:: F_s \, |c| \, h^p / |f|

        with :math:`F_s = 1.25`, or 3 if two numbers and the order are given.

        References
        ----------
        .. [1] P. J. Roache, "Perspective: a method for uniform reporting of grid refinement
           studies", J. Fluids Eng. 116 (1994) 405-413.
        .. [2] I. B. Celik et al., "Procedure for estimation and reporting of uncertainty due to
           discretization in CFD applications", J. Fluids Eng. 130 (2008) 078001.
        .. [3] ASME V&V 20-2009, "Standard for verification and validation in computational fluid
           dynamics and heat transfer", section 2.

        Examples
        --------
        >>> h = np.array([0.4, 0.2, 0.1])
        >>> found = Convergence.of(h, 3.0 + 0.5 * h**2)
        >>> round(found.order, 6), round(found.value, 6), round(found.gci, 6)
        (2.0, 3.0, 0.00208)
        """
        h = as_float_array("sizes", sizes)
        refuse_where("sizes", ~((h > 0.0) & np.isfinite(h)), h, "must be positive and finite")
        f = as_float_array("values", values, h.shape)
        refuse_where("values", ~np.isfinite(f), f, "must be finite")
        least = 3 if order is None else 2
        if h.ndim != 1 or len(h) < least or len(np.unique(h)) < len(h):
            raise ValueError(f"sizes must be {least} or more different numbers, got {h.tolist()}")
        finest, span = int(np.argmin(h)), float(np.ptp(f))
        if order is None:
            p = _best_order(h / h.max(), f)
        else:
            p = as_number("order", order, lower=0.0, strict=True)
        (value, change), fitted = _fit(h / h[finest], f, p)
        gci = (3.0 if len(h) == 2 else 1.25) * abs(change) / max(abs(f[finest]), 1e-300)
        misfit = float(np.abs(fitted - f).max()) / max(span, 1e-300)
        return cls(p, float(value), float(gci), misfit)

    def __str__(self) -> str:
        """Return the results in one line."""
        return (
            f"order {self.order:.3g}, extrapolated value {self.value:.6g}, grid convergence index "
            f"{self.gci:.2%}, misfit {self.misfit:.1%}"
        )


def _fit(h: FloatArray, f: FloatArray, p: float) -> tuple[FloatArray, FloatArray]:
    """Return the best coefficients of 1 and h^p, and the values fitted."""
    terms = np.column_stack([np.ones(len(h)), h**p])
    found: FloatArray = np.linalg.lstsq(terms, f, rcond=None)[0].astype(np.float64)
    return found, terms @ found


def _best_order(h: FloatArray, f: FloatArray) -> float:
    """Return the order of the best fit; refuse numbers that have none."""
    from scipy.optimize import minimize_scalar

    def missed(p: float) -> float:
        return float(np.square(_fit(h, f, p)[1] - f).sum())

    tried = np.linspace(*_ORDERS, 200)
    best = int(np.argmin([missed(p) for p in tried]))
    turns = len(np.unique(np.sign(np.diff(f[np.argsort(h)]))))
    if best in (0, len(tried) - 1) or (len(h) == 3 and turns > 1):
        raise refusal(
            "values",
            f"must approach a value with an order from {_ORDERS[0]} to {_ORDERS[1]:g}, got "
            f"{f.tolist()}: the coarsest mesh may be too coarse",
        )
    around = (tried[best - 1], tried[best + 1])
    return float(minimize_scalar(missed, bounds=around, options={"xatol": 1e-10}).x)


@dataclass(frozen=True, eq=False, repr=False)
class MeshFamily:
    """Meshes of one domain whose sizes are everywhere in the same proportion, coarsest first."""

    meshes: tuple[SimplexMesh, ...]
    sizes: tuple[SizeFunction, ...]
    """The size function of each mesh; the first one has a ``report``."""

    @property
    def mean_sizes(self) -> FloatArray:
        """Mean size of each mesh, (measure / number of cells)^(1 / dim), float64[levels]."""
        return np.array([mean_cell_size(mesh) for mesh in self.meshes])

    @property
    def ratios(self) -> FloatArray:
        """Mean size of each mesh over that of the next one, float64[levels - 1]."""
        h = self.mean_sizes
        return np.asarray(h[:-1] / h[1:])

    def convergence(self, values: npt.ArrayLike, *, order: float | None = None) -> Convergence:
        """Return the observed order, the extrapolated value and the uncertainty of numbers.

        Parameters
        ----------
        values : array_like of float, shape (levels,)
            A number computed on each of the meshes.
        order : float, optional
            As in `Convergence.of`, which this calls with the mean sizes.
        """
        return Convergence.of(self.mean_sizes, values, order=order)

    def __repr__(self) -> str:
        """Return the numbers of cells."""
        counts = ", ".join(str(mesh.n_cells) for mesh in self.meshes)
        return f"MeshFamily({counts} cells)"


def mean_cell_size(mesh: SimplexMesh) -> float:
    """Return (measure / number of cells)^(1 / dim)."""
    return float((mesh.measures.sum() / mesh.n_cells) ** (1.0 / mesh.cell_dim))


@recorded("mesh_family", "meshes.*", "sizes.*")
@with_options(FamilyOptions)
def mesh_family(
    mesh: SimplexMesh,
    *,
    background: AnyBackground | None = None,
    sources: SourcesLike | None = (),
    h0: npt.ArrayLike | Implicit | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[FamilyOptions],
) -> MeshFamily:
    r"""Return meshes for a convergence study, each finer than the one before by the same ratio.

    From one mesh to the next, all bounds on the size *and the gradient limit* are divided by
    ``ratio``.  Then so is the size at every point:

    .. math:: \min_y \frac{h_0(y)}{r} + \frac{g}{r} |x - y| = \frac{h(x)}{r}.

    With the bounds alone, sizes far from where they bind would hardly change.

    Parameters
    ----------
    mesh : SimplexMesh
        As in `remesh`.
    background, sources, h0, progress
        As in `size_function`.
    **options
        Those of sizes and of numbers of elements are for the coarsest mesh.

    Returns
    -------
    MeshFamily
        ``levels`` meshes, the coarsest first, with their true mean sizes.

    Raises
    ------
    ValueError
        As in `size_function` and `remesh`.
    TooManyElementsError
        If the finest mesh would have more than 5 million elements.
    BackendError
        As in `remesh`.

    Notes
    -----
    The finest mesh is made first.  The allowed distance from a curved boundary is divided by the
    square of the ratio, since a chord of half the length is four times closer to its arc.  Plane
    meshes are refined and put in a random order before each mesh is made, as in
    `remesh_to_elements`; otherwise the generator would keep edges of the given mesh.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> family = mesh_family(square, hmax=0.1, levels=3, ratio=2.0)
    >>> family.ratios.round(1)
    array([2., 2.])
    >>> h = family.mean_sizes
    >>> round(family.convergence(1.0 + h**2).order, 3)
    2.0
    """
    mesh = as_mesh("mesh", mesh)
    given = checked(FamilyOptions, options)
    check_backend(mesh, given["target"], given["backend"])
    levels, ratio = given["levels"], given["ratio"]
    # Sizes may do without a tolerance, a mesh keeps to the boundary.
    tolerance = as_tolerance("tolerance", given["tolerance"] or TOLERANCE)
    every: dict[str, Any] = {**given}
    for_mesh = {name: every[name] for name in options_of(MeshOptions)}
    for_sizes = {
        name: every[name]
        for name in (*options_of(SizeOptions), *options_of(BudgetOptions))
        if name in every  # growth is returned as g
    }
    coarsest = size_function(
        mesh, background=background, sources=sources, h0=h0, progress=progress, **for_sizes
    )
    report = report_of(coarsest)
    sizes, meshes, time = [], [], Stopwatch(for_mesh.pop("timeout"))
    for level in reversed(range(levels)):
        factor = ratio**-level
        size = _scaled(coarsest, factor)
        old = mesh
        if mesh.dim == mesh.cell_dim == 2:
            old = without_order(mesh, size)
        new = remesh(
            old, size, progress=progress, g=report.g * factor, hmax=report.hmax * factor,
            tolerance=tolerance * factor**2, timeout=time.for_next_mesh(), **for_mesh,
        )  # fmt: skip
        sizes.append(replace(size, report=None if level else report))
        meshes.append(new)
    return MeshFamily(tuple(meshes[::-1]), tuple(sizes[::-1]))


def _scaled(size: SizeFunction, factor: float) -> SizeFunction:
    """Return a size function times a factor, interpolated for all factors alike."""
    g = None if size.g is None else size.g * factor
    hmax = size.hmax if math.isinf(size.hmax) else size.hmax * factor
    return replace(size, values=size.values * factor, g=g, hmax=hmax, sources=None, report=None)
