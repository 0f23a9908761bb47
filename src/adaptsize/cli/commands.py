"""The commands.  Each reads files, calls one function of the library, writes and prints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

import adaptsize as ads
from adaptsize._checks import refusal, refuse_where
from adaptsize._defaults import GRADIENT_LIMIT, METRIC_GRADIENT_LIMIT, TOLERANCE
from adaptsize._messages import Message
from adaptsize._records import description, how_made, is_stale, record_of
from adaptsize.cli import files
from adaptsize.cli.again import again
from adaptsize.cli.command import GroupedCommand, command
from adaptsize.cli.console import Console
from adaptsize.cli.metric import limit_with_metric
from adaptsize.cli.options import (
    FACES,
    FIELD,
    METRIC,
    OF_POLYGONS,
    ORDER,
    PERIODIC,
    PLOT,
    READING,
    REPORT,
    SOURCE,
    Given,
    Input,
    MeshOutput,
    SizesOutput,
    of_library,
    own,
    reading,
)
from adaptsize.cli.remesh import remesh
from adaptsize.cli.size import exit_code, image, size
from adaptsize.cli.warmup import announce_compilation, warmup
from adaptsize.errors import OptionError
from adaptsize.options import (
    AdaptOptions,
    FamilyOptions,
    RemeshOptions,
    TransferOptions,
    options_of,
)
from adaptsize.options.sizes import SizeOptions
from adaptsize.typing import FloatArray, NodalMethod

if TYPE_CHECKING:
    import numpy.typing as npt

    from adaptsize.background import SimplexMesh

app = typer.Typer(
    name="adaptsize",
    epilog="With --debug, an error shows its traceback.  Results go to standard output, "
    "messages to standard error.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"adaptsize {ads.__version__}")
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Mesh size functions with gradient limiting.

    For example, "adaptsize remesh part.stl -o part.vtu" fills a surface with graded tetrahedra.
    "adaptsize COMMAND -h" lists the options of a command.
    """
    announce_compilation(context.obj, context.invoked_subcommand)


@command(
    replace(FACES, text="List the faces of a surface: area, curvature and box."),
    *READING,
    *OF_POLYGONS,
)
def info(console: Console, file: Input, given: Given) -> int:
    """Summarize a mesh: cells, extent, tags, fields, quality."""
    from adaptsize.geometry.face_table import summarize_faces, table_of_faces
    from adaptsize.quality.connections import unconnected
    from adaptsize.quality.summary import summarize

    with console.steps(2) as steps:
        steps.begin("reading")
        mesh = files.read_mesh(file, **reading(given))
        faces = summarize_faces(files.with_named_faces(mesh)) if given.get("faces") else []
        steps.begin("checks")
        summary = summarize(mesh)
    not_joined = [str(found) for found in unconnected(mesh)]
    made = record_of(file)
    if is_stale(file):
        console.say(f"{file.name}.json is the record of another content, or damaged: not used")
    if made:
        console.record(made=made)
        console.say(description(made))
        if how_made(made):
            console.say(f"by {how_made(made)}")
        for text in made.get("unknown", []):
            console.say(f"it cannot be made again: {text}")
    console.record(**summary.as_dict(), not_joined=not_joined)
    console.print(summary)
    if faces:
        listed = [asdict(f) | {"low": f.low.tolist(), "high": f.high.tolist()} for f in faces]
        console.record(faces=listed)
        console.print(table_of_faces(faces))
    for text in not_joined:
        console.warn(text)
    return 0


@command(
    own("Checks", "original", Path, "Mesh or surface whose domain the mesh must fill."),
    own("Checks", "field", str, "Nodal field with the sizes.", chosen="h, if present"),
    *READING,
    *OF_POLYGONS,
    replace(options_of(RemeshOptions)["tolerance"], group="Checks"),
    REPORT,
)
def check(console: Console, file: Input, given: Given) -> int:
    """Check a mesh: validity, domain, conformity with its sizes.

    The exit code is 1 if a requirement is missed by more than 10 % of its limit.  The worst places
    are listed.  The tolerance is that with which remesh made the mesh, unless another one is given.
    """
    from adaptsize.remeshing.preparation import repair_mesh
    from adaptsize.reporting.outcome import Outcome, conformity_beside, kind_of

    own_names = ("original", "field", "report")
    original, field, page = map(given.get, own_names)
    files.check_files([file, original], None, "mesh", report=page)
    options = of_library(given, *own_names)
    with console.steps(2) as steps:
        steps.begin("reading")
        mesh = files.read_mesh(file, **reading(given))
        made = record_of(file)
        if made.get("n_cells") == mesh.n_cells and isinstance(made.get("tolerance"), float):
            options = {"tolerance": made["tolerance"]} | options
            console.say(f"{description(made)} with the tolerance {made['tolerance']:.3g}")
        other = None if original is None else repair_mesh(files.read_mesh(original)).mesh
        if other is not None and made.get("n_cells") == mesh.n_cells:
            other = files.without_details(console, other, made.get("options", {}))
        if field is None and "h" in mesh.point_data:
            field = "h"
        sizes = None if field is None else files.nodal_field(mesh, field)
        steps.begin("checks")
        found = ads.check_mesh(mesh, original=other, size=sizes, **options)
        if sizes is not None:
            conformity = conformity_beside(found, mesh, sizes, other)
        size = None if sizes is None else ads.SizeFunction(mesh, sizes)
        outcome = None
        if sizes is not None:
            tolerance = options.get("tolerance", TOLERANCE)
            outcome = Outcome(kind_of(mesh), conformity, found, tolerance=tolerance)
        files.write_report(console, page, file, mesh, size, outcome, found)
    console.record(**found.as_dict())
    if sizes is not None:
        console.record(**conformity.as_dict())
        console.print(conformity)
    console.print(found)
    return exit_code(found)


@command(
    replace(
        options_of(SizeOptions)["g"],
        chosen=f"{GRADIENT_LIMIT:g}, {METRIC_GRADIENT_LIMIT:g} of metrics",
    ),
    replace(FIELD, text="Nodal field with the upper bounds."),
    METRIC,
    own(
        "Sizes", "method", str, default="auto",
        text="auto, or a method of limit_gradient, such as fast-marching.",
    ),
    PLOT,
)  # fmt: skip
def limit(console: Console, file: Input, output: SizesOutput, given: Given) -> int:
    """Limit the gradient of a nodal field.  The result is written as the field h, or metric.

    Of the exact method, the field source holds the node from which each size originates.
    """
    if ("field" in given) == ("metric" in given):
        got = "both" if "field" in given else "neither"
        raise OptionError(Message("{field} or {metric} must be given, got {}", got))
    if "metric" in given:
        return limit_with_metric(console, file, output, given)
    g, plot = given.get("g", GRADIENT_LIMIT), given.get("plot")
    files.check_files([file], output, "sizes", plot=plot)
    with console.steps(3) as steps:
        steps.begin("reading")
        mesh: SimplexMesh = ads.io.read(file)
        files.format_of(output).check_cells(output, mesh)
        h0 = files.nodal_field(mesh, given["field"])
        steps.begin("limiting")
        method = given.get("method", "auto")
        h, found = ads.limit_gradient.with_info(mesh, h0, g, method=method, progress=steps.report)
        steps.begin("writing")
        fields: dict[str, npt.ArrayLike] = {"h": h}
        if found.sources is not None and "fields" in files.format_of(output).holds:
            fields["source"] = found.sources.roots()
        files.write_result(console, output, mesh, fields)
        files.draw(console, "size", plot, mesh, h)
    quantiles = found.cell_gradient_quantiles
    console.record(
        method=found.method,
        g=g,
        n_points=mesh.n_points,
        n_lowered=found.n_changed,
        largest_edge_slope=found.largest_edge_slope,
        cell_gradient_quantiles=quantiles,
    )
    levels = ", ".join(f"{share:g}: {q:.3f}" for share, q in quantiles.items())
    console.print(f"{found.method}: {found.n_changed} of {mesh.n_points} nodes lowered")
    console.print(f"largest slope along an edge over g: {found.largest_edge_slope:.6f}")
    console.print(f"gradient in the cells over g, quantiles: {levels}")
    return 0


_VALUES = own(
    "Mesh family", "values", str,
    "Numbers computed on meshes that this command has written, such as 1.31,1.22,1.19, the "
    "coarsest first.  Prints their order of convergence; makes no meshes.",
)  # fmt: skip


@command(FamilyOptions, SOURCE, ORDER, *READING, *OF_POLYGONS, _VALUES)
def family(console: Console, file: Input, output: MeshOutput, given: Given) -> int:
    """Make self-similar meshes for a convergence study: NAME-1.vtu is the coarsest.

    Options of the sizes are for the coarsest mesh.  From one mesh to the next, all bounds on the
    size and the gradient limit are divided by the ratio.
    """
    from adaptsize.domain_size.family import Convergence, mean_cell_size

    values, order = given.get("values"), given.get("order", 1)
    numbers = [] if values is None else _numbers(values)
    levels = given.get("levels", options_of(FamilyOptions)["levels"].default)
    paths = [
        output.with_name(f"{output.stem}-{level}{output.suffix}")
        for level in range(1, (len(numbers) or levels) + 1)
    ]
    if numbers:
        found = [mean_cell_size(files.read_mesh(path)) for path in paths]
        result = Convergence.of(found, numbers)
        console.record(mean_sizes=found, values=numbers, **vars(result))
        console.print(result)
        return 0
    for path in paths:
        files.check_files([file], path, "mesh", order)
    with console.steps(3) as steps:
        steps.begin("reading")
        mesh = files.read_mesh(file, **reading(given))
        mesh = files.with_faces(mesh) if files.by_faces(given) else mesh
        steps.begin("meshing")
        options = of_library(given, "values", "order")
        made = ads.mesh_family(mesh, **options, progress=steps.report)
        steps.begin("writing")
        for path, new, h in zip(paths, made.meshes, made.sizes, strict=True):
            sized = new.with_data(point_data={"h": h(new.points)})
            files.write_result(console, path, sized, order=order)
    sizes = made.mean_sizes.tolist()
    console.record(mean_sizes=sizes, ratios=made.ratios.tolist())
    console.print("mean sizes  " + ", ".join(f"{h:.5g}" for h in sizes))
    console.print("ratios      " + ", ".join(f"{ratio:.4g}" for ratio in made.ratios))
    return 0


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise refusal("values", f"must be numbers such as 1.31,1.22,1.19, got {text!r}") from error


@command(
    replace(
        FIELD,
        default=...,
        group="Adaptation",
        text="Cell field with the error of each cell; or nodal field with the solution, whose "
        "error is then estimated by its recovered gradient (Zienkiewicz-Zhu).",
    ),
    AdaptOptions,
    options_of(SizeOptions)["g"],
    replace(options_of(TransferOptions)["method"], type=NodalMethod),
    PERIODIC,
    *READING,
    PLOT,
    REPORT,
    without="conservative corner_angle anisotropic norm max_aspect how rounds",
)
def adapt(console: Console, file: Input, output: MeshOutput, given: Given) -> int:
    """Make the next mesh of an adaptive loop.

    Its sizes come from an error indicator or a solution.  Fields and tags of the file are
    transferred.  A mesh that already has the sizes is written unchanged.
    """
    from adaptsize.reporting.outcome import Outcome, kind_of

    field, plot, page = given["field"], given.get("plot"), given.get("report")
    files.check_files([file], output, "mesh", plot=plot, report=page)
    if not given.keys() & {"elements", "nodes", "tolerance"}:
        text = "{elements}, {nodes} or {tolerance} must be given, got none of them"
        raise OptionError(Message(text))
    with console.steps(4) as steps:
        steps.begin("reading")
        mesh = ads.io.read(file, errors=field, **reading(given))
        indicator = indicator_of(mesh, field)
        steps.begin("adapting")
        result = ads.adapt(
            mesh,
            indicator,
            fields=carried(console, mesh.point_data, "h"),  # which is replaced
            cell_fields=carried(console, mesh.cell_data, field),
            conservative=mesh.cell_dim == mesh.dim,
            progress=steps.report,
            **of_library(given, "field", "plot", "report"),
        )
        steps.begin("writing")
        new = result.mesh
        report = result.report
        fields = {**result.fields, "h": result.size(new.points)}
        new = new.with_data(point_data=fields, cell_data=result.cell_fields)
        files.write_result(console, output, new)
        files.draw(console, "size", plot, new)
        if page is not None:
            tolerance = given.get("boundary_tolerance", TOLERANCE)
            found = ads.check_mesh(new, original=mesh, size=result.size, tolerance=tolerance)
            outcome = Outcome(kind_of(new), report.after, found, tolerance=tolerance)
            files.write_report(console, page, file, new, result.size, outcome, found)
    of_mesh = {
        "share_in_band": report.after.share_in_band,
        "boundary_distance": report.boundary_distance,
    }
    console.record(
        remeshed=result.remeshed,
        converged=result.converged,
        reason=result.reason,
        error=report.error,
        budget_met=report.budget_met,
        n_elements=report.predicted_elements,
        mesh=report.after.as_dict() | of_mesh,
        lost_tags=report.lost_tags,
    )
    console.print(f"{result.reason}\n{report}")
    return 0


def carried(
    console: Console, fields: Mapping[str, FloatArray], apart: str
) -> dict[str, FloatArray]:
    """Return the fields that are transferred, but one; warn of those that cannot be."""
    found = {}
    for name, values in fields.items():
        if name == apart:
            continue
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            console.warn(f"field {name!r} is left out: {bad} of its values are not finite")
        else:
            found[name] = values
    return found


def indicator_of(mesh: SimplexMesh, name: str) -> FloatArray:
    """Return the error of each cell: a cell field, or estimated from a nodal field.

    Raises
    ------
    ValueError
        If there is no field of that name, or one of each kind.
    """
    at_nodes, in_cells = name in mesh.point_data, name in mesh.cell_data
    if at_nodes and in_cells:
        raise ValueError(f"{name!r} is a nodal field and a cell field of the mesh: rename one")
    for fields in (mesh.point_data, mesh.cell_data):
        values = fields.get(name, np.zeros(0))
        refuse_where(f"field {name!r}", ~np.isfinite(values), values, "must be finite")
    if in_cells:
        return mesh.cell_data[name].reshape(mesh.n_cells, -1).squeeze(axis=1)
    if not at_nodes:
        listed = ", ".join([*mesh.cell_data, *mesh.point_data]) or "none"
        raise refusal("field", f"must be a field of the mesh ({listed}), got {name!r}")
    indicator: FloatArray = ads.zz_indicator(mesh, files.nodal_field(mesh, name))
    return indicator


for function in (info, size, limit, remesh, family, adapt, image, check, again, warmup):
    app.command(cls=GroupedCommand)(function)
