"""``adaptsize size`` and ``image``: the size function of a domain, and the mesh of an image."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import adaptsize as ads
from adaptsize._checks import as_number, refusal
from adaptsize._messages import Message
from adaptsize.cli import files
from adaptsize.cli.command import command
from adaptsize.cli.console import Console, print_message
from adaptsize.cli.options import (
    FIELD,
    OF_POLYGONS,
    ORDER,
    PLOT,
    READING,
    REPORT,
    SOURCE,
    AnyFile,
    Given,
    ImageFile,
    MeshOutput,
    SizesOutput,
    of_library,
    own,
    reading,
)
from adaptsize.errors import OptionError
from adaptsize.options import ImageMeshOptions, SizeFunctionOptions, checked, options_of
from adaptsize.options.checking import refuse_unused
from adaptsize.options.sizes import ImageOptions

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize._size_report import SizeReport
    from adaptsize.background import SimplexMesh
    from adaptsize.quality.certificate import MeshCheck
    from adaptsize.reporting.outcome import Outcome

_COST = own("Output", "cost", bool, "Also print unknowns, matrix and smallest places.")
_PARTS = own("Output", "parts", bool, "Also print width, curvature, size and cost of each part.")
_SPEED = own("Output", "speed", float, "Largest speed of a signal, for the time steps.")
_CAUSES = own("Output", "plot_causes", Path, "Also draw which cause controls which part (.png).")
#: Options of the command itself that apply to meshes.
_OF_MESHES = ("field", "tags", "keep_slits", "least_width", "box", "parts")


@command(
    SizeFunctionOptions, SOURCE, FIELD, *READING, *OF_POLYGONS, PLOT, _CAUSES, _COST, _PARTS, _SPEED
)
def size(console: Console, file: AnyFile, output: SizesOutput, given: Given) -> int:
    """Compute the size function of a mesh or an image.

    Sizes come from curvature, narrow regions and sources, and their gradient is limited.  The field
    h holds them, and the field cause what controls each.  The sizes of an image are on the grid of
    its pixels: write .vti.
    """
    from adaptsize._formats.raster import is_image_file
    from adaptsize.domain_size.reports import report_of

    of_image = is_image_file(file)
    plot, plot_causes = given.get("plot"), given.get("plot_causes")
    of_cost = {name: given[name] for name in ("cost", "parts", "speed") if name in given}
    options = of_library(given, "plot", "plot_causes", *of_cost)
    as_number("speed", of_cost.get("speed", 1.0), lower=0.0, strict=True)
    if "speed" in of_cost and len(of_cost) == 1:
        raise OptionError(Message("{speed} has no effect without {cost} or {parts}"))
    content: files.Content = "sizes of an image" if of_image else "sizes"
    files.check_files([file], output, content, plot=plot, plot_causes=plot_causes)
    refuse_unused("images" if of_image else "meshes", options, str(file))
    for name in _OF_MESHES if of_image else ():
        if name in given:
            raise refusal(name, f"applies to meshes, got it with {file}")
    with console.steps(3) as steps:
        steps.begin("reading")
        domain: Any
        if of_image:
            domain = ads.io.read_image(file)
        else:
            by_faces = "parts" in of_cost or files.by_faces(given)
            domain = _read(console, file, output, reading(given), by_faces=by_faces)
        if "field" in given:
            options = bounded(domain, {"tolerance": math.inf} | options)
        steps.begin("sizes")
        found = ads.size_function(domain, progress=steps.report, **options)
        report = report_of(found)
        console.say(f"sizes: {report.choices}")
        steps.begin("writing")
        holds_fields = "fields" in files.format_of(output).holds
        fields = {"cause": report.cause_codes()} if holds_fields else {}
        files.write_result(console, output, found, fields)
        files.draw(console, "size", plot, found)
        files.draw(console, "causes", plot_causes, report)
    console.record(size=as_dict(report))
    console.print(report)
    if fields:
        from adaptsize._size_report import CODES

        names = ", ".join(
            f"{CODES[name]} {name}" for name in sorted(report.causes, key=CODES.__getitem__)
        )
        console.print(f"field cause: {names}")
    _print_costs(console, found, of_cost, options)
    return 0


def _print_costs(console: Console, size: SizeFunction, of_cost: Given, options: Given) -> None:
    """Print what the mesh costs, as a whole and by its parts, as far as that is requested."""
    from adaptsize.domain_size.parts import table_of

    speed = {name: of_cost[name] for name in ("speed",) if name in of_cost}
    if "cost" in of_cost:
        unknowns = {name: options[name] for name in ("degree", "components") if name in options}
        cost = size.cost(**unknowns, **speed)
        console.record(cost=asdict(cost))
        console.print(cost)
    if "parts" in of_cost:
        parts = size.parts(**speed)
        console.record(parts=[asdict(part) for part in parts])
        console.print(table_of(parts))


def _read(
    console: Console, file: Path, output: Path, of_reading: Given, *, by_faces: bool
) -> SimplexMesh:
    """Return the mesh in a file, if its sizes can be written; of a surface the faces tagged."""
    mesh = files.read_mesh(file, **of_reading)
    files.format_of(output).check_cells(output, mesh)
    files.announce_sizes(console, mesh)
    return files.with_faces(mesh) if by_faces else mesh


def bounded(mesh: SimplexMesh, options: Given) -> dict[str, Any]:
    """Return options with the nodal field as upper bounds, if one is named.

    Curvature, width and separation are off then unless they are requested.
    """
    if "field" not in options:
        return dict(options)
    off = {"elements_per_radian": 0.0, "elements_across": 0.0, "elements_between": 0.0}
    others = {name: value for name, value in options.items() if name != "field"}
    return off | {"h0": files.nodal_field(mesh, options["field"])} | others


def as_dict(report: SizeReport) -> dict[str, Any]:
    """Return the parameters, sizes and causes of a size function, for the JSON object."""
    from adaptsize._size_report import CODES

    causes = [
        {
            "code": CODES[name],
            "name": name,
            "domain_share": report.domain_shares[name],
            "element_share": report.element_shares[name],
            "smallest": report.smallest[name],
        }
        for name in report.causes
    ]
    before = "elements_per_radian elements_across elements_between is_rough g hmin hmax relaxation"
    values = {name: getattr(report, name) for name in before.split()}
    after = {name: getattr(report, name) for name in ("largest", "n_elements", "n_nodes")}
    return values | {"smallest": min(report.smallest.values())} | after | {"causes": causes}


def print_outcome(console: Console, outcome: Outcome, *lines: str) -> int:
    """Print how good a new mesh is and what is out of bounds, and return the exit code.

    A quiet command prints why the exit code is 1.
    """
    console.record(mesh=outcome.as_dict())
    for line in (outcome, *lines):
        console.print(line)
    for text in outcome.warnings():
        console.warn(text)
    if console.quiet and outcome.check.missed:
        names = ", ".join(requirement.name for requirement in outcome.check.missed)
        print_message(f"error: the mesh does not pass adaptsize check: {names}")
    if console.quiet and outcome.over_cap is not None:
        print_message(f"error: {outcome.over_cap}")
    return int(outcome.status == "missed")


def exit_code(check: MeshCheck) -> int:
    """Return 1 if a requirement is missed, and 0 if all are met or near."""
    return int(check.status == "missed")


@command(ImageMeshOptions, SOURCE, ORDER, PLOT, REPORT)
def image(console: Console, file: ImageFile, output: MeshOutput, given: Given) -> int:
    """Mesh the objects in a mask or label image.

    A picture gives triangles, a volume gives tetrahedra.  Sizes come from the curvature of the
    boundaries of the objects and from their width.  Labels become the regions of the mesh.
    """
    from adaptsize.reporting.outcome import outcome_of_image

    plot, page, order = given.get("plot"), given.get("report"), given.get("order", 1)
    options = of_library(given, "plot", "report", "order")
    files.check_files([file], output, "mesh", order, plot=plot, report=page)
    with console.steps(5) as steps:
        steps.begin("reading")
        pixels = ads.io.read_image(file)
        steps.begin("sizes")
        following = steps.following()
        mesh = ads.mesh_image(pixels, **options, progress=following)
        steps.begin("writing")
        files.write_result(console, output, mesh, order=order)
        steps.begin("checks")
        chosen = {name: given[name] for name in options_of(ImageOptions) if name in given}
        outcome = outcome_of_image(mesh, pixels, checked(ImageOptions, chosen))
        files.draw(console, "size", plot, mesh)
        size = ads.SizeFunction(mesh, mesh.point_data["h"])
        files.write_report(console, page, file, mesh, size, outcome, outcome.check)
    return print_outcome(console, outcome)
