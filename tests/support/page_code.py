"""The code blocks of a page, what they print, and what the page says that they print.

The output of a ``sh`` or ``python`` block stands below it, in a ``text`` block:

* A line ``...`` stands for any number of lines, and ``...`` within a line for any text.
* Numbers may differ by a tenth, or by one unit of their last decimal: meshes differ in a few cells
  from machine to machine.  Differences below 1e-12 are rounding errors.
* Spaces count as one space, and empty lines, times and the lines on progress are not compared.
"""

import contextlib
import importlib.util
import io
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from decimal import Decimal
from functools import partial
from pathlib import Path

from adaptsize.cli.entry import run as run_command_line

BLOCK = re.compile(
    r"^(?:<!-- needs: (?P<needs>\S+) -->\n)?```(?P<kind>sh|python)\n(?P<code>.*?)^```$"
    r"(?:\n\n```text\n(?P<output>.*?)^```$)?",
    re.MULTILINE | re.DOTALL,
)
NUMBER = r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?!\w)"
TOKEN = re.compile(rf"(?P<number>{NUMBER})|(?P<any>\.\.\.)|(?P<space>\s+)|(?P<other>.)")
PROGRESS = re.compile(r"^adaptsize: (?:step \d|compiling kernels).*\n?", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """Code of a page."""

    kind: str
    code: str
    line: int  # of the page, from 0
    needs: str | None
    output: str | None

    def can_run(self):
        """Whether what the block needs beside this package is installed."""
        if self.needs in (None, "solve"):
            return True
        return bool(find_program(self.needs)) or importlib.util.find_spec(self.needs) is not None

    def run(self, page, names):
        """Run the code, with the names of the blocks above; return what it prints."""
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            if self.kind == "python":
                exec(compile("\n" * self.line + self.code, str(page), "exec"), names)
            else:
                for line in self.code.splitlines():
                    run_line(line.split("&&")[-1].split("#")[0].strip())
        return printed.getvalue()

    def difference(self, printed, any_number=False):
        """Return what is wrong with the output on the page, or None."""
        printed = PROGRESS.sub("", printed).strip()
        listed = (self.output or "").strip()
        if matches(listed, printed, any_number):
            return None
        return f"the code at line {self.line} prints\n{printed}\nand the page has\n{listed}"


def blocks_of(text, start=0, end=None):
    """Return the blocks of a page, or of a part of it."""
    found = BLOCK.finditer(text, start, len(text) if end is None else end)
    return [
        Block(b["kind"], b["code"], text.count("\n", 0, b.start("code")), b["needs"], b["output"])
        for b in found
    ]


def find_program(name):
    return shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))


def run_line(line):
    """Run a line of a shell block; pip has run already where the tests run."""
    if not line or line.startswith(("pip", "python -m pytest")):
        return
    program, *arguments = shlex.split(line)
    if program == "adaptsize":
        # Meshes of coarse parts may miss a requirement of check.
        allowed = (0, 1) if arguments[0] in ("check", "image", "remesh") else (0,)
        assert run_command_line(arguments) in allowed, line
    else:
        done = subprocess.run([find_program(program), *arguments], check=True, capture_output=True)
        print((done.stdout + done.stderr).decode())


def matches(listed, printed, any_number=False):
    """Whether the lines of a page are those printed."""
    wanted, given = ([line for line in t.splitlines() if line.strip()] for t in (listed, printed))
    parts = [[]]
    for line in wanted:
        if line.strip() == "...":
            parts.append([])
        else:
            parts[-1].append(line)
    first, *others = parts

    def fits(wanted, given):
        same = partial(same_line, any_number=any_number)
        return len(wanted) == len(given) and all(map(same, wanted, given))

    if not others:
        return fits(first, given)
    last = len(given) - len(others[-1])
    at = len(first)
    if not fits(first, given[:at]):
        return False
    for part in others[:-1]:
        while at <= last and not fits(part, given[at : at + len(part)]):
            at += 1
        at += len(part)
    return at <= last and fits(others[-1], given[last:])


def same_line(listed, printed, any_number):
    """Whether a line of a page is the one printed."""
    if listed.startswith("time "):
        return printed.startswith("time ")
    pattern, numbers = "", []
    for token in TOKEN.finditer(listed.strip()):
        kind = token.lastgroup
        numbers += [token[0]] if kind == "number" else []
        pattern += {"number": f"({NUMBER})", "any": ".*?", "space": r"\s+"}.get(
            kind, re.escape(token[0])
        )
    found = re.fullmatch(pattern, printed.strip())
    return bool(found) and (any_number or all(map(near, numbers, found.groups())))


def near(listed, printed):
    """Whether two numbers, as they are written, agree."""
    a, b = Decimal(listed), Decimal(printed)
    unit = Decimal(10) ** min(a.as_tuple().exponent, b.as_tuple().exponent)
    last_decimal = unit if unit < 1 else 0  # whole numbers below 10 are exact
    return abs(a - b) <= max(abs(a) / 10, last_decimal, Decimal("1e-12"))
