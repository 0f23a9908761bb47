"""What the site adds to the pages: those from elsewhere in the project, links to them, contents.

The pages in ``docs/`` are plain Markdown, whose links lead to files; so they can be read where
the project is kept, without this site.  Here links to examples, results and the like are led to
their pages, and the tree of contents is put at the end of the first page.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import gallery
import notebooks
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
LOG = logging.getLogger(__name__)

# Pages that are elsewhere in the project: where, and their name here.
COPIES = {
    "CHANGELOG.md": "project/changelog",
    "CONTRIBUTING.md": "project/contributing",
    "SUPPORT.md": "project/support",
    "GOVERNANCE.md": "project/governance",
    "CODE_OF_CONDUCT.md": "project/conduct",
    "SECURITY.md": "project/security",
    "data/README.md": "project/samples",
}
# Links to folders, and what answers to them here.
FOLDERS = {
    "examples": "gallery/index",
    "benchmarks/results": "benchmarks",
    "docs/decisions": "decisions/README",
    "docs/how-to": "how-to/README",
    "docs/tutorials": "tutorials/README",
}
CONTENTS = {
    "First steps": [
        "install", "size-functions", "which-function", "choosing", "how-to/README",
        "tutorials/README", "gallery/index",
    ],
    "Methods": [
        "complete-size", "sizes", "width", "distance", "octrees", "images", "limiting",
        "anisotropic", "remeshing", "adaptation", "mesh-families", "sparse-sizes",
        "cost",
        "distributed",
    ],
    "Reference": [
        "api", "parameters", "command-line", "files", "glossary", "troubleshooting", "comparison",
        "promises", "compatibility", "benchmarks",
    ],
}  # fmt: skip
# Pages below others.
BELOW = {
    "how-to/README": [f"how-to/{p.stem}" for p in sorted(DOCS.glob("how-to/[a-z]*.md"))],
    "tutorials/README": [f"tutorials/{p.stem}" for p in sorted(DOCS.glob("tutorials/[a-z]*.md"))],
    "limiting": ["exact-limiting"],
    "anisotropic": ["anisotropic-meshes", "ugawg"],
    "remeshing": ["generators", "smoothing"],
    "adaptation": ["adaptive-loops", "solvers"],
    "benchmarks": [
        *(f"results/{p.stem}" for p in sorted(ROOT.glob("benchmarks/results/*.md"))),
        *(f"measurements/{p.stem}" for p in sorted(DOCS.glob("measurements/*.md"))),
    ],
    "promises": ["citations", "decisions/README", *COPIES.values()],
    "decisions/README": [f"decisions/{p.stem}" for p in sorted(DOCS.glob("decisions/0*.md"))],
}
NOTEBOOKS = [
    name
    for name in BELOW["how-to/README"] + BELOW["tutorials/README"]
    if "```python" in (DOCS / f"{name}.md").read_text(encoding="utf-8")
]
# What is for those who work on the library does not answer searches.
WITHOUT_SEARCH = ("decisions/", "measurements/", "results/", "project/", "ugawg")
# What readers search for, and the pages that answer; entries of the index count most in a search.
SEARCHED = {
    "citations": "citation, cite, BibTeX",
    "command-line": "reproduce, provenance",
    "distributed": "MPI, parallel",
    "files": "shapefile, GeoJSON, second order elements, quadratic elements",
    "generators": "TetGen",
    "glossary": "sizing field, mesh size field, background mesh, hgrad, hausd",
    "how-to/dolfinx": "FEniCS",
    "how-to/image": "medical image, segmentation",
    "how-to/repair": "close holes, self-intersection, watertight",
    "limiting": "growth rate, gradation, gradient limit",
    "mesh-families": "convergence study, mesh convergence, grid convergence index",
    "parameters": "elements_across, elements_per_radian, elements_between, number of elements",
    "remeshing": "mesh quality, dihedral angle, Hausdorff distance",
    "sizes": "curvature",
    "solvers": "Jupyter, notebook",
    "troubleshooting": "timeout, out of memory, units",
    "tutorials/cad": "STEP file, IGES, BREP",
    "tutorials/coast": "coastline",
    "width": "thin walls",
}
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")


def write_pages(app: Sphinx) -> None:
    """Write the pages that are made from other files, and report missing pictures."""
    examples = gallery.read_examples(ROOT / "examples")
    for line in gallery.missing_pictures(examples, DOCS / "figures"):
        LOG.warning(line)
    notebooks.write_notebooks(DOCS, NOTEBOOKS)
    pages = {f"gallery/{e.name}": gallery.page_of(e) for e in examples}
    pages["gallery/index"] = gallery.index_of(examples)
    pages |= {
        name: (ROOT / source).read_text(encoding="utf-8") for source, name in _copies().items()
    }
    for folder in ("gallery", "results", "project"):
        for old in (DOCS / folder).glob("*.md"):
            if f"{folder}/{old.stem}" not in pages:
                old.unlink()
    for name, text in pages.items():
        target = DOCS / f"{name}.md"
        target.parent.mkdir(exist_ok=True)
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")


def mend_page(app: Sphinx, docname: str, source: list[str]) -> None:
    """Lead the links of a page to other pages; add the contents to the first one."""
    if not (DOCS / f"{docname}.md").exists():
        return
    homes = {name: path for path, name in _copies().items()}
    folder = Path(homes.get(docname, f"docs/{docname}.md")).parent

    def resolved(match: re.Match[str]) -> str:
        return f"]({target_of(match[1], folder, docname)}{match[2] or ''})"

    source[0] = LINK.sub(resolved, source[0])
    if docname in SEARCHED:
        title, _, rest = source[0].partition("\n")
        entries = re.sub(r"^|(?<=, )", "! ", SEARCHED[docname])
        source[0] = f"{title}\n\n```{{index}} {entries}\n```\n{rest}"
    if docname in NOTEBOOKS:
        source[0] += (
            f"\n[This page as a Jupyter notebook](../notebooks/{Path(docname).name}.ipynb)\n"
        )
    if docname == app.config.root_doc:
        source[0] += contents()
    elif docname in BELOW:
        source[0] += _toctree("", BELOW[docname])


def read_again(app: Sphinx, *_: Any) -> list[str]:
    """Return the pages that list others, which may have come or gone since the last build."""
    return [app.config.root_doc, *BELOW]


def leave_out_of_search(app: Sphinx, env: BuildEnvironment) -> None:
    """Mark the pages whose text is not to be searched."""
    for name in env.found_docs:
        if name.startswith(WITHOUT_SEARCH):
            env.metadata[name]["nosearch"] = ""


def keep_index_entries(app: Sphinx) -> list[Any]:
    """Give the search the entries of pages that are not written again, which Sphinx forgets."""
    from sphinx.util.index_entries import split_index_msg

    known = getattr(getattr(app.builder, "indexer", None), "_index_entries", None)
    if known is not None:
        for name, entries in app.env.domaindata["index"]["entries"].items():
            if name.startswith(WITHOUT_SEARCH):
                continue
            found = {
                (word, target or "", main)
                for kind, value, target, main, _ in entries
                for word in split_index_msg(kind, value)
            }
            known.setdefault(name, sorted(found))
    return []


def target_of(link: str, folder: Path, docname: str) -> str:
    """Return where a link of a page that is at home in ``folder`` leads to on the site."""
    path = os.path.normpath(folder / link)
    pages = _copies() | FOLDERS
    pages |= {f"examples/{p.name}": f"gallery/{p.stem}" for p in ROOT.glob("examples/[!_]*.py")}
    if path in pages:
        path = f"docs/{pages[path]}.md"
    elif not (ROOT / path).is_file():
        return link  # broken, which the build reports
    return os.path.relpath(path, Path("docs", docname).parent)


def contents() -> str:
    """Return the hidden trees of contents; pages that nobody listed end up among the methods."""
    listed = {name for names in (*CONTENTS.values(), *BELOW.values()) for name in names}
    found = [p.stem for p in sorted(DOCS.glob("*.md"))]
    others = [name for name in found if name not in listed and name != "index"]
    parts = []
    for caption, wanted in CONTENTS.items():
        names = [name for name in wanted if list(DOCS.glob(f"{name}.*"))]
        parts.append(_toctree(caption, names + (others if caption == "Methods" else [])))
    return "".join(parts)


def _copies() -> dict[str, str]:
    results = ROOT.glob("benchmarks/results/*.md")
    return COPIES | {f"benchmarks/results/{p.name}": f"results/{p.stem}" for p in results}


def _toctree(caption: str, names: list[str]) -> str:
    entries = "\n".join(f"/{name}" for name in names)
    heading = f":caption: {caption}\n" if caption else ""
    return f"\n\n```{{toctree}}\n:hidden:\n{heading}\n{entries}\n```\n"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_pages)
    app.connect("env-get-outdated", read_again)
    app.connect("source-read", mend_page)
    app.connect("env-updated", leave_out_of_search)
    app.connect("html-collect-pages", keep_index_entries)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
