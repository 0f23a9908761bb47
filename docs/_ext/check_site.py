"""Check the built site as a reader without network would see it.

    python docs/_ext/check_site.py SITE

Pages must fetch nothing from elsewhere and contain no formula that was left as TeX.  Where Chromium
is installed, it opens the pages without network, one after the other in one process.  They must
log no error, and at the widths of a phone, a small window and a large one nothing may be wider than
the page.  Links need a text, pictures a description, headings their order, and lines of code end
before they must be scrolled far (`layout.js`).
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
CODE = re.compile(r"<(pre|code|script|style|annotation)\b.*?</\1>", re.DOTALL)
#: The reference has about a hundred pages of one kind; this share is opened.
OPENED_OF_REFERENCE = 10
WIDTHS = [1500, 1400, 1000, 400]
LONGEST_LINE = 100
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
    tex = LEFT_AS_TEX.search(CODE.sub("", text))
    return [*lines, f"{name}: has TeX {tex[0]!r}"] if tex else lines


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
