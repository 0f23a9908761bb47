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


def public_names(reference: Path) -> dict[str, str]:
    """Return full names by what is written in pages, with or without the module."""
    full = [f"adaptsize.{name}" for name in NAME.findall(reference.read_text(encoding="utf-8"))]
    found = {name.removeprefix("adaptsize."): name for name in full}
    for name in full:
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


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-read", link_names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
