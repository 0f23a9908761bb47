"""Limiting on hard domains, compared with brute force and visibility graphs.

What is known depends on the domain: the exact sizes (`is_exact`), or bounds from below (straight
lines) and from above (paths along edges, or along a fine graph in the cells).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import domains
import numpy as np
from exact_on_grids import exact_sizes
from exact_oracle import edge_sizes, plane_domain, plane_sizes, straight_sizes
from meshes import jittered_square, random_sphere
from scipy.spatial import Delaunay

import adaptsize as ads

from .cases import Failure


class Domain(NamedTuple):
    """A background, and the exact sizes for bounds at nodes if they are known."""

    background: Any
    exact: Callable[[np.ndarray, float], np.ndarray] | None = None
    far: float = 0.0
    """Largest coordinate, if that is much larger than the domain: a source of rounding."""
    overlaps: bool = False
    """Whether cells overlap: exact sizes have two bounds there, and need not fall with h0."""


def run(rng: np.random.Generator, folder: Path) -> str:
    """Limit random bounds on a random domain and check all that is known about the result."""
    name = str(rng.choice(list(_DOMAINS), p=_WEIGHTS))
    domain = _DOMAINS[name](rng)
    background = domain.background
    h0 = _bounds(background, rng)
    g = float(rng.choice([0.0, 0.05, 0.3, 1.0, 5.0]))
    method = str(rng.choice(_methods(background)))
    options = {}
    if method in ("auto", "exact") and _is_flat(background):
        options["face_sources"] = bool(rng.random() < 0.5)
    limit: Any = g
    if rng.random() < 0.4 and method not in ("exact",) and "face_sources" not in options:
        shape = background.nodal_shape
        if rng.random() < 0.5 and isinstance(background, ads.SimplexMesh):
            shape = (background.n_cells,)
        limit = g * rng.uniform(0.1, 1.0, shape)
    what = f"{name}, {background!r}, g={g}{'' if np.ndim(limit) == 0 else ' times an array'}, "
    what += f"{method} {options}"
    try:
        _check(domain, h0, limit, method, options, rng)
    except Failure as failure:
        raise Failure(f"{failure}: {what}") from None
    except Exception as error:
        raise Failure(f"{type(error).__name__}: {what}") from error
    return what


def _check(
    domain: Domain, h0: np.ndarray, g: Any, method: str, options: dict[str, Any], rng: Any
) -> None:
    background = domain.background
    h, info = ads.limit_gradient.with_info(background, h0, g, method=method, **options)
    active = getattr(background, "active", None)
    active = np.ones(h.shape, bool) if active is None else active
    finite = np.isfinite(h) & active
    if np.isnan(h).any():
        raise Failure("NaN")
    if (h[active] > h0[active]).any():
        raise Failure("above the bound")
    if h[active].min() < h0[active].min() - _rounding_of_a_bound(background, h0, g):
        raise Failure("below the smallest bound")
    scale = float(np.max(g)) * background.diagonal + float(h[finite].max())
    rounding = 1e-9 * scale + 1e-14 * domain.far * float(np.max(g))
    _check_edges(background, h, g, rounding)
    if not info.converged:
        raise Failure("no convergence")
    if np.ndim(g) == 0 and g > 0.0:
        _check_sizes(domain, h0, h, g, method, options, rounding)
    if not (domain.overlaps and _is_exact(background, method)):
        _check_order(background, h0, h, g, method, options, rng, rounding)


def _rounding_of_a_bound(background: Any, h0: np.ndarray, g: Any) -> float:
    """Return how far rounding may take a size below the smallest bound.

    A size is a linear interpolant of at most four bounds plus g times a distance, or a closed form
    in which they cancel.  Each of some ten operations rounds by half an epsilon of its result, and
    results are at most the largest bound or g times the diameter.
    """
    largest = float(h0[np.isfinite(h0)].max()) + float(np.max(g)) * float(background.diagonal)
    return 10.0 * float(np.finfo(float).eps) * largest


def _check_edges(background: Any, h: np.ndarray, g: Any, rounding: float) -> None:
    """Compare the rise along every edge with the smallest g of its cells."""
    mesh = background.mesh if isinstance(background, ads.Octree) else background
    if not isinstance(mesh, ads.SimplexMesh):
        return
    if np.shape(g) == (mesh.n_points,):
        in_cells = np.asarray(g)[mesh.cells].mean(axis=1)
    else:
        in_cells = np.broadcast_to(g, mesh.n_cells)
    width = mesh.cells.shape[1]
    for v in range(width):
        for w in range(v):
            i, j = mesh.cells[:, v], mesh.cells[:, w]
            if not np.array_equal(np.isfinite(h[i]), np.isfinite(h[j])):
                raise Failure("inf beside a finite size")
            both = np.isfinite(h[i])
            length = np.linalg.norm(mesh.points[i] - mesh.points[j], axis=1)
            excess = np.abs(h[i][both] - h[j][both]) - (in_cells * length)[both]
            if excess.max(initial=0.0) > rounding:
                raise Failure(f"an edge is too steep by {excess.max():.3g}")


def _check_sizes(
    domain: Domain,
    h0: np.ndarray,
    h: np.ndarray,
    g: float,
    method: str,
    options: dict[str, Any],
    rounding: float,
) -> None:
    background = domain.background
    is_exact = _is_exact(background, method)
    of_nodes = is_exact and not options.get("face_sources", True)
    if domain.exact is not None and is_exact:
        expected = domain.exact(h0, g)
        if not np.array_equal(np.isfinite(h), np.isfinite(expected)):
            raise Failure("inf at other nodes than the reference")
        finite = np.isfinite(expected)
        error = h[finite] - expected[finite]
        # Bounds in between can only lower the sizes.
        worst = np.abs(error).max() if of_nodes else error.max()
        if worst > rounding:
            raise Failure(f"off by {error.min():.3g} to {error.max():.3g} from the exact sizes")
    if isinstance(background, ads.SimplexMesh):
        upper = edge_sizes(background, h0, g)
        if (h > upper + rounding).any():
            raise Failure("above the paths along edges")
        if of_nodes:
            lower = straight_sizes(background.points, h0, g)
            if (h < lower - rounding).any():
                raise Failure(f"below straight lines by {(lower - h).max():.3g}")


def _is_exact(background: Any, method: str) -> bool:
    return method == "exact" or (method == "auto" and _is_flat(background))


def _check_order(
    background: Any,
    h0: np.ndarray,
    h: np.ndarray,
    g: Any,
    method: str,
    options: dict[str, Any],
    rng: np.random.Generator,
    rounding: float,
) -> None:
    """Lower some bounds: no size may rise.  Exact sizes in solids are upper bounds only."""
    is_exact = _is_exact(background, method)
    if is_exact and background.dim == 3:
        return
    lower = np.where(rng.random(h0.shape) < 0.2, h0 * rng.uniform(0.1, 1.0, h0.shape), h0)
    if is_exact and options.get("face_sources", True):
        # Linear interpolation between inf and a finite bound is inf.
        lower = np.where(np.isinf(h0), np.inf, lower)
    again = ads.limit_gradient(background, lower, g, method=method, **options)
    finite = np.isfinite(h)
    if (again[finite] > h[finite] + rounding).any():
        raise Failure("a size rises if bounds fall")


def _bounds(background: Any, rng: np.random.Generator) -> np.ndarray:
    shape = background.nodal_shape
    active = getattr(background, "active", None)
    allowed = np.arange(int(np.prod(shape))) if active is None else np.flatnonzero(active)
    scale = background.diagonal or 1.0
    h0 = np.full(shape, np.inf)
    share = rng.choice([0.0, 0.05, 0.5, 1.0])
    chosen = allowed[rng.random(len(allowed)) < share]
    chosen = np.append(chosen, rng.choice(allowed))
    decades = rng.choice([0.0, 1.0, 6.0])
    h0.flat[chosen] = scale * 0.1 * 10.0 ** rng.uniform(-decades, 0.0, len(chosen))
    return h0


def _is_flat(background: Any) -> bool:
    return not isinstance(background, ads.SimplexMesh) or background.cell_dim == background.dim


def _methods(background: Any) -> list[str]:
    methods = ["auto", "fast-marching", "edge-based"]
    return methods + (["exact"] * 3 if _is_flat(background) else [])


# --- domains --------------------------------------------------------------------------------------


def _convex(rng: np.random.Generator, dim: int = 2) -> Domain:
    points = rng.random((int(rng.integers(5, 200)), dim))
    mesh = ads.SimplexMesh(points, Delaunay(points).simplices)
    return Domain(mesh, lambda h0, g: straight_sizes(points, h0, g))


def _stretched(rng: np.random.Generator) -> Domain:
    """Delaunay before it is stretched: sliver cells nearly everywhere."""
    mesh = _convex(rng).background
    points = mesh.points * [float(rng.choice([10.0, 100.0, 1e4])), 1.0]
    mesh = ads.SimplexMesh(points, mesh.cells)
    return Domain(mesh, lambda h0, g: straight_sizes(points, h0, g))


def _far_away(rng: np.random.Generator) -> Domain:
    mesh = _convex(rng).background
    far = float(rng.choice([1e3, 1e6]))
    points = mesh.points + far
    mesh = ads.SimplexMesh(points, mesh.cells)
    return Domain(mesh, lambda h0, g: straight_sizes(points, h0, g), far)


def _punched(rng: np.random.Generator) -> Domain:
    mesh = jittered_square(int(rng.integers(5, 13)), int(rng.integers(1 << 30)), half_width=1.0)
    seed, count = int(rng.integers(1 << 30)), int(rng.integers(1, 15))
    mesh = domains.with_removed_cells(mesh, seed, count)[0]
    return _in_the_plane(mesh)


def _doubled(rng: np.random.Generator) -> Domain:
    """Cells given twice, turned over."""
    mesh = _punched(rng).background
    again = mesh.cells[rng.random(mesh.n_cells) < 0.3]
    order = rng.permutation(3)
    mesh = ads.SimplexMesh(mesh.points, np.concatenate([mesh.cells, again[:, order]]))
    return _in_the_plane(mesh)


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
    make = (domains.spiral, domains.slit_square, domains.maze)[int(rng.integers(0, 3))]
    seed = int(rng.integers(1 << 30))
    options: dict[str, Any] = {}
    if make is domains.slit_square:
        options = {"width": float(rng.choice([0.01, 0.5, 2.0]))}
    if make is domains.spiral:
        options = {"turns": int(rng.integers(2, 4))}
    mesh = make(1200, seed=seed, **options)[0]
    return _in_the_plane(mesh)


def _many_sheets(rng: np.random.Generator) -> Domain:
    """A surface whose sheets meet in edges of three and more triangles."""
    mesh = random_sphere(int(rng.integers(8, 80)), int(rng.integers(1 << 30)))
    n = mesh.n_points
    more = rng.integers(0, n, (int(rng.integers(1, 20)), 3))
    more = more[(np.diff(np.sort(more, axis=1), axis=1) > 0).all(axis=1)]
    return Domain(ads.SimplexMesh(mesh.points, np.concatenate([mesh.cells, more])))


def _solid(rng: np.random.Generator) -> Domain:
    return _convex(rng, 3)


def _punched_solid(rng: np.random.Generator) -> Domain:
    mesh = _convex(rng, 3).background
    kept = rng.random(mesh.n_cells) < rng.uniform(0.5, 1.0)
    kept[0] = True
    return Domain(ads.SimplexMesh(mesh.points, mesh.cells[kept]))


def _grid(rng: np.random.Generator) -> Domain:
    dim = int(rng.choice([1, 2, 3], p=[0.1, 0.6, 0.3]))
    shape = tuple(map(int, rng.integers(2, (20, 9, 4)[dim - 1], dim)))
    active = rng.random(shape) < rng.choice([0.6, 0.8, 1.0])
    active.flat[int(rng.integers(active.size))] = True
    spacing = rng.uniform(0.1, 1.0, dim)
    grid = ads.CartesianGrid(rng.normal(size=dim), spacing, shape, active=active)
    if dim == 3:
        return Domain(grid)
    return Domain(grid, lambda h0, g: exact_sizes(shape, spacing, active, h0, g, segments=False))


def _tree(rng: np.random.Generator) -> Domain:
    dim = int(rng.choice([2, 3]))
    tree = ads.Octree.build(
        [0.0] * dim,
        [1.0] * dim,
        lambda centres, sizes: rng.random(len(centres)) < 0.4,
        max_level=(4, 2)[dim - 2],
        balanced=bool(rng.random() < 0.5),
    )
    return Domain(tree, lambda h0, g: straight_sizes(tree.points, h0, g))


def _in_the_plane(mesh: Any) -> Domain:
    return Domain(mesh, lambda h0, g: plane_sizes(plane_domain(mesh), h0, g))


_DOMAINS: dict[str, Callable[[np.random.Generator], Domain]] = {
    "convex": _convex,
    "stretched": _stretched,
    "far away": _far_away,
    "punched": _punched,
    "doubled": _doubled,
    "cracked": _cracked,
    "tangled": _tangled,
    "thin": _thin,
    "many sheets": _many_sheets,
    "solid": _solid,
    "punched solid": _punched_solid,
    "grid": _grid,
    "tree": _tree,
}
_WEIGHTS = np.array([1.0 if name != "thin" else 0.2 for name in _DOMAINS])
_WEIGHTS /= _WEIGHTS.sum()
