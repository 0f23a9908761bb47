"""The option ``--metric`` of ``limit`` and ``remesh``: sizes that depend on the direction."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import adaptsize as ads
from adaptsize._defaults import METRIC_GRADIENT_LIMIT
from adaptsize._messages import Message
from adaptsize.cli import files
from adaptsize.cli.console import Console
from adaptsize.cli.options import Given
from adaptsize.cli.transfer import with_fields
from adaptsize.errors import OptionError
from adaptsize.options import options_of
from adaptsize.options.meshes import MeshOptions

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.metrics import Metric, MetricFunction

#: Options of ``remesh`` that are passed on to the mesh generators.
_OF_MESHING = {"tolerance", "max_elements", *options_of(MeshOptions)}


def _check(file: Path, output: Path, given: Given, allowed: set[str]) -> None:
    """Refuse what has no meaning for metrics, and files that cannot be read or written."""
    refused = [name for name in given if name not in allowed | {"metric", "g", "plot"}]
    if refused:
        names = Message.joined(", ", map(Message.name, refused))
        raise OptionError(Message("{metric} does not go with {}", names))
    if files.beside(output) is None and "metrics" not in files.format_of(output).holds:
        text = f"{output.name} cannot hold a metric; write .vtu, .sol or .pos"
        raise OptionError(text, ["output"])
    metric = Path(given["metric"])
    other = metric if metric.suffix.lower() == ".sol" else None
    content: files.Content = "sizes" if files.beside(output) is None else "mesh"
    files.check_files([file, other], output, content, plot=given.get("plot"))


def _read(file: Path, given: Given) -> tuple[SimplexMesh, Metric]:
    """Return the mesh in a file and the metric at its nodes, within limits of the sizes."""
    from adaptsize._formats.sizes import metric_in

    mesh, metric = files.read_mesh(file), given["metric"]
    if Path(metric).suffix.lower() == ".sol":
        found: Metric = ads.io.read_metric(metric)
        found.check_mesh(mesh)
    else:
        values = files.field_of(mesh, metric, "metric")
        try:
            found = metric_in(values, mesh.dim)
        except ValueError as error:
            raise ValueError(f"field {metric!r}: {error}") from error
    limits = {name: given[name] for name in ("hmin", "hmax") if name in given}
    return mesh, found.clip(**limits) if limits else found


def limit_with_metric(console: Console, file: Path, output: Path, given: Given) -> int:
    """Limit the gradient of a metric and write it as the field metric."""
    _check(file, output, given, set())
    g = given.get("g", METRIC_GRADIENT_LIMIT)
    with console.steps(3) as steps:
        steps.begin("reading")
        mesh, metric = _read(file, given)
        files.format_of(output).check_cells(output, mesh)
        steps.begin("limiting")
        limited, found = ads.limit_metric.with_info(mesh, metric, g, progress=steps.report)
        steps.begin("writing")
        function = ads.MetricFunction(mesh, limited)
        files.write_result(console, output, function)
        files.draw(console, "metric", given.get("plot"), function)
    lowered = int((~found.kept).sum())
    console.record(g=g, n_points=mesh.n_points, n_lowered=lowered, metric=_summary(function))
    console.print(f"{lowered} of {mesh.n_points} nodes lowered")
    console.print(f"{limited!r}, complexity {limited.complexity(mesh):.4g}")
    return 0


def remesh_with_metric(console: Console, file: Path, output: Path, given: Given) -> int:
    """Make a mesh with the sizes of a metric whose gradient is limited first."""
    from adaptsize.remeshing.driver import remeshed

    _check(file, output, given, _OF_MESHING | {"hmin", "hmax", "fields"})
    g, fields = given.get("g", METRIC_GRADIENT_LIMIT), given.get("fields", "all")
    with console.steps(5) as steps:
        steps.begin("reading")
        mesh, metric = _read(file, given)
        steps.begin("sizes")
        metric = ads.limit_metric(mesh, metric, g, progress=steps.report)
        limited = ads.MetricFunction(mesh, metric)
        options = {name: given[name] for name in _OF_MESHING & given.keys()}
        following = steps.following()
        made = remeshed(mesh.without_data(), limited, progress=following, **options)
        steps.begin("writing")
        new = with_fields(console, mesh, made.mesh, output, (fields, given["metric"]), steps.report)
        function = ads.MetricFunction(new, limited(new.points))
        files.write_result(console, output, function)
        steps.begin("checks")
        conformity = ads.size_conformity(new, limited)
        files.draw(console, "metric", given.get("plot"), function)
    console.record(g=g, mesh=conformity.as_dict(), metric=_summary(function))
    console.print(conformity)
    return int(made.attempts.is_cut_short)


def _summary(function: MetricFunction) -> dict[str, float]:
    """Return the range of the sizes, the largest aspect ratio and the complexity."""
    metric = function.metric
    return {
        "hmin": float(metric.sizes.min()),
        "hmax": float(metric.sizes.max()),
        "aspect_ratio_max": float(metric.aspect_ratio.max()),
        "complexity": float(metric.complexity(function.mesh)),
    }
