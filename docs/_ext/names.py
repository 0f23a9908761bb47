"""Links from names in backticks, such as ``limit_gradient``, to the reference.

The pages are plain Markdown, in which names of the library are code.  On the site, the first use of
a name in a section becomes a link, except in headings and within links.  In docstrings, every name
in single backticks becomes one.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
NAME = re.compile(r"^   ([A-Za-z_.]+)$", re.MULTILINE)
#: What may stand around a name: ``ads.limit_gradient(mesh, h0)``.
WRITTEN = re.compile(r"^(?:ads\.|adaptsize\.)?([A-Za-z_][\w.]*)(?:\(.*\))?$", re.DOTALL)
#: Types of results and arguments that are described on the page of a function or class.
RECORDS = {
    "SimplexMesh": "background.simplex.Boundary quality.summary.MeshSummary "
    "remeshing.surface_checks.OpenBoundary remeshing.surface_checks.OverlappingBodies "
    "remeshing.surface_checks.NearBodies",
    "medial_axis": "geometry.medial.fronts.MedialAxis",
    "geometry.boundary_separation": "geometry.separation.BoundarySeparation",
    "size_from_sources": "sizes.sources.Source",
    "sizes.predict": "sizes.prediction.Prediction",
    "adapt": "adaptation.report.AdaptResult adaptation.report.AdaptReport",
    "needs_remeshing": "adaptation.need.RemeshingNeed adaptation.need.MissedPlace",
    "transfer_fields": "adaptation.transfer.TransferredFields",
    "limit_gradient": "limiting.info.LimitingInfo limiting.sources.SizeSources "
    "limiting.problem.Scheme",
    "limit_metric": "metrics.limit.MetricLimitingInfo",
    "size_function": "_size_report.SizeReport",
    "SizeFunction": "domain_size.cost.Cost domain_size.cost.SmallPlace domain_size.parts.Part",
    "remesh_to_elements": "domain_size.elements.MeshOfElements",
    "mesh_family": "domain_size.family.MeshFamily domain_size.family.Convergence",
    "check_mesh": "quality.certificate.MeshCheck quality.certificate.Requirement "
    "quality.certificate.Place",
    "size_conformity": "quality.conformity.Conformity quality.conformity.RatioStatistics "
    "quality.elements.MetricQuality quality.by_place.WorstPlace",
    "mesh_from_distance": "remeshing.distmesh.report.SmoothingReport",
    "remeshing.register_backend": "remeshing.protocol.MeshingProblem",
    "distributed.PartitionedMesh": "ranks.Communicator ranks.Traffic",
    "distributed.from_dolfinx": "distributed.solvers.DolfinxPart",
    "distributed.from_dmplex": "distributed.solvers.PlexPart",
}


def records() -> dict[str, list[str]]:
    """Return the full names of `RECORDS` by that of the function or class."""
    return {
        f"adaptsize.{name}": [f"adaptsize.{record}" for record in found.split()]
        for name, found in RECORDS.items()
    }


def public_names(reference: Path) -> dict[str, str]:
    """Return full names by what is written in pages, with or without the module."""
    full = [f"adaptsize.{name}" for name in NAME.findall(reference.read_text(encoding="utf-8"))]
    found = {name.removeprefix("adaptsize."): name for name in full}
    for name in [*full, *(record for found in records().values() for record in found)]:
        last = name.rpartition(".")[2]
        if last[0].isupper():  # functions of submodules have the names of plain words
            found.setdefault(last, name)
    return found


def link_names(app: Sphinx, doctree: nodes.document) -> None:
    """Replace names of the library by references."""
    document = app.env.docname
    names = public_names(DOCS / "api.rst")
    if not (DOCS / f"{document}.md").exists():
        for quoted in list(doctree.findall(nodes.title_reference)):
            if target := _target(quoted, names):
                quoted.replace_self(_link(target, nodes.literal("", quoted.astext()), document))
        return
    for section in doctree.findall(nodes.section):
        done: set[str] = set()
        for literal in list(section.findall(nodes.literal)):
            if _section_of(literal) is not section or _is_taken(literal):
                continue
            target = _target(literal, names)
            if target is not None and target not in done:
                done.add(target)
                literal.replace_self(_link(target, literal.deepcopy(), document))


def _target(text: nodes.Element, names: dict[str, str]) -> str | None:
    match = WRITTEN.match(text.astext())
    return names.get(match[1]) if match else None


def _link(target: str, text: nodes.literal, document: str) -> addnodes.pending_xref:
    return addnodes.pending_xref(
        "", text, refdomain="py", reftype="obj", reftarget=target, refexplicit=True,
        refdoc=document, refwarn=True,
    )  # fmt: skip


def _section_of(node: nodes.Node) -> nodes.Node | None:
    while node is not None and not isinstance(node, nodes.section):
        node = node.parent
    return node


def _is_taken(node: nodes.Node) -> bool:
    """Whether a literal is part of a heading or a link."""
    while node is not None and not isinstance(node, nodes.section):
        if isinstance(node, nodes.title | nodes.reference | addnodes.pending_xref):
            return True
        node = node.parent
    return False


def drop_aliases(
    app: Sphinx, what: str, name: str, obj: object, options: Any, lines: list[str]
) -> None:
    """Leave out what Python itself says of a field of a tuple: its number."""
    if any(line.startswith("Alias for field number") for line in lines):
        lines.clear()


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-read", link_names)
    app.connect("autodoc-process-docstring", drop_aliases, priority=900)  # after numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}
