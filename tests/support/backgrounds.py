"""Every scheme on every kind of background: what the laws, exact and order suites run over.

A new scheme is one line in `CASES`; the laws that it does not keep stand there with the reason.
"""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_sphere, random_square
from scipy.spatial import Delaunay

from adaptsize import CartesianGrid, Octree, SimplexMesh, limit_gradient
from adaptsize.limiting import EdgeBased, Exact, FastMarching, HamiltonJacobi, PositiveCoefficient
from adaptsize.limiting.problem import Scheme
from adaptsize.typing import FloatArray

Background = SimplexMesh | CartesianGrid | Octree

KINDS = {
    "simplices": ("segments", "plane", "surface", "volume"),
    "grid": ("1-D", "2-D", "3-D"),
    "octree": ("2-D", "3-D"),
}


@dataclass(frozen=True)
class Case:
    """A scheme on a kind of background, and what it promises."""

    background: str
    """A key of `KINDS`."""
    scheme: Scheme
    """With the options of the laws, which want a tight tolerance."""
    _: KW_ONLY
    kinds: tuple[str, ...] = ()
    """Those of `KINDS` that it works on; all if empty."""
    limits: tuple[str, ...] = ()
    """What g may be: "number", "nodes", "cells"; all that the background knows if empty."""
    rounding: float = 1e-12
    """Relative error of a size that its arithmetic, or its tolerance, accounts for."""
    residual: float = 1e-12
    """Bound on `LimitingInfo.residual` of the scheme."""
    convergence: float | None = 1.0
    """Order away from the tips of cones; None: it does not converge, or needs no order suite."""
    is_exact: bool = False
    """Whether it meets sizes from single points to rounding where straight lines stay inside."""
    exempt: Mapping[str, str] = field(default_factory=dict)
    """Laws that it does not keep, by the name of the test without "test_", and why."""
    share: float = 0.5
    """Of the examples that the profile of hypothesis asks for."""

    def __str__(self) -> str:
        name = f"{self.background}-{self.method}" + ("-2" if self.order == 2 else "")
        return name if getattr(self.scheme, "face_sources", True) else f"{name}-of-nodes"

    @property
    def loose(self) -> "Case":
        """The case with a tolerance far below the errors, for fine backgrounds."""
        if not isinstance(self.scheme, HamiltonJacobi):
            return self
        return replace(self, scheme=replace(self.scheme, tol=1e-4))

    @property
    def method(self) -> str:
        return self.scheme.name

    @property
    def order(self) -> int:
        return getattr(self.scheme, "order", 1)

    def limit(self, background: Background, h0: Any, g: Any, **options: Any) -> FloatArray:
        """Run the scheme, or one with other options given as ``method``."""
        return self.with_info(background, h0, g, **options)[0]

    def with_info(self, background: Background, h0: Any, g: Any, **options: Any) -> Any:
        """Run the scheme, return sizes and info."""
        options = {"method": self.scheme, **options}
        return limit_gradient.with_info(background, h0, g, **options)

    @property
    def all_kinds(self) -> tuple[str, ...]:
        return self.kinds or KINDS[self.background]

    @property
    def all_limits(self) -> tuple[str, ...]:
        known = ("number", "nodes") if self.background == "grid" else ("number", "nodes", "cells")
        return self.limits or known


_ONE_G = ("plane", "surface", "volume")

# An iteration that stops at a rate of tol g leaves, over the at most 40 nodes that a size
# passes in the laws, 40 tol g dx; the smallest size there is 0.01 of the longest spacing.
_TIGHT: dict[str, Any] = {"rounding": 1e-8, "residual": 1e-11}

# Lower bounds, or another g, move the fronts and with them the nodes that second differences
# reach through.  Seen on rough random fields: up to 6 % in monotony, 4 % the second time.
_NOT_MONOTONE = "second differences change sides where fronts meet: sizes may rise there"
_SECOND_ORDER = {
    "lower_bounds_give_lower_sizes": _NOT_MONOTONE,
    "larger_g_gives_larger_sizes": _NOT_MONOTONE,
    "is_the_largest_solution_of_its_own_equations": _NOT_MONOTONE,
    "limiting_twice_changes_nothing": "which nodes keep their bound, and so have no second "
    "difference across them, is another set the second time",
}

# Of bounds on edges and faces.  Of 160 random meshes a quarter changed, by up to 0.4 of a size.
_ONCE = "the limited sizes, linear on edges and faces, bound more than the first ones did"
_EXACT: dict[str, Any] = {
    "limits": ("number",), "convergence": 2.0, "is_exact": True, "residual": 0.0,
    "rounding": 1e-11,  # lines beside walls and corners are distinguished to 1e-11 of the extent
    "exempt": {"limiting_twice_changes_nothing": _ONCE},
}  # fmt: skip
_NODES_ONLY: dict[str, Any] = {
    # Sizes of nodes say nothing between them: no waves from a side.
    **_EXACT, "exempt": {}, "convergence": None,
}  # fmt: skip
CASES = (
    Case("simplices", Exact(), kinds=_ONE_G, **_EXACT, share=0.3),
    Case("simplices", Exact(face_sources=False), kinds=_ONE_G, **_NODES_ONLY, share=0.25),
    Case("simplices", FastMarching(), share=0.7),
    Case("simplices", PositiveCoefficient(), residual=1e-3, share=0.5),
    Case("simplices", EdgeBased(), convergence=None, share=0.3),
    Case("grid", Exact(), **_EXACT, share=0.3),
    Case("grid", Exact(face_sources=False), **_NODES_ONLY, share=0.25),
    Case("grid", FastMarching(), share=0.5),
    Case("grid", FastMarching(order=2), convergence=2.0, exempt=_SECOND_ORDER, share=0.5),
    Case("grid", HamiltonJacobi(tol=1e-11), **_TIGHT, share=0.3),
    Case(
        "grid",
        HamiltonJacobi(2, tol=1e-11),
        convergence=2.0,
        exempt=_SECOND_ORDER,
        **_TIGHT,
        share=0.4,
    ),
    Case("grid", EdgeBased(), convergence=None, share=0.3),
    # The same schemes on the simplices of the leaves: fewer examples do.
    Case("octree", Exact(), **_EXACT, share=0.15),
    Case("octree", FastMarching(), share=0.2),
    Case("octree", PositiveCoefficient(), residual=1e-3, share=0.15),
    Case("octree", EdgeBased(), convergence=None, share=0.1),
)


def cases(
    background: str | None = None,
    kind: str | None = None,
    limit: str | None = None,
    *,
    orders: tuple[int, ...] = (1, 2),
) -> list[Case]:
    """Return those that converge, on all backgrounds or one, that know a kind of it and of g."""
    return [
        case
        for case in CASES
        if case.convergence is not None
        and case.order in orders
        and background in (None, case.background)
        and (kind is None or kind in case.all_kinds)
        and (limit is None or limit in case.all_limits)
    ]


# --- random backgrounds for the laws -----------------------------------------------------


class Problem(NamedTuple):
    """What a law is tried on."""

    background: Background
    h0: FloatArray
    g: Any


@st.composite
def problems(draw: Callable[..., Any], case: Case) -> Problem:
    """Draw a background that the case works on, bounds on some nodes, and limits."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(case.all_kinds))
    # Uneven: nodes out of the domain, or cells without volume.
    # Which ways are tried over edges of a solid depends on the numbers of nodes.
    may_be_uneven = not (case.method == "exact" and kind == "volume")
    uneven = may_be_uneven and draw(st.booleans())
    background = random_background(case.background, kind, rng, uneven=uneven)
    shape = background.nodal_shape
    bounded = rng.random(shape) < draw(st.sampled_from([0.1, 0.5, 1.0]))
    bounded.flat[rng.choice(np.flatnonzero(active_nodes(background)))] = True
    h0 = np.where(bounded, rng.uniform(0.01, 2.0, shape), np.inf)
    scale = draw(st.sampled_from([0.0, 0.1, 0.3, 1.0]))
    where = draw(st.sampled_from(case.all_limits))
    places = {"number": (), "nodes": shape}
    if where == "cells":
        places["cells"] = (domain(background).n_cells,)
    return Problem(background, h0, scale * rng.uniform(0.5, 1.0, places[where]))


def _random_mesh(kind: str, rng: np.random.Generator, uneven: bool) -> SimplexMesh:
    n = int(rng.integers(4, 40))
    if kind == "segments":
        order = rng.permutation(n)
        mesh = SimplexMesh(rng.random((n, 2)), np.column_stack([order[:-1], order[1:]]))
    elif kind == "surface":
        mesh = random_sphere(max(n, 8), int(rng.integers(2**31)))
    else:
        points = rng.random((max(n, 8), 2 if kind == "plane" else 3))
        points[-1] = points[0]  # a doubled point: Delaunay leaves it in no cell
        mesh = SimplexMesh(points, Delaunay(points).simplices)
    if not uneven:
        return mesh
    # Move a node onto another one: cells of no volume and edges of no length.
    i, j = mesh.cells[rng.integers(mesh.n_cells), :2]
    points = mesh.points.copy()
    points[i] = points[j]
    return SimplexMesh(points, mesh.cells)


def _random_grid(kind: str, rng: np.random.Generator, uneven: bool) -> CartesianGrid:
    dim = int(kind[0])
    shape = tuple(map(int, rng.integers(2, (40, 9, 5)[dim - 1], dim)))
    active = None
    if uneven:
        active = rng.random(shape) < 0.75
        active.flat[rng.integers(active.size)] = True
    spacing = rng.uniform(0.05, 0.2, dim)
    return CartesianGrid(rng.uniform(-1.0, 1.0, dim), spacing, shape, active=active)


def _random_octree(kind: str, rng: np.random.Generator, uneven: bool) -> Octree:
    dim = int(kind[0])
    lower = rng.uniform(-1.0, 0.0, dim)
    return Octree.build(
        lower,
        lower + rng.uniform(0.5, 2.0, dim),
        lambda centres, sizes: rng.random(len(centres)) < 0.4,
        max_level=(4, 2)[dim - 2],
        root_shape=rng.integers(1, 3, dim),
        balanced=not uneven,
    )


def random_background(
    name: str, kind: str, rng: np.random.Generator, *, uneven: bool
) -> Background:
    """Return a background of a kind; if uneven with inactive nodes, or cells without volume."""
    makers = {"simplices": _random_mesh, "grid": _random_grid, "octree": _random_octree}
    return makers[name](kind, rng, uneven)


# --- what backgrounds have in common -------------------------------------------------------


def domain(background: Background) -> SimplexMesh | CartesianGrid:
    """Return what the schemes see: of an octree the mesh."""
    return background.mesh if isinstance(background, Octree) else background


def active_nodes(background: Background) -> np.ndarray:
    """Return which nodes take part, bool[nodal_shape]."""
    active = getattr(background, "active", None)
    return np.ones(background.nodal_shape, bool) if active is None else active


def placed(background: Background, scale: float, shift: FloatArray | float) -> Background:
    """Return the background at ``scale x + shift``."""
    if isinstance(background, SimplexMesh):
        return SimplexMesh(scale * background.points + shift, background.cells)
    if isinstance(background, Octree):
        lower, upper = scale * background.lower + shift, scale * background.upper + shift
        return Octree(lower, upper, background.root_shape, background.levels)
    origin, spacing = scale * background.origin + shift, scale * background.spacing
    return CartesianGrid(origin, spacing, background.shape, active=background.active)


class Rises(NamedTuple):
    """For both directions of every edge: what h[i] may exceed h[j] by (flat indices)."""

    i: np.ndarray
    j: np.ndarray
    rise: FloatArray


def rises(background: Background, g: Any) -> Rises:
    """Return the bound on every edge: g of the cell, on grids of the larger end, times length.

    g of nodes is their mean in the cell.
    """
    if isinstance(background, CartesianGrid):
        i, j, length = _grid_edges(background)
        return Rises(i, j, np.broadcast_to(g, background.shape).ravel()[i] * length)
    mesh = domain(background)
    if np.ndim(g) == 0:
        of_cells = np.full(mesh.n_cells, g)
    else:
        of_cells = g[mesh.cells].mean(axis=1) if len(g) == mesh.n_points else g
    width = range(mesh.cells.shape[1])
    pairs = [(mesh.cells[:, v], mesh.cells[:, w]) for v in width for w in width if v != w]
    i, j = np.concatenate(pairs, axis=1)
    length = np.linalg.norm(mesh.points[i] - mesh.points[j], axis=1)
    return Rises(i, j, np.tile(of_cells, len(pairs)) * length)


def _grid_edges(grid: CartesianGrid) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    number = np.arange(grid.n_points).reshape(grid.shape)
    active = active_nodes(grid).ravel()
    parts = []
    for axis, (n, spacing) in enumerate(zip(grid.shape, grid.spacing, strict=True)):
        low, high = number.take(range(n - 1), axis).ravel(), number.take(range(1, n), axis).ravel()
        both = active[low] & active[high]
        for i, j in ((low, high), (high, low)):
            parts.append((i[both], j[both], np.full(both.sum(), spacing)))
    i, j, length = (np.concatenate(column) for column in zip(*parts, strict=True))
    return i, j, length


# --- the paper's problem --------------------------------------------------------------------


def coordinates(background: Background) -> FloatArray:
    """Return the nodes, float64[*nodal_shape, dim]."""
    return background.points.reshape(*background.nodal_shape, -1)


def two_sources(background: Background, g: float = 0.3) -> tuple[FloatArray, FloatArray]:
    """Return bounds and result of section 6.2 of Persson (2006), on a part of (-50, 50)^dim.

    Sizes 1 at (-10, 0) and 5 at (10, 0), or at the nodes nearest to them.
    """
    x = coordinates(background)
    h0 = np.full(x.shape[:-1], np.inf)
    cones = []
    for size, place in ((1.0, -10.0), (5.0, 10.0)):
        at = np.zeros(x.shape[-1])
        at[0] = place
        node = np.unravel_index(np.argmin(np.linalg.norm(x - at, axis=-1)), h0.shape)
        h0[node] = size
        cones.append(size + g * np.linalg.norm(x - x[node], axis=-1))
    return h0, np.minimum(*cones)


# --- refined families for the order of convergence -----------------------------------------


class Family(NamedTuple):
    """Backgrounds of falling spacing, and the distance from a source on them."""

    background: str
    kind: str
    make: Callable[[int], Background]
    sizes: tuple[int, ...]
    """Nodes along a side."""
    distance: Callable[[FloatArray], FloatArray]
    tip: float
    """Sizes are given within this distance of the source: at the tip itself the rings of
    cells are never small compared with their distance, which costs a factor log(1/a)."""
    far: float = np.inf
    """Errors are taken below this distance."""


def _from_source(x: FloatArray) -> FloatArray:
    return np.linalg.norm(x - 0.1, axis=1)


def _from_pole(x: FloatArray) -> FloatArray:
    return np.arccos(np.clip(x[:, 2], -1.0, 1.0))


def _stretched(n_side: int) -> SimplexMesh:
    # Random points meshed in a strip and stretched 3:1: obtuse slivers everywhere.
    points = np.random.default_rng(53).uniform(-50.0, 50.0, (n_side**2, 2))
    return SimplexMesh(points, Delaunay(points * [3.0, 1.0]).simplices)


def _box_grid(*per_side: float) -> Callable[[int], CartesianGrid]:
    """Make grids of (-50, 50)^dim with (n - 1) ``per_side`` spacings along the axes."""

    def make(n_side: int) -> CartesianGrid:
        boxes = np.rint((n_side - 1) * np.array(per_side)).astype(int)
        return CartesianGrid([-50.0] * len(boxes), 100.0 / boxes, [int(n) + 1 for n in boxes])

    return make


square_grid = _box_grid(1, 1)


def graded_tree(dim: int) -> Callable[[int], Octree]:
    """Make trees of (-50, 50)^dim: cells four times smaller near one plane, not balanced."""

    def make(n_side: int) -> Octree:
        def needs_refinement(centres: FloatArray, edges: FloatArray) -> np.ndarray:
            return np.abs(centres[:, 1]) < 7.0

        shape = [n_side - 1] * dim
        return Octree.build(
            [-50.0] * dim, [50.0] * dim, needs_refinement, max_level=2, root_shape=shape
        )

    return make


_PLANE = (41, 81)
FAMILIES = {
    "plane": Family(
        "simplices", "plane", lambda n: jittered_square(n, 51), _PLANE, _from_source, 10
    ),
    "random plane": Family(
        "simplices", "plane", lambda n: random_square(n**2, 52, half_width=50.0),
        _PLANE, _from_source, 10,
    ),
    "stretched plane": Family("simplices", "plane", _stretched, _PLANE, _from_source, 10),
    # The antipode, where all fronts meet, is another singular point.
    "sphere": Family(
        "simplices", "surface", lambda n: random_sphere(n**2, 55), _PLANE, _from_pole, 0.5, 3.0
    ),
    "volume": Family(
        "simplices", "volume", lambda n: jittered_cube(n, 54), (13, 21), _from_source, 20
    ),
    "square grid": Family("grid", "2-D", square_grid, _PLANE, _from_source, 20),
    "stretched grid": Family("grid", "2-D", _box_grid(1.6, 0.4), _PLANE, _from_source, 20),
    "cubic grid": Family("grid", "3-D", _box_grid(1, 0.8, 1.2), (21, 31), _from_source, 20),
    "quadtree": Family("octree", "2-D", graded_tree(2), (33, 65), _from_source, 20),
    "octree": Family("octree", "3-D", graded_tree(3), (9, 15), _from_source, 25),
}  # fmt: skip
