"""``adaptsize size`` and ``image``: the size function of a domain, and the mesh of an image."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from adaptsize._checks import as_number
from adaptsize.cli.console import Console
from adaptsize.cli.files import (
    Content,
    announce_memory_of_sizes,
    check_cells,
    check_files,
    draw,
    holds_more_than_sizes,
    nodal_field,
    print_written,
    read_mesh,
    write_mesh,
    write_sizes,
)
from adaptsize.cli.options import (
    FIELD,
    PLOT,
    SOURCE,
    AnyFile,
    Given,
    ImageFile,
    MeshOutput,
    SizesOutput,
    command,
    own,
)
from adaptsize.cli.sources import parse_source
from adaptsize.options import (
    ImageMeshOptions,
    ImageOptions,
    SizeFunctionOptions,
    checked,
    options_of,
)

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize._size_report import SizeReport
    from adaptsize.background import SimplexMesh
    from adaptsize.background.image import Image

_COST = own("Output", "cost", bool, "Also print unknowns, matrix, time steps and smallest places.")
_PARTS = own("Output", "parts", bool, "Also print width, curvature, size and cost of each part.")
_SPEED = own("Output", "speed", float, "Largest speed of a signal, for the time steps.")
_CAUSES = own("Output", "plot_causes", Path, "Also draw which cause controls which part (.png).")
#: Options that have no effect on the sizes of an image.
_OF_MESHES = ("elements_between", "field", "elements", "nodes", "tolerance", "parts", "size_of")


@command(SizeFunctionOptions, SOURCE, FIELD, PLOT, _CAUSES, _COST, _PARTS, _SPEED)
def size(console: Console, file: AnyFile, output: SizesOutput, given: Given) -> None:
    """Compute the size function of a mesh or an image.

    Sizes come from curvature, narrow regions and sources, and their gradient is limited.  The field
    h holds them, and the field cause what controls each.  The sizes of an image are on the grid of
    its pixels: write .vti.
    """
    from adaptsize._formats.raster import is_image_file
    from adaptsize.domain_size.elements import report_of
    from adaptsize.io import read_image

    of_image = is_image_file(file)
    plot, plot_causes = given.pop("plot", None), given.pop("plot_causes", None)
    of_cost: Given = {name: given.pop(name) for name in ("cost", "parts", "speed") if name in given}
    as_number("speed", of_cost.get("speed", 1.0), lower=0.0, strict=True)
    if "speed" in of_cost and len(of_cost) == 1:
        raise ValueError("--speed has no effect without --cost or --parts")
    content: Content = "sizes of an image" if of_image else "sizes"
    check_files([file], output, content, plot=plot, plot_causes=plot_causes)
    for name in _OF_MESHES if of_image else options_of(ImageOptions):
        if name in given | of_cost:
            flag = f"--{name.replace('_', '-')}"
            raise ValueError(f"{flag} does not apply to this kind of file, got it with {file}")
    given["sources"] = [parse_source(text) for text in given.pop("source", ())]
    with console.steps(3) as steps:
        steps.begin("reading")
        given["progress"] = steps.report
        if of_image:
            image = read_image(file)
            steps.begin("sizes")
            found = size_of_domain(console, image, given)
        else:
            mesh = read_mesh(file)
            check_cells(output, mesh)
            if ("parts" in of_cost or "size_of" in given) and mesh.cell_dim == 2 < mesh.dim:
                mesh = mesh if mesh.cell_tags is not None else mesh.tag_faces()
            announce_memory_of_sizes(console, mesh)
            steps.begin("sizes")
            if "field" in given:
                given = {"tolerance": math.inf} | given
            found = size_of_domain(console, mesh, given)
        report = report_of(found)
        steps.begin("writing")
        fields = {"cause": report.cause.astype("int32")} if holds_more_than_sizes(output) else {}
        written = write_sizes(output, found, fields)
        draw(console, "size", plot, found)
        draw(console, "causes", plot_causes, report)
    console.record(input=str(file), size=as_dict(report))
    console.print(report)
    if fields:
        names = ", ".join(f"{k} {name}" for k, name in enumerate(report.causes))
        console.print(f"field cause: {names}")
    _print_cost(console, found, given, of_cost)
    print_written(console, written)


def _print_cost(console: Console, found: SizeFunction, given: Given, wanted: Given) -> None:
    """Print what a computation with these sizes costs, and the sizes of each part."""
    from adaptsize.domain_size.cost import table_of

    speed = {name: wanted[name] for name in ("speed",) if name in wanted}
    if "cost" in wanted:
        system = {name: given[name] for name in ("degree", "fields") if name in given}
        cost = found.cost(**system, **speed)
        console.record(cost=asdict(cost))
        console.print(cost)
    if "parts" in wanted:
        parts = found.parts(**speed)
        console.record(parts=[asdict(part) for part in parts])
        console.print(table_of(parts))


def size_of_domain(console: Console, domain: SimplexMesh | Image, given: Given) -> SizeFunction:
    """Return the size function of a mesh or an image, and print the parameters used.

    With a field, curvature, width and separation are off unless they are requested.
    """
    from adaptsize.domain_size import size_function
    from adaptsize.domain_size.elements import report_of

    options = dict(given)
    field = options.pop("field", None)
    if field is not None:
        off = {"elements_per_radian": 0.0, "elements_across": 0.0, "elements_between": 0.0}
        options = off | {"h0": nodal_field(cast("SimplexMesh", domain), field)} | options
    found: SizeFunction = size_function(domain, **options)
    console.say(f"sizes: {report_of(found).choices}")
    return found


def as_dict(report: SizeReport) -> dict[str, Any]:
    """Return the parameters, sizes and causes of a size function, for the JSON object."""
    causes = [
        {
            "code": code,
            "name": name,
            "domain_share": report.domain_shares[name],
            "element_share": report.element_shares[name],
            "smallest": report.smallest[name],
        }
        for code, name in enumerate(report.causes)
    ]
    before = "elements_per_radian elements_across elements_between is_rough g hmin hmax relaxation"
    values = {name: getattr(report, name) for name in before.split()}
    after = {name: getattr(report, name) for name in ("largest", "n_elements", "n_nodes")}
    return values | {"smallest": min(report.smallest.values())} | after | {"causes": causes}


@command(ImageMeshOptions, SOURCE, PLOT, without="elements nodes elements_between tolerance seed")
def image(console: Console, file: ImageFile, output: MeshOutput, given: Given) -> None:
    """Mesh the objects in a mask or label image.

    A picture gives triangles, a volume gives tetrahedra.  Sizes come from the curvature of the
    boundaries of the objects and from their width.  Labels become the regions of the mesh.
    """
    from adaptsize.domain_size.images import mesh_image
    from adaptsize.io import read_image
    from adaptsize.reporting.outcome import outcome_of_image

    plot = given.pop("plot", None)
    check_files([file], output, "mesh", plot=plot)
    given["sources"] = [parse_source(text) for text in given.pop("source", ())]
    with console.steps(5) as steps:
        steps.begin("reading")
        pixels = read_image(file)
        steps.begin("sizes")
        following = steps.following({"placing nodes": "meshing"}.get)
        mesh = mesh_image(pixels, **given, progress=following)
        steps.begin("writing")
        written = write_mesh(output, mesh)
        steps.begin("checks")
        chosen = {name: given[name] for name in options_of(ImageOptions) if name in given}
        outcome = outcome_of_image(mesh, pixels, checked(ImageOptions, chosen))
        draw(console, "size", plot, mesh)
    console.record(input=str(file), mesh=outcome.as_dict())
    console.print(outcome)
    for text in outcome.warnings():
        console.warn(text)
    print_written(console, *written)
    console.exit_unless(outcome.check.is_met)
