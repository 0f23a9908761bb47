"""Check the built site as a reader without network would see it.

    python docs/_ext/check_site.py SITE

Pages must fetch nothing from elsewhere and contain no formula that was left as TeX.  Where Chromium
is installed, it opens the pages without network, one after the other in one process.  They must
log no error, and at the widths of a phone, a small window and a large one nothing may be wider than
the page.  Links need a text, pictures a description, headings their order, and lines of code end
before they must be scrolled far (`layout.js`).

Where Node.js is installed, the search of the site must find a page that answers each of some
queries, as the first or the second one (`search.js`).
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FETCHED = re.compile(r"<(?:script|link|img|iframe|source)[^>]*?(?:src|href)=\"(https?:)?//[^>]*>")
#: Links that are not loaded with the page.
HARMLESS = re.compile(r'rel="(?:canonical|index|search|next|prev|license)"')
LEFT_AS_TEX = re.compile(r"\\\(|\\\[|\\(?:frac|kappa|sqrt|mathrm|nabla|lvert)\b")
#: What a reference is called within Sphinx; a summary that cites shows it.
KEY = re.compile(r"\[R[0-9a-f]{12}-\d+\]")
CODE = re.compile(r"<(pre|code|script|style|annotation)\b.*?</\1>", re.DOTALL)
#: The reference has about a hundred pages of one kind; this share is opened.
OPENED_OF_REFERENCE = 10
WIDTHS = [1500, 1400, 1000, 400]
LONGEST_LINE = 100
#: What users search for, and pages that answer.
QUERIES = {
    "step file": "tutorials/cad",
    "citation": "citations",
    "units": "troubleshooting",
    "growth rate": "limiting",
    "boundary layer": "gallery/plot_boundary_layer anisotropic-meshes",
    "stl": "how-to/stl",
    "gmsh": "how-to/export how-to/my-solver",
    "abaqus": "how-to/my-solver",
    "calculix": "how-to/my-solver",
    "fenics": "how-to/dolfinx",
    "dolfinx": "how-to/dolfinx",
    "scikit-fem": "solvers how-to/fem-loop",
    "pyvista": "how-to/export solvers",
    "paraview": "how-to/my-solver files",
    "jupyter notebook": "solvers",
    "install": "install",
    "mmg": "remeshing generators",
    "tetgen": "generators comparison",
    "openfoam": "how-to/my-solver",
    "periodic": "tutorials/photonics",
    "anisotropic": "anisotropic anisotropic-meshes",
    "curvature": "sizes",
    "adaptive refinement": "adaptive-loops adaptation",
    "error estimator": "adaptation",
    "medical image": "how-to/image tutorials/vessels",
    "nifti": "how-to/image",
    "shapefile": "files tutorials/coast",
    "coastline": "tutorials/coast",
    "number of elements": "parameters",
    "mesh quality": "remeshing",
    "dihedral": "remeshing",
    "hausdorff": "remeshing",
    "close holes": "how-to/repair",
    "self-intersection": "how-to/repair",
    "thin walls": "width",
    "mpi": "distributed",
    "out of memory": "troubleshooting",
    "sizing field": "glossary size-functions",
    "mesh convergence": "mesh-families",
    "second order elements": "files how-to/export",
    "docker": "install",
    "conda": "install",
    "gpu": "install",
    "license": "install citations",
    "growth ratio": "glossary limiting",
    "checkpoint": "adaptive-loops",
    "mfem": "solvers",
    "timeout": "troubleshooting",
    "fort.14": "tutorials/coast",
}
OPTIONS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--disable-web-security",  # the script looks into pages in files
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--virtual-time-budget=100000",
    "--dump-dom",
]
#: A line of Chromium's log: ``[pid:time:INFO:CONSOLE:12] "text", source: ...``.
LOGGED = re.compile(r"CONSOLE\D*\d+\)?\] \"(.*)\", source: ")


def main(site: Path) -> int:
    """Print what is wrong; return the exit code."""
    pages = sorted(site.rglob("*.html"))
    if not pages:
        print(f"{site} has no pages")
        return 1
    found = [line for page in pages for line in problems_of(page, site)]
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    opened = [p for p in pages if p.parent.name != "api"]
    opened += [p for p in pages if p.parent.name == "api"][:OPENED_OF_REFERENCE]
    if browser is None:
        print("no Chromium: pages are not opened")
    else:
        found += problems_in_browser(browser, opened, site)
    node = shutil.which("node")
    if node is None:
        print("no Node.js: the search is not tried")
    else:
        found += problems_of_search(node, site)
    print(*found, sep="\n")
    how = f", {len(opened)} opened" if browser else ""
    print(f"{len(pages)} pages checked{how}: {len(found)} problems")
    return 1 if found else 0


def problems_of(page: Path, site: Path) -> list[str]:
    """Return one line for each thing that is fetched, and for formulas that were left as TeX."""
    text = page.read_text(encoding="utf-8")
    name = page.relative_to(site)
    fetched = [m[0] for m in FETCHED.finditer(text) if not HARMLESS.search(m[0])]
    lines = [f"{name}: fetches {tag[:120]}" for tag in fetched]
    if "Alias for field number" in text:
        lines.append(f"{name}: has fields without words")
    if key := KEY.search(text):
        lines.append(f"{name}: has {key[0]} in place of a reference")
    tex = LEFT_AS_TEX.search(CODE.sub("", text))
    return [*lines, f"{name}: has TeX {tex[0]!r}"] if tex else lines


def problems_of_search(node: str, site: Path) -> list[str]:
    """Return one line for each query whose answer is not among the first two pages."""
    script = Path(__file__).with_name("search.js")
    words = [node, str(script), str(site), *QUERIES]
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, timeout=120, check=True)
    pages = zip(QUERIES.items(), json.loads(done.stdout), strict=True)
    return [
        f"search for {query!r} finds {', '.join(found) or 'nothing'}, not {answers}"
        for (query, answers), found in pages
        if not set(answers.split()) & set(found[:2])
    ]


def problems_in_browser(browser: str, pages: list[Path], site: Path) -> list[str]:
    """Return one line for each problem that `layout.js` or the browser itself logs."""
    values = {"PAGES": [p.as_uri() for p in pages], "WIDTHS": WIDTHS, "LONGEST": LONGEST_LINE}
    constants = "".join(f"const {name} = {json.dumps(value)};" for name, value in values.items())
    script = Path(__file__).with_name("layout.js").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        driver = Path(folder, "driver.html")
        driver.write_text(f"<!doctype html><body><script>{constants}{script}</script>", "utf-8")
        words = [browser, *OPTIONS, f"--user-data-dir={folder}/profile", driver.as_uri()]
        done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    name, lines = "", []
    for text in LOGGED.findall(done.stderr):
        kind, _, rest = text.partition(" ")
        if kind == "PAGE":
            name = rest.removeprefix(f"{site.as_uri()}/")
        elif kind == "WRONG":
            lines.append(f"{name}: {rest}")
        elif "rror" in text:
            lines.append(f"{name}: {text}")
    if name != "end":
        lines.append(f"{name or browser}: cannot be opened (exit code {done.returncode})")
    return lines


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
