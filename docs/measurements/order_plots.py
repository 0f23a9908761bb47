"""Draw the errors of the schemes against the spacing, for the pages of the methods.

    python docs/measurements/order_plots.py [NAME ...]

Writes docs/figures/order_NAME.png and prints every error; all of them take about five minutes.
"""

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import ScaledTranslation

import adaptsize as ads
from adaptsize.geometry import boundary_width, level_set_curvature
from adaptsize.limiting import FastMarching
from adaptsize.sizes import recovered_gradient, recovered_hessian

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))

import _problems
import curved_shapes
import distance_shapes
import octrees
from _gallery import drawing, save_drawing
from meshes import jittered_square, random_sphere
from recovery import means_of_cell_gradients, root_mean_square, wave

G = _problems.G
FIGURES = Path(__file__).parents[1] / "figures"
MARKS = "osD^vP"
EXACT = 1e-8  # smaller errors are not drawn, but listed


class Curve(NamedTuple):
    """Errors of one scheme."""

    name: str
    spacings: np.ndarray
    errors: np.ndarray

    @property
    def order(self) -> float:
        """The slope of the straight line through the logarithms of the finer half."""
        last = slice(-3, None)
        return np.polyfit(np.log(self.spacings[last]), np.log(self.errors[last]), 1)[0]


class Panel(NamedTuple):
    """One pair of axes."""

    title: str
    ylabel: str
    curves: list[Curve]


def curve(name: str, sizes: Iterable, measure: Callable) -> Curve:
    """Return the errors of a scheme: ``measure(size)`` gives spacing and error."""
    pairs = [measure(size) for size in sizes]
    spacings, errors = (np.array(column, dtype=float) for column in zip(*pairs, strict=True))
    print(f"  {name}:", ", ".join(f"{s:.3g} {e:.3g}" for s, e in pairs), flush=True)
    return Curve(name, spacings, errors)


# --- limiting -------------------------------------------------------------------------------------


def limited(problem: _problems.Problem, near: float = 0.0, **options) -> tuple[float, float]:
    """Return spacing and mean error; exact sizes are given within ``near`` of the sources."""
    mesh, bound = problem.background, problem.h0
    points = mesh.points.reshape(-1, mesh.dim)
    if near:
        sources = points[np.isfinite(bound).ravel()]
        known = (np.linalg.norm(points[:, None] - sources, axis=2) <= near).any(axis=1)
        bound = np.where(known.reshape(bound.shape), problem.exact, np.inf)
    h = ads.limit_gradient(mesh, bound, problem.g, **options)
    error = np.abs(h[problem.nodes] - problem.exact).mean()
    spacing = mean_edge(mesh) if isinstance(mesh, ads.SimplexMesh) else mesh.spacing[0]
    return spacing, error


def scheme(name, make, sizes, **options):
    """Return the curve of a scheme on the problem that ``make`` gives for a number of nodes."""
    return curve(name, sizes, lambda n: limited(make(n), **options))


def limiting() -> list[Panel]:
    """Edge-based, first and second order: the two sources of section 6.2 of Persson's paper."""

    def triangles(n):
        return _problems.two_sources(_problems.jittered_triangles(n))

    def tetrahedra(n):
        return _problems.two_sources(_problems.jittered_tetrahedra(n))

    fast = {"method": "fast-marching"}
    near = {**fast, "near": 10.0}
    second = {"method": FastMarching(order=2)}
    plane, space = (51**2, 101**2, 201**2, 401**2), (11**3, 21**3, 41**3, 61**3)
    edges = {"method": "edge-based"}
    return [
        Panel(
            "jittered triangles",
            "mean error",
            [
                scheme("edge-based", triangles, plane, **edges),
                scheme("fast marching", triangles, plane, **fast),
                scheme("fast marching, exact near", triangles, plane, **near),
                scheme("exact", triangles, plane, method="exact"),
            ],
        ),
        Panel(
            "squares of a grid",
            "mean error",
            [
                scheme("edge-based", _problems.on_grid, plane, **edges),
                scheme("order 1", _problems.on_grid, plane, **fast),
                scheme("order 1, exact near", _problems.on_grid, plane, **near),
                scheme("order 2", _problems.on_grid, plane, **second),
                scheme("order 2, exact near", _problems.on_grid, plane, **second, near=10.0),
                scheme("exact", _problems.on_grid, plane, method="exact"),
            ],
        ),
        Panel(
            "tetrahedra",
            "mean error",
            [
                scheme("edge-based", tetrahedra, space, **edges),
                scheme("fast marching", tetrahedra, space, **fast),
                scheme("fast marching, exact near", tetrahedra, space, **near),
                scheme("exact", tetrahedra, space, method="exact"),
            ],
        ),
    ]


def smooth_data() -> list[Panel]:
    """Smooth data, smooth g(x), a surface: where no scheme is exact."""
    plane, surface = (2_500, 10_000, 40_000, 160_000), (1_000, 4_000, 16_000, 64_000)

    def of(make, sizes, *methods):
        return [scheme(m.replace("-", " "), make, sizes, method=m) for m in methods]

    return [
        Panel(
            "disc, smooth sizes everywhere",
            "mean error",
            of(_problems.disc_everywhere, plane, "edge-based", "fast-marching", "exact"),
        ),
        Panel(
            "two sources, smooth g(x)",
            "mean error",
            of(_problems.smooth_limit, plane, "edge-based", "fast-marching"),
        ),
        Panel(
            "sphere, from a point",
            "mean error",
            of(_problems.sphere, surface, "edge-based", "fast-marching"),
        ),
    ]


def octree() -> list[Panel]:
    """Trees whose leaves differ by three levels at one line."""

    def tree(dim):
        return lambda n: (100.0 / n, octrees.error(dim, 100.0 / n, balanced=False)[1])

    return [
        Panel(
            "octrees, two sources, exact near",
            "largest error",
            [
                curve("plane", (32, 64, 128, 256), tree(2)),
                curve("space", (8, 16, 32), tree(3)),
            ],
        )
    ]


# --- the domain -----------------------------------------------------------------------------------


def distance() -> list[Panel]:
    """Measure the unit circle: of a function that is no distance, and of masks."""

    def quartic(n, inside):
        grid = ads.CartesianGrid([-1.61, -1.63], 3.2 / n, (n + 2, n + 2))
        radius = np.linalg.norm(grid.points, axis=-1).reshape(grid.shape)
        phi = ads.signed_distance(grid, lambda x: (x**2).sum(axis=1) ** 2 - 1.0)
        band = (np.abs(radius - 1.0) < 2.5 * 3.2 / n) == inside
        away = band & (radius > 0.3)
        return 3.2 / n, np.abs(phi - (radius - 1.0))[away].max()

    def mask(pixels, smoothed):
        errors = []
        for shift in np.random.default_rng(20060214).random((8, 2)):
            grid = ads.CartesianGrid(
                [-1.4, -1.4] + shift / pixels, 1.0 / pixels, (round(2.8 * pixels),) * 2
            )
            radius = np.linalg.norm(grid.points, axis=-1).reshape(grid.shape)
            if smoothed:
                phi = ads.signed_distance(grid, radius < 1.0)
                errors.append(np.abs(phi - (radius - 1.0))[np.abs(radius - 1.0) < 3.0 / pixels])
            else:  # the sides of the pixels, a quarter of a pixel off in the mean
                far = np.concatenate([np.diff(radius < 1.0, axis=a).ravel() for a in (0, 1)])
                middle = [0.5 * (radius[1:] + radius[:-1]), 0.5 * (radius[:, 1:] + radius[:, :-1])]
                at = np.concatenate([m.ravel() for m in middle])[far]
                errors.append(np.abs(at - 1.0))
        return 1.0 / pixels, np.concatenate(errors).mean()

    sizes, radii = (35, 70, 140, 280), (5, 10, 20, 40, 80)
    return [
        Panel(
            "distance to the zero level of $r^4 - 1$",
            "largest error",
            [
                curve("in the band", sizes, lambda n: quartic(n, True)),
                curve("beyond", sizes, lambda n: quartic(n, False)),
            ],
        ),
        Panel(
            "a disc as a mask",
            "mean error over the radius",
            [
                curve("sides of the pixels", radii, lambda n: mask(n, False)),
                curve("smoothed", radii, lambda n: mask(n, True)),
            ],
        ),
    ]


def medial_axis() -> list[Panel]:
    """Measure on an annulus and an ellipse, at five places of the grid."""
    shifts = np.random.default_rng(20060112).random((5, 2))

    def axis(n):
        errors = []
        for shift in shifts:
            grid, phi = distance_shapes.sampled(
                distance_shapes.annulus(0.4, 1.0), 1.0 / n, shift=shift, half=1.15
            )
            points = ads.medial_axis(grid, phi).points
            errors.append(np.abs(np.linalg.norm(points, axis=1) - 0.7))
        return 1.0 / n, np.concatenate(errors).mean()

    def width(shape, exact):
        def measure(n):
            errors = []
            for shift in shifts:
                grid, phi = distance_shapes.sampled(shape, 1.0 / n, shift=shift, half=1.15)
                found = ads.feature_size(grid, phi)
                inside = np.isfinite(found)
                true = exact(grid.points.reshape(-1, 2), phi.ravel()).reshape(phi.shape)
                errors.append(np.abs(found - true)[inside])
            return 1.0 / n, np.concatenate(errors).mean()

        return measure

    def of_ellipse(x, phi):
        beyond = np.maximum(np.abs(x[:, 0]) - 0.75, 0.0)  # the axis ends there
        return np.hypot(beyond, x[:, 1]) - phi

    sizes = (20, 40, 80, 160)
    annulus = distance_shapes.annulus(0.4, 1.0)
    return [
        Panel(
            "medial axis and feature size",
            "mean error",
            [
                curve("points of the axis, annulus", sizes, axis),
                curve(
                    "feature size, annulus",
                    sizes,
                    width(annulus, lambda x, phi: np.full(len(x), 0.3)),
                ),
                curve(
                    "feature size, ellipse",
                    sizes,
                    width(distance_shapes.Ellipse(1.0, 0.5), of_ellipse),
                ),
            ],
        )
    ]


def width() -> list[Panel]:
    """Width of tessellations of round bodies, at their facets."""

    def of(make, exact):
        def measure(n):
            mesh = make(n)
            return mean_edge(mesh), np.abs(boundary_width(mesh) - exact).mean() / exact

        return measure

    def ellipse(n):
        angle = 2.0 * np.pi * np.arange(n) / n
        points = np.column_stack([np.cos(angle), 0.5 * np.sin(angle)])
        ring = ads.SimplexMesh(points, np.column_stack([np.arange(n), (np.arange(n) + 1) % n]))
        found = boundary_width(ring)
        counted = np.isfinite(found)
        # A normal of the ellipse, and the chord along it.
        middle = angle + np.pi / n
        x, y = np.cos(middle), 0.5 * np.sin(middle)
        normal = np.column_stack([x, 4.0 * y])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        a = normal[:, 0] ** 2 + 4.0 * normal[:, 1] ** 2
        exact = 2.0 * (x * normal[:, 0] + 4.0 * y * normal[:, 1]) / a
        return mean_edge(ring), np.mean((np.abs(found - exact) / exact)[counted])

    tori = (16, 32, 64)
    return [
        Panel(
            "width by rays",
            "mean error over the width",
            [
                curve("torus", tori, of(lambda n: curved_shapes.smooth_torus(n)[0], 0.8)),
                curve(
                    "torus, irregular",
                    tori,
                    of(lambda n: curved_shapes.irregular_torus(n, 20060301)[0], 0.8),
                ),
                curve(
                    "ball, random nodes",
                    (500, 2000, 8000),
                    of(lambda n: random_sphere(n, 20060302), 2.0),
                ),
                curve("ellipse", (100, 200, 400, 800), ellipse),
            ],
        )
    ]


def curvature() -> list[Panel]:
    """Curvature of triangulated surfaces and of level sets."""

    def torus(make):
        def measure(n):
            mesh, kappa = make(n)
            return mean_edge(mesh), np.mean(np.abs(ads.geometry.curvature(mesh) - kappa) / kappa)

        return measure

    def level_set(at_boundary):
        def measure(n):
            step = 1.0 / n
            grid, phi = distance_shapes.sampled(distance_shapes.Ellipse(1.0, 0.5), step, half=1.15)
            x = grid.points.reshape(-1, 2)
            near = np.abs(phi).ravel() < 2.0 * step
            found = level_set_curvature(grid, phi, at_boundary=at_boundary).reshape(x.shape[0], -1)
            exact = ellipse_curvature(x[near])
            return step, np.mean(np.abs(found[near, 0] - exact) / exact)

        return measure

    tori, sizes = (16, 32, 64, 128), (20, 40, 80, 160)
    return [
        Panel(
            "curvature",
            "mean error over the curvature",
            [
                curve("torus, smooth triangles", tori, torus(curved_shapes.smooth_torus)),
                curve(
                    "torus, irregular triangles",
                    tori,
                    torus(lambda n: curved_shapes.irregular_torus(n, 20060301)),
                ),
                curve("ellipse, as at the nodes of a grid", sizes, level_set(False)),
                curve("ellipse, corrected to the boundary", sizes, level_set(True)),
            ],
        )
    ]


def ellipse_curvature(x: np.ndarray) -> np.ndarray:
    """Return the curvature of the ellipse 1, 0.5 at the points closest to ``x``."""
    t = np.arctan2(x[:, 1] / 0.5, x[:, 0])
    for _ in range(60):  # Newton's method for the foot of the perpendicular
        c, s = np.cos(t), np.sin(t)
        first = -0.75 * s * c + x[:, 0] * s - 0.5 * x[:, 1] * c
        second = -0.75 * (c**2 - s**2) + x[:, 0] * c + 0.5 * x[:, 1] * s
        t -= np.clip(first / np.where(np.abs(second) < 1e-12, 1e-12, second), -0.1, 0.1)
    return 0.5 / np.hypot(np.sin(t), 0.5 * np.cos(t)) ** 3


def mean_edge(mesh: ads.SimplexMesh) -> float:
    """Return the mean length of the edges."""
    a, b = mesh.points[mesh.edges].transpose(1, 0, 2)
    return float(np.linalg.norm(b - a, axis=1).mean())


# --- solutions, meshes ----------------------------------------------------------------------------


def recovery() -> list[Panel]:
    """First and second derivatives of a smooth field, by fits and by means."""

    def of(recover, which):
        def measure(n):
            mesh = jittered_square(n, 71829, half_width=1.0)
            values = wave(mesh.points)
            return 2.0 / (n - 1), root_mean_square(recover(mesh, values[0]) - values[which])

        return measure

    def means_twice(mesh, u):
        first = means_of_cell_gradients(mesh, u)
        return np.stack([means_of_cell_gradients(mesh, part) for part in first.T], axis=1)

    sizes = (21, 41, 81, 161)
    return [
        Panel(
            "derivatives, jittered triangles",
            "root mean square error",
            [
                curve("gradient, fits", sizes, of(recovered_gradient, 1)),
                curve("gradient, means", sizes, of(means_of_cell_gradients, 1)),
                curve("second derivatives, fits", sizes, of(recovered_hessian, 2)),
                curve("second derivatives, means", sizes, of(means_twice, 2)),
            ],
        )
    ]


def smoothing() -> list[Panel]:
    """Area and volume of meshes from distances."""

    def ball(dim):
        whole = {2: np.pi, 3: 4.0 * np.pi / 3.0}[dim]

        def measure(h):
            mesh = ads.mesh_from_distance(
                lambda x: np.linalg.norm(x, axis=1) - 1.0, h, [-1.1] * dim, [1.1] * dim
            )
            return h, abs(mesh.measures.sum() - whole) / whole

        return measure

    return [
        Panel(
            "meshes from a distance",
            "error of area or volume, relative",
            [
                curve("disc", (0.2, 0.1, 0.05, 0.025), ball(2)),
                curve("ball", (0.4, 0.28, 0.2, 0.14), ball(3)),
            ],
        )
    ]


# --- pictures -------------------------------------------------------------------------------------


def draw(name: str, panels: list[Panel]) -> None:
    """Write docs/figures/order_NAME.png."""
    figure, axes = drawing(len(panels), 1, 480, shape=1.2)
    for axis, panel in zip(axes, panels, strict=True):
        seen = [c for c in panel.curves if c.errors.max() > EXACT]
        for mark, c in zip(MARKS, seen, strict=False):
            axis.loglog(c.spacings, c.errors, f"{mark}-", label=f"{c.name}: {abs(c.order):.1f}")
        exact = [c.name for c in panel.curves if c.errors.max() <= EXACT]
        for curve in exact:
            axis.plot([], [], " ", label=f"{curve}: errors below {EXACT:.0e}")
        low = min(c.errors.min() for c in seen)
        ends = np.array([min(c.spacings.min() for c in seen), max(c.spacings.max() for c in seen)])
        for order, style in ((1, ":"), (2, "--")):
            axis.loglog(ends, 0.5 * low * (ends / ends[0]) ** order, style, color="grey", lw=1.0)
            axis.text(  # right of the panel, where no curve passes
                1.01, 0.5 * low * (ends[1] / ends[0]) ** order, f"order {order}",
                transform=axis.get_yaxis_transform(), color="grey", fontsize=10, va="center",
            )  # fmt: skip
        axis.set(title=panel.title, xlabel="spacing, or mean length of edges", ylabel=panel.ylabel)
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.legend(
            fontsize=10, title="order on the finest three", title_fontsize=10,
            loc="upper center", bbox_to_anchor=(0.5, 0.0),
            bbox_transform=axis.transAxes + ScaledTranslation(0.0, -0.55, figure.dpi_scale_trans),
        )  # fmt: skip
        axis.grid(alpha=0.3)
    save_drawing(FIGURES / f"order_{name}.png", figure)


ALL = (
    limiting, smooth_data, octree, distance, medial_axis, width, curvature, recovery,
    smoothing,
)  # fmt: skip


if __name__ == "__main__":
    for measure_all in ALL:
        if not sys.argv[1:] or measure_all.__name__ in sys.argv[1:]:
            print(measure_all.__name__)
            draw(measure_all.__name__, measure_all())
