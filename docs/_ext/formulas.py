"""Formulas as MathML, which browsers draw by themselves: no script, nothing fetched."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

# Environments of lines aligned at "&", which Sphinx passes on with their numbers.
NUMBERED = re.compile(r"\\(begin|end)\{(align|equation|gather)\}")
# The converter shows the backslash of an underscore in them.
NAME = re.compile(r"\\texttt\{[^}]*\}")


def mathml(latex: str, *, display: bool) -> str:
    """Return the MathML element of a formula."""
    latex = NAME.sub(lambda name: name[0].replace(r"\_", "_"), latex)
    text = NUMBERED.sub(r"\\\1{\2*}", latex.strip())
    if r"\begin" not in text and ("&" in text or r"\\" in text):
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    return convert(text, display="block" if display else "inline")


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a line."""
    translator.body.append(mathml(node.astext(), display=False))
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula of its own line, which scrolls where it is wider than the page."""
    translator.body.append(f'<div class="formula">{mathml(node.astext(), display=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
