"""The option ``--metric`` of ``limit`` and ``remesh``: sizes that depend on the direction."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsize._defaults import METRIC_GRADIENT_LIMIT
from adaptsize.cli.console import Console
from adaptsize.cli.files import beside, check_cells, check_files
from adaptsize.cli.output import contents, draw_metric, print_written

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.cli.files import Content
    from adaptsize.cli.remesh_options import Options
    from adaptsize.metrics import Metric, MetricFunction

_FILES = (".sol", ".solb")
#: Options of ``remesh`` that are passed on to the mesh generators, and all that it takes.
_OF_MESHING = "target backend tolerance max_elements timeout strict"
_OF_REMESH = f"file output metric gradient hmin hmax plot mpi {_OF_MESHING}"


def check_metric_options(
    file: Path, metric: str, refused: Mapping[str, bool], output: Path, plot: Path | None
) -> None:
    """Refuse what has no meaning for metrics, and files that cannot be read or written.

    Parameters
    ----------
    file, metric : Path, str
        The mesh; the name of the field, or a ``.sol`` or ``.solb``.
    refused : mapping of str to bool
        Options, and whether they are given.
    output, plot : Path, Path or None
    """
    from adaptsize._formats.writers import format_of

    given = [option for option, is_given in refused.items() if is_given]
    if given:
        raise ValueError(f"--metric does not go with {', '.join(given)}")
    if not format_of(output, None).holds_metrics:
        raise ValueError(f"{output.name} cannot hold a metric; write .vtu, .sol or .pos")
    other = Path(metric) if Path(metric).suffix.lower() in _FILES else None
    content: Content = "mesh" if beside(output) is not None else "sizes"
    check_files([file, other], {"--output": (output, content), "--plot": (plot, "picture")})


def read_with_metric(
    file: Path, metric: str, hmin: float | None = None, hmax: float | None = None
) -> tuple[SimplexMesh, Metric]:
    """Return the mesh in a file and the metric at its nodes, within limits of the sizes."""
    from adaptsize._formats.sizes import metric_in
    from adaptsize.cli.files import read_mesh
    from adaptsize.io import read_metric

    mesh = read_mesh(file)
    if Path(metric).suffix.lower() in _FILES:
        found = read_metric(metric)
        found.check_mesh(mesh)
    elif metric in mesh.point_data:
        try:
            found = metric_in(mesh.point_data[metric], mesh.dim)
        except ValueError as error:
            raise ValueError(f"field {metric!r}: {error}") from error
    else:
        listed = ", ".join(mesh.point_data) or "none"
        raise ValueError(f"the mesh has no nodal field {metric!r}; it has: {listed}")
    limits = {name: h for name, h in (("hmin", hmin), ("hmax", hmax)) if h is not None}
    return mesh, found.clip(**limits) if limits else found


def limit_with_metric(
    console: Console, file: Path, output: Path, metric: str, g: float, plot: Path | None
) -> None:
    """Limit the gradient of a metric and write it as the field metric."""
    from adaptsize.metrics import MetricFunction, limit_metric

    with console.steps(3) as steps:
        steps.begin("reading")
        mesh, given = read_with_metric(file, metric)
        check_cells(output, mesh)
        steps.begin("limiting")
        limited, found = limit_metric.with_info(mesh, given, g, progress=steps.report)
        steps.begin("writing")
        function = MetricFunction(mesh, limited)
        written = _write(output, function)
        draw_metric(console, plot, function)
    lowered = int((~found.kept).sum())
    console.record(
        input=str(file), g=g, n_points=mesh.n_points, n_lowered=lowered, metric=_summary(function)
    )
    console.print(f"{lowered} of {mesh.n_points} nodes lowered")
    console.print(f"{limited!r}, complexity {limited.complexity(mesh):.4g}")
    for held in written:
        print_written(console, held)


def remesh_with_metric(console: Console, options: Options) -> None:
    """Make a mesh with the sizes of a metric whose gradient is limited first."""
    from adaptsize import remeshing
    from adaptsize.metrics import MetricFunction, limit_metric
    from adaptsize.quality import size_conformity

    file, output, metric = options.file, options.output, str(options.metric)
    g = METRIC_GRADIENT_LIMIT if options.gradient is None else options.gradient
    refused = options.besides(_OF_REMESH) | {"--mpi": options.mpi or console.world is not None}
    check_metric_options(file, metric, refused, output, options.plot)
    with console.steps(5) as steps:
        steps.begin("reading")
        mesh, given = read_with_metric(file, metric, options.hmin, options.hmax)
        steps.begin("sizes")
        limited = MetricFunction(mesh, limit_metric(mesh, given, g, progress=steps.report))
        new = remeshing.remesh(
            mesh, limited, progress=steps.following(lambda text: text), **options.given(_OF_MESHING)
        )
        steps.begin("writing")
        function = MetricFunction(new, limited(new.points))
        written = _write(output, function)
        steps.begin("checks")
        conformity = size_conformity(new, limited)
        draw_metric(console, options.plot, function)
    console.record(input=str(file), g=g, mesh=conformity.as_dict(), metric=_summary(function))
    console.print(conformity)
    for held in written:
        print_written(console, held)


def _write(path: Path, function: MetricFunction) -> list[dict[str, Any]]:
    """Write a metric on its mesh, and return what is in the files; a .mesh has a .sol beside it."""
    from adaptsize._formats.sizes import fields_of
    from adaptsize.io import write

    sizes = beside(path)
    if sizes is None:
        write(path, function)
        return [contents(path, function.mesh, tuple(fields_of(function.metric)))]
    write(path, function.mesh)
    write(sizes, function)
    return [contents(path, function.mesh), contents(sizes, function.mesh) | {"fields": ["metric"]}]


def _summary(function: MetricFunction) -> dict[str, float]:
    """Return the range of the sizes, the largest aspect ratio and the complexity."""
    metric = function.metric
    return {
        "hmin": float(metric.sizes.min()),
        "hmax": float(metric.sizes.max()),
        "aspect_ratio_max": float(metric.aspect_ratio.max()),
        "complexity": float(metric.complexity(function.mesh)),
    }
