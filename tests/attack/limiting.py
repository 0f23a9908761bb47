"""Limiting on hard domains, compared with brute force and visibility graphs.

What is known depends on the domain: the exact sizes (`is_exact`), or bounds from below (straight
lines) and from above (paths along edges, or along a fine graph in the cells).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import domains
import numpy as np
from backgrounds import rises
from exact_oracle import edge_sizes, plane_domain, plane_sizes, straight_sizes
from meshes import jittered_square, random_sphere
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.limiting import Exact

from .cases import Failure, told_with


class Domain(NamedTuple):
    """A background, and the exact sizes for bounds at nodes if they are known."""

    background: ads.SimplexMesh
    exact: Callable[[np.ndarray, float], np.ndarray] | None = None
    far: float = 0.0
    """Largest coordinate, if that is much larger than the domain: a source of rounding."""


def run(rng: np.random.Generator, folder: Path) -> str:
    """Limit random bounds on a random domain and check all that is known about the result."""
    name = str(rng.choice(list(_DOMAINS)))
    domain = _DOMAINS[name](rng)
    background = domain.background
    h0 = _bounds(background, rng)
    g: Any = float(rng.choice([0.0, 0.05, 0.3, 1.0, 5.0]))
    is_flat = background.cell_dim == background.dim
    schemes = [Exact(face_sources=True), Exact(face_sources=False)] if is_flat else ["auto"]
    scheme: Any = [*2 * schemes, "fast-marching", "edge-based"][rng.integers(2 * len(schemes) + 2)]
    if rng.random() < 0.4 and isinstance(scheme, str):
        places = background.n_cells, background.n_points
        g = g * rng.uniform(0.1, 1.0, places[rng.integers(0, 2)])
    what = f"{name}, {background!r}, g={g if np.ndim(g) == 0 else np.shape(g)}, {scheme}"
    with told_with(what):
        try:
            _check(domain, h0, g, scheme)
        except Failure:
            raise
        except Exception as error:
            raise Failure(type(error).__name__) from error
    return what


def _check(domain: Domain, h0: np.ndarray, g: Any, scheme: Any) -> None:
    background = domain.background
    h, info = ads.limit_gradient.with_info(background, h0, g, method=scheme)
    finite = np.isfinite(h)
    # A size is a linear interpolant of at most four bounds plus g times a distance, or a closed
    # form in which they cancel.  Each of some ten operations rounds by half an epsilon of its
    # result, and results are at most the largest bound or g times the diameter.
    rise = float(np.max(g)) * float(background.diagonal)
    epsilon = 10.0 * float(np.finfo(float).eps) * (float(h0[np.isfinite(h0)].max()) + rise)
    if np.isnan(h).any():
        raise Failure("NaN")
    if (h > h0).any():
        raise Failure("above the bound")
    if h.min() < h0.min() - epsilon:
        raise Failure("below the smallest bound")
    if not info.converged:
        raise Failure("no convergence")
    rounding = 1e-9 * (rise + float(h[finite].max())) + 1e-14 * domain.far * float(np.max(g))
    _check_edges(background, h, g, rounding)
    if np.ndim(g) == 0 and g > 0.0:
        _check_sizes(domain, h0, g, scheme, h, rounding)


def _check_edges(background: Any, h: np.ndarray, g: Any, rounding: float) -> None:
    """Compare the rise along every edge with the bound on it."""
    i, j, rise = rises(background, g)
    if not np.array_equal(np.isfinite(h[i]), np.isfinite(h[j])):
        raise Failure("inf beside a finite size")
    both = np.isfinite(h[i])
    excess = h[i][both] - h[j][both] - rise[both]
    if excess.max(initial=0.0) > rounding:
        raise Failure(f"an edge is too steep by {excess.max():.3g}")


def _check_sizes(
    domain: Domain, h0: np.ndarray, g: float, scheme: Any, h: np.ndarray, rounding: float
) -> None:
    """Compare with the exact sizes, or with bounds on them."""
    background = domain.background
    of_nodes = isinstance(scheme, Exact) and not scheme.face_sources
    if domain.exact is not None and isinstance(scheme, Exact):
        expected = domain.exact(h0, g)
        if not np.array_equal(np.isfinite(h), np.isfinite(expected)):
            raise Failure("inf at other nodes than the reference")
        finite = np.isfinite(expected)
        error = h[finite] - expected[finite]
        # Bounds in between can only lower the sizes.
        if (np.abs(error).max() if of_nodes else error.max()) > rounding:
            raise Failure(f"off by {error.min():.3g} to {error.max():.3g} from the exact sizes")
    if (h > edge_sizes(background, h0, g) + rounding).any():
        raise Failure("above the paths along edges")
    lower = straight_sizes(background.points, h0, g) - rounding
    if of_nodes and (h < lower).any():
        raise Failure(f"below straight lines by {(lower - h).max():.3g}")


def _bounds(mesh: Any, rng: np.random.Generator) -> np.ndarray:
    share = rng.choice([0.0, 0.05, 0.5, 1.0])
    chosen = np.append(np.flatnonzero(rng.random(mesh.n_points) < share), rng.choice(mesh.n_points))
    decades = rng.choice([0.0, 1.0, 6.0])
    h0 = np.full(mesh.n_points, np.inf)
    h0[chosen] = mesh.diagonal * 0.1 * 10.0 ** rng.uniform(-decades, 0.0, len(chosen))
    return h0


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
    return Domain(ads.SimplexMesh(points, cells))


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


_DOMAINS: dict[str, Callable[[np.random.Generator], Domain]] = {
    "convex": _convex,
    "stretched": lambda rng: _convex(rng, factor=float(rng.choice([10.0, 100.0, 1e4]))),
    "far away": lambda rng: _convex(rng, far=float(rng.choice([1e3, 1e6]))),
    "punched": _punched,
    "doubled": _doubled,
    "cracked": _cracked,
    "tangled": _tangled,
    "many sheets": _many_sheets,
    "solid": lambda rng: _convex(rng, 3),
    "punched solid": _punched_solid,
}
