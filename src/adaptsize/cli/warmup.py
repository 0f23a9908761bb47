"""``adaptsize warmup``: compile the kernels before they are needed.

A first ``remesh`` compiles for half a minute.  The kernels that the sizes need last, and those that
are needed after the generator, are compiled in a second process meanwhile, which shares the cache
(`_kernels/turns.py`).  It goes on while the first one computes, or waits for the generator.
"""

import atexit
import multiprocessing
import os
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial

from adaptsize import _children
from adaptsize._cores import cores
from adaptsize.cli.command import command
from adaptsize.cli.console import Console

_said = False
#: The commands for which a second process compiles.
_WITH_ANOTHER = ("remesh",)


def announce_compilation(console: Console, name: str | None) -> None:
    """Print one line when the first kernel of this process is compiled, for the named command."""
    from numba.core import event

    class First(event.Listener):
        def on_start(self, _event: event.Event) -> None:
            global _said  # noqa: PLW0603 - once in a process
            if not _said:
                console.say(
                    "compiling kernels; this happens once and takes up to a minute "
                    "(adaptsize warmup)"
                )
                if name in _WITH_ANOTHER:
                    _start_another()
            _said = True

        def on_end(self, _event: event.Event) -> None:
            pass

    if not _said:
        event.register("numba:compile", First())


def _start_another() -> None:
    """Start a process that compiles, and ends with this one, if there is a core for it."""
    if cores() < 2 or sys.platform == "win32":  # which has no locks of files as here
        return
    program = _children.isolated(f"from {__name__} import compile_last; compile_last()")
    nothing = subprocess.DEVNULL
    try:
        child = _children.start(program, os.getcwd(), stdout=nothing, stderr=nothing)
    except OSError:  # no memory, or no more processes
        return
    atexit.register(_end, child)


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.kill()
    child.communicate()


def compile_last() -> None:
    """Compile what `remesh` needs later, until the standard input is closed."""

    def end_with_caller() -> None:
        sys.stdin.buffer.read()
        os._exit(1)

    threading.Thread(target=end_with_caller, daemon=True).start()
    warnings.simplefilter("ignore")
    for task in _LAST:
        task()
    # Without a shutdown of the interpreter, which would abort: the thread holds the standard input.
    os._exit(0)


@command()
def warmup(console: Console) -> int:
    """Compile all that the commands need, and keep it in a cache.

    For container images, clusters and read-only homes: set NUMBA_CACHE_DIR to a directory that
    stays.  Without this the first commands take up to a minute longer.  Prints how many functions
    were compiled, for how long, and the folder of the cache.
    """
    functions, folders = 0, set()
    workers = min(len(_TASKS), cores())
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        waiting = {pool.submit(_run, name): name for name in _TASKS}
        for count, done in enumerate(as_completed(waiting), 1):
            n, seconds, folder = done.result()
            functions += n
            folders.add(folder)
            console.say(
                f"{waiting[done]}: {n} functions compiled, {seconds:.1f} s "
                f"({count} of {len(_TASKS)})"
            )
    cache = os.path.commonpath(folders)
    console.record(compiled=list(_TASKS), n_compiled=functions, cache=cache)
    found = f"{functions} functions compiled" if functions else "all was compiled before"
    console.print(f"{found}, {console.seconds:.0f} s; the cache is {cache}")
    return 0


def _run(name: str) -> tuple[int, float, str]:
    """Run a task; return how many functions it compiled, its seconds and the folder of the cache.

    Functions that several tasks need are compiled by each.
    """
    from numba.core import event

    from adaptsize._kernels.topology import mark_nodes

    class Counter(event.Listener):
        count = 0

        def on_start(self, _event: event.Event) -> None:
            self.count += 1

        def on_end(self, _event: event.Event) -> None:
            pass

    began, counter = time.perf_counter(), Counter()
    with warnings.catch_warnings(), event.install_listener("numba:compile", counter):
        warnings.simplefilter("ignore")  # of inputs much too coarse
        _TASKS[name]()
    cache = str(mark_nodes.stats.cache_path) if hasattr(mark_nodes, "stats") else ""
    return counter.count, time.perf_counter() - began, cache


def _limiting(dim: int) -> None:
    """Limit on triangles or tetrahedra, with and without obstacles, and measure quality."""
    import numpy as np

    import adaptsize as ads

    whole = ads.CartesianGrid([0.0] * dim, 1.0, (5,) * dim).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    for mesh in (whole, ads.SimplexMesh(whole.points, whole.cells[~(middle > 2.0).all(axis=1)])):
        few = np.full(mesh.n_points, np.inf)
        few[0] = 0.1
        for h0 in (few, 0.1 + 2.0 * np.random.default_rng(1).random(mesh.n_points)):
            _, info = ads.limit_gradient.with_info(mesh, h0, 0.3)
            _ = info.largest_edge_slope, info.cell_gradient_quantiles
        ads.limit_gradient(mesh, few, 0.3, method="fast-marching")
        size = ads.size_function(mesh) if dim == 2 else np.ones(mesh.n_points)
        ads.size_conformity(mesh, size)


def _surface() -> None:
    """Make the size function of a surface, and compare a volume with bodies that overlap."""
    import numpy as np

    import adaptsize as ads
    from adaptsize.background.flipping import flip_edges

    box = ads.CartesianGrid([0.0] * 3, (2.0, 1.0, 1.0), (2, 2, 2)).mesh
    part = box.boundary().mesh
    size = ads.size_function(part, sources=ads.PointSource([0.0, 0.0, 0.0], 0.1))
    size(part.points)
    flip_edges(part, np.empty((0, 2), np.int32))
    ads.size_conformity(part, size, surface=part)
    ads.limit_gradient(part, 0.5, 0.25, point_sources=([[0.5, 0.5, 0.0]], [0.1]))
    _ = ads.CartesianGrid([0.0] * 3, 1.0, (9, 9, 9)).mesh.edges  # as large meshes find them
    points = np.concatenate([part.points, part.points + 0.5])
    both = ads.SimplexMesh(points, np.concatenate([part.cells, part.cells + part.n_points]))
    ads.check_mesh(box, original=both)


def _image(dim: int) -> None:
    """Mesh a disc or a ball of pixels."""
    import numpy as np

    import adaptsize as ads

    axes = np.meshgrid(*[np.arange(-12.0, 13.0)] * dim, indexing="ij")
    ads.mesh_image(np.linalg.norm(axes, axis=0) < 9.0, hmin=4.0, hmax=4.0)


def _through_solids() -> None:
    """Limit sizes on a surface through the solid inside, and find distances and widths in it."""
    import numpy as np

    import adaptsize as ads
    from adaptsize._defaults import CREASE_ANGLE
    from adaptsize._workers import Workers
    from adaptsize.domain_size.on_surface import SurfaceDomain
    from adaptsize.limiting.inside import limit_inside

    whole = ads.CartesianGrid([0.0] * 3, 1.0, (4, 4, 2)).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    mesh = ads.SimplexMesh(whole.points, whole.cells[~(middle[:, :2] > 1.0).all(axis=1)])
    skin = mesh.boundary().mesh
    solid = SurfaceDomain(skin, np.arange(skin.n_points), False, CREASE_ANGLE)
    bound = np.full(skin.n_points, 9.0)
    # At the end of one leg, which the other leg does not see.
    bound[np.lexsort((-skin.points[:, 0], *skin.points.T[1:]))[0]] = 0.1
    within = solid.inside, solid.inside.normals
    limit_inside(skin, within, bound, (skin.points[:1], bound[:1]), (), 0.2, Workers(1))
    skin.locator.weights(skin.points)
    _ = solid.first_separations, solid.first_samples


def _worst_cells() -> None:
    """Repair tetrahedra that are flat."""
    import adaptsize as ads
    from adaptsize.remeshing.boundary_repair import repaired

    mesh = ads.CartesianGrid([0.0] * 3, 1.0, (3, 3, 3)).mesh
    points = mesh.points.copy()
    points[len(points) // 2, 0] = 0.05  # the node in the middle
    repaired(mesh.moved(points), mesh, 0.1)


def _distances() -> None:
    """Measure the distance of a surface from another."""
    import adaptsize as ads
    from adaptsize.quality.boundary import distances_from

    skin = ads.CartesianGrid([0.0] * 3, 1.0, (3, 3, 3)).mesh.boundary().mesh
    distances_from(skin, skin.moved(1.1 * skin.points))


#: What `remesh` compiles last, in its order but for what takes longest.
_LAST = (_through_solids, _worst_cells, _distances)
_TASKS: dict[str, Callable[[], None]] = {
    "worst cells": _worst_cells,
    "surfaces": _surface,
    "tetrahedra": partial(_limiting, 3),
    "triangles": partial(_limiting, 2),
    "volumes of voxels": partial(_image, 3),
    "pictures": partial(_image, 2),
}
