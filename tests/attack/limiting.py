"""Limiting on hard domains, compared with brute force and visibility graphs.

What is known depends on the domain: the exact sizes (`is_exact`), or bounds from below (straight
lines) and from above (paths along edges, or along a fine graph in the cells).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import domains
import numpy as np
from backgrounds import active_nodes, random_background, rises
from exact_on_grids import exact_sizes
from exact_oracle import edge_sizes, plane_domain, plane_sizes, straight_sizes
from meshes import jittered_square, random_sphere
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.limiting import Exact

from .cases import Failure


class Domain(NamedTuple):
    """A background, and the exact sizes for bounds at nodes if they are known."""

    background: Any
    exact: Callable[[np.ndarray, float], np.ndarray] | None = None
    far: float = 0.0
    """Largest coordinate, if that is much larger than the domain: a source of rounding."""
    overlaps: bool = False
    """Whether cells overlap: exact sizes have two bounds there, and need not fall with h0."""


class Problem(NamedTuple):
    """Bounds on a domain, and how they are limited."""

    domain: Domain
    h0: np.ndarray
    g: Any
    method: str
    options: dict[str, Any]

    @property
    def background(self) -> Any:
        return self.domain.background

    @property
    def is_exact(self) -> bool:
        is_flat = _is_flat(self.background)
        return self.method == "exact" or (self.method == "auto" and is_flat)

    @property
    def of_nodes(self) -> bool:
        """Whether bounds in between have no effect."""
        return self.is_exact and not self.options.get("face_sources", True)

    def limit(self, h0: np.ndarray) -> Any:
        method: Any = Exact(**self.options) if self.options else self.method
        return ads.limit_gradient.with_info(self.background, h0, self.g, method=method)


def run(rng: np.random.Generator, folder: Path) -> str:
    """Limit random bounds on a random domain and check all that is known about the result."""
    name = str(rng.choice(list(_DOMAINS), p=_WEIGHTS))
    domain = _DOMAINS[name](rng)
    background = domain.background
    h0 = _bounds(background, rng)
    g: Any = float(rng.choice([0.0, 0.05, 0.3, 1.0, 5.0]))
    is_flat = _is_flat(background)
    methods = ["auto", "fast-marching", "edge-based", *(["exact"] * 3 if is_flat else [])]
    method = str(rng.choice(methods))
    options: dict[str, Any] = {}
    if method in ("auto", "exact") and is_flat:
        options["face_sources"] = bool(rng.random() < 0.5)
    what = f"{name}, {background!r}, g={g}, {method} {options}"
    if rng.random() < 0.4 and not options:
        of_cells = rng.random() < 0.5 and isinstance(background, ads.SimplexMesh)
        shape = (background.n_cells,) if of_cells else background.nodal_shape
        g = g * rng.uniform(0.1, 1.0, shape)
        what += f", g times {shape}"
    try:
        _check(Problem(domain, h0, g, method, options), rng)
    except Failure as failure:
        raise Failure(f"{failure}: {what}") from None
    except Exception as error:
        raise Failure(f"{type(error).__name__}: {what}") from error
    return what


def _check(problem: Problem, rng: np.random.Generator) -> None:
    domain, h0, g = problem.domain, problem.h0, problem.g
    background = domain.background
    h, info = problem.limit(h0)
    active = active_nodes(background)
    finite = np.isfinite(h) & active
    # A size is a linear interpolant of at most four bounds plus g times a distance, or a closed
    # form in which they cancel.  Each of some ten operations rounds by half an epsilon of its
    # result, and results are at most the largest bound or g times the diameter.
    rise = float(np.max(g)) * float(background.diagonal)
    epsilon = 10.0 * float(np.finfo(float).eps) * (float(h0[np.isfinite(h0)].max()) + rise)
    if np.isnan(h).any():
        raise Failure("NaN")
    if (h[active] > h0[active]).any():
        raise Failure("above the bound")
    if h[active].min() < h0[active].min() - epsilon:
        raise Failure("below the smallest bound")
    if not info.converged:
        raise Failure("no convergence")
    rounding = 1e-9 * (rise + float(h[finite].max())) + 1e-14 * domain.far * float(np.max(g))
    _check_edges(background, h, g, rounding)
    if np.ndim(g) == 0 and g > 0.0:
        _check_sizes(problem, h, rounding)
    if not (domain.overlaps and problem.is_exact):
        _check_order(problem, h, rng, rounding)


def _check_edges(background: Any, h: np.ndarray, g: Any, rounding: float) -> None:
    """Compare the rise along every edge with the bound on it."""
    i, j, rise = rises(background, g)
    h = h.ravel()
    if not np.array_equal(np.isfinite(h[i]), np.isfinite(h[j])):
        raise Failure("inf beside a finite size")
    both = np.isfinite(h[i])
    excess = h[i][both] - h[j][both] - rise[both]
    if excess.max(initial=0.0) > rounding:
        raise Failure(f"an edge is too steep by {excess.max():.3g}")


def _check_sizes(problem: Problem, h: np.ndarray, rounding: float) -> None:
    background, exact = problem.background, problem.domain.exact
    if exact is not None and problem.is_exact:
        expected = exact(problem.h0, problem.g)
        if not np.array_equal(np.isfinite(h), np.isfinite(expected)):
            raise Failure("inf at other nodes than the reference")
        finite = np.isfinite(expected)
        error = h[finite] - expected[finite]
        # Bounds in between can only lower the sizes.
        worst = np.abs(error).max() if problem.of_nodes else error.max()
        if worst > rounding:
            raise Failure(f"off by {error.min():.3g} to {error.max():.3g} from the exact sizes")
    if isinstance(background, ads.SimplexMesh):
        if (h > edge_sizes(background, problem.h0, problem.g) + rounding).any():
            raise Failure("above the paths along edges")
        lower = straight_sizes(background.points, problem.h0, problem.g) - rounding
        if problem.of_nodes and (h < lower).any():
            raise Failure(f"below straight lines by {(lower - h).max():.3g}")


def _check_order(problem: Problem, h: np.ndarray, rng: Any, rounding: float) -> None:
    """Lower some bounds: no size may rise.  Exact sizes in solids are upper bounds only."""
    h0 = problem.h0
    if problem.is_exact and problem.background.dim == 3:
        return
    lower = np.where(rng.random(h0.shape) < 0.2, h0 * rng.uniform(0.1, 1.0, h0.shape), h0)
    if problem.is_exact and not problem.of_nodes:
        # Linear interpolation between inf and a finite bound is inf.
        lower = np.where(np.isinf(h0), np.inf, lower)
    again, _ = problem.limit(lower)
    finite = np.isfinite(h)
    if (again[finite] > h[finite] + rounding).any():
        raise Failure("a size rises if bounds fall")


def _bounds(background: Any, rng: np.random.Generator) -> np.ndarray:
    shape = background.nodal_shape
    allowed = np.flatnonzero(active_nodes(background))
    share = rng.choice([0.0, 0.05, 0.5, 1.0])
    chosen = np.append(allowed[rng.random(len(allowed)) < share], rng.choice(allowed))
    decades = rng.choice([0.0, 1.0, 6.0])
    h0 = np.full(shape, np.inf)
    scale = background.diagonal or 1.0
    h0.flat[chosen] = scale * 0.1 * 10.0 ** rng.uniform(-decades, 0.0, len(chosen))
    return h0


def _is_flat(background: Any) -> bool:
    return not isinstance(background, ads.SimplexMesh) or background.cell_dim == background.dim


# --- domains --------------------------------------------------------------------------------------


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(1 << 30))


def _convex(
    rng: np.random.Generator, dim: int = 2, far: float = 0.0, factor: float = 1.0
) -> Domain:
    """Random points; Delaunay before it is stretched has sliver cells nearly everywhere."""
    points = rng.random((int(rng.integers(5, 200)), dim))
    cells = Delaunay(points).simplices
    points = points * [factor, *[1.0] * (dim - 1)] + far
    mesh = ads.SimplexMesh(points, cells)
    return Domain(mesh, lambda h0, g: straight_sizes(points, h0, g), far)


def _in_the_plane(mesh: Any) -> Domain:
    return Domain(mesh, lambda h0, g: plane_sizes(plane_domain(mesh), h0, g))


def _punched(rng: np.random.Generator) -> Domain:
    mesh = jittered_square(int(rng.integers(5, 13)), _seed(rng), half_width=1.0)
    return _in_the_plane(domains.with_removed_cells(mesh, _seed(rng), int(rng.integers(1, 15)))[0])


def _doubled(rng: np.random.Generator) -> Domain:
    """Cells given twice, turned over."""
    mesh = _punched(rng).background
    again = mesh.cells[rng.random(mesh.n_cells) < 0.3][:, rng.permutation(3)]
    return _in_the_plane(ads.SimplexMesh(mesh.points, np.concatenate([mesh.cells, again])))


def _cracked(rng: np.random.Generator) -> Domain:
    """Nodes given twice, so that cells that touch are apart."""
    mesh = _convex(rng).background
    torn = np.flatnonzero(rng.random(mesh.n_points) < 0.2)
    other = np.arange(mesh.n_points)
    other[torn] = mesh.n_points + np.arange(len(torn))
    beyond = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5
    cells = np.where(beyond[:, None], other[mesh.cells], mesh.cells)
    return Domain(ads.SimplexMesh(np.concatenate([mesh.points, mesh.points[torn]]), cells))


def _tangled(rng: np.random.Generator) -> Domain:
    """Random cells: overlapping, doubled and flat ones, and edges of many cells."""
    dim = int(rng.choice([2, 3]))
    n = int(rng.integers(6, 30))
    points = np.round(rng.random((n, dim)), int(rng.choice([1, 9])))
    width = int(rng.choice([2, 3, 4] if dim == 3 else [2, 3]))
    cells = np.array([rng.choice(n, width, replace=False) for _ in range(3 * n)])
    return Domain(ads.SimplexMesh(points, cells), overlaps=True)


def _thin(rng: np.random.Generator) -> Domain:
    makes: tuple[Callable[[int], Any], ...] = (
        lambda seed: domains.spiral(1200, turns=int(rng.integers(2, 4)), seed=seed),
        lambda seed: domains.slit_square(1200, width=rng.choice([0.01, 0.5, 2.0]), seed=seed),
        lambda seed: domains.maze(1200, seed=seed),
    )
    return _in_the_plane(makes[int(rng.integers(0, 3))](_seed(rng))[0])


def _many_sheets(rng: np.random.Generator) -> Domain:
    """A surface whose sheets meet in edges of three and more triangles."""
    mesh = random_sphere(int(rng.integers(8, 80)), _seed(rng))
    more = rng.integers(0, mesh.n_points, (int(rng.integers(1, 20)), 3))
    more = more[(np.diff(np.sort(more, axis=1), axis=1) > 0).all(axis=1)]
    return Domain(ads.SimplexMesh(mesh.points, np.concatenate([mesh.cells, more])))


def _punched_solid(rng: np.random.Generator) -> Domain:
    mesh = _convex(rng, 3).background
    kept = rng.random(mesh.n_cells) < rng.uniform(0.5, 1.0)
    kept[0] = True
    return Domain(ads.SimplexMesh(mesh.points, mesh.cells[kept]))


def _grid(rng: np.random.Generator) -> Domain:
    grid = random_background("grid", str(rng.choice(["1-D", "2-D", "3-D"])), rng, uneven=True)
    shape, spacing, active = grid.shape, grid.spacing, grid.active
    if grid.dim == 3:
        return Domain(grid)
    return Domain(grid, lambda h0, g: exact_sizes(shape, spacing, active, h0, g, segments=False))


def _tree(rng: np.random.Generator) -> Domain:
    uneven = bool(rng.random() < 0.5)
    tree = random_background("octree", str(rng.choice(["2-D", "3-D"])), rng, uneven=uneven)
    return Domain(tree, lambda h0, g: straight_sizes(tree.points, h0, g))


_DOMAINS: dict[str, Callable[[np.random.Generator], Domain]] = {
    "convex": _convex,
    "stretched": lambda rng: _convex(rng, factor=float(rng.choice([10.0, 100.0, 1e4]))),
    "far away": lambda rng: _convex(rng, far=float(rng.choice([1e3, 1e6]))),
    "punched": _punched,
    "doubled": _doubled,
    "cracked": _cracked,
    "tangled": _tangled,
    "thin": _thin,
    "many sheets": _many_sheets,
    "solid": lambda rng: _convex(rng, 3),
    "punched solid": _punched_solid,
    "grid": _grid,
    "tree": _tree,
}
_WEIGHTS = np.array([1.0 if name != "thin" else 0.2 for name in _DOMAINS])
_WEIGHTS /= _WEIGHTS.sum()
