"""Check the built site as a reader without network would see it.

    python docs/_ext/check_site.py SITE

Pages must fetch nothing from elsewhere and contain no formula that was left as TeX.  Where Chromium
is installed, it opens each page, without network, and must log no error.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FETCHED = re.compile(r"<(?:script|link|img|iframe|source)[^>]*?(?:src|href)=\"(https?:)?//[^>]*>")
#: Links that are not loaded with the page.
HARMLESS = re.compile(r'rel="(?:canonical|index|search|next|prev|license)"')
LEFT_AS_TEX = re.compile(r"\\\(|\\\[|\\(?:frac|kappa|sqrt|mathrm|nabla|lvert)\b")
CODE = re.compile(r"<(pre|code|script|style|annotation)\b.*?</\1>", re.DOTALL)
#: The reference has about a hundred pages of one kind; this share is opened.
OPENED_OF_REFERENCE = 10
OPTIONS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--virtual-time-budget=4000",
]


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
        with ThreadPoolExecutor(2) as pool:
            for lines in pool.map(lambda page: errors_in(browser, page, site), opened):
                found += lines
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


def errors_in(browser: str, page: Path, site: Path) -> list[str]:
    """Return one line for each error that the browser logs."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [browser, *OPTIONS, f"--user-data-dir={profile}"]
        words += ["--host-resolver-rules=MAP * ~NOTFOUND", "--dump-dom", page.as_uri()]
        done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    name = page.relative_to(site)
    logged = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    lines = [f"{name}: {line.split('] ', 1)[-1]}" for line in logged if "rror" in line]
    if "</html>" not in done.stdout:
        lines.append(f"{name}: cannot be opened (exit code {done.returncode})")
    return lines


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
