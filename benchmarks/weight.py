"""How much code there is, whole and per package, in the work tree or at commits.

    python benchmarks/weight.py [COMMIT ...]

Lines of code are those without docstrings, comments and blank lines.  Overloads do not count as
functions.  A constant is a name at the level of a module that is set to numbers only.
"""

import argparse
import ast
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = Path("src/adaptsize")
MANY, FAR_TOO_MANY = 6, 12
"""Parameters from which a function counts."""


@dataclass
class Weight:
    """The sums over some files."""

    files: int = 0
    code: int = 0
    headers: int = 0
    """Lines of code that are signatures or imports."""
    many: int = 0
    far_too_many: int = 0
    """Functions with 12 and more parameters; those of kernels are left out."""
    constants: int = 0

    def __add__(self, other: "Weight") -> "Weight":
        names = [field.name for field in fields(self)]
        return Weight(**{name: getattr(self, name) + getattr(other, name) for name in names})


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commits", nargs="*", metavar="COMMIT", help="default: the work tree")
    commits = parser.parse_args().commits or [""]
    weighed = [_weigh(commit) for commit in commits]
    totals = [(sum(packages.values(), Weight()), tests) for packages, tests in weighed]
    rows = {
        "lines of code": [w.code for w, _ in totals],
        "signatures and imports, %": [round(100 * w.headers / max(w.code, 1)) for w, _ in totals],
        f"functions of {MANY} and more parameters": [w.many for w, _ in totals],
        f"of {FAR_TOO_MANY} and more, without kernels": [w.far_too_many for w, _ in totals],
        "numeric constants": [w.constants for w, _ in totals],
        "files": [w.files for w, _ in totals],
        "lines of tests": [tests for _, tests in totals],
    }
    _print_table(["", *(commit or "work tree" for commit in commits)], rows)
    columns = ["code", "signatures", f"{MANY}+", f"{FAR_TOO_MANY}+", "constants", "files"]
    for commit, (packages, _) in zip(commits, weighed, strict=True):
        parts = sorted(packages.items(), key=lambda part: -part[1].code)
        _print_table(
            [commit or "work tree", *columns],
            {
                name: [w.code, w.headers, w.many, w.far_too_many, w.constants, w.files]
                for name, w in parts
            },
        )


def _weigh(commit: str) -> tuple[dict[str, Weight], int]:
    """Return the weight of each package, and the number of lines of the tests."""
    packages: dict[str, Weight] = defaultdict(Weight)
    tests = 0
    for path, text in _python_files(commit):
        if path.parts[0] == "tests":
            tests += text.count("\n")
        else:
            packages[path.relative_to(PACKAGE).parts[0]] += _weigh_file(path, text)
    return packages, tests


def _python_files(commit: str) -> Iterator[tuple[Path, str]]:
    """Yield path and text of the Python files of package and tests."""
    listing = (
        ["ls-tree", "-r", "--name-only", commit]
        if commit
        else ["ls-files", "-co", "--exclude-standard"]
    )
    for name in _git(*listing, "--", "tests", str(PACKAGE)).splitlines():
        if not name.endswith(".py"):
            continue
        try:
            text = _git("show", f"{commit}:{name}") if commit else (ROOT / name).read_text()
        except FileNotFoundError:  # deleted in the work tree
            continue
        yield Path(name), text


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _weigh_file(path: Path, text: str) -> Weight:
    tree = ast.parse(text)
    nodes = list(ast.walk(tree))
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
    lines = enumerate(text.splitlines(), 1)
    code = {n for n, line in lines if line.strip() and not line.strip().startswith("#")}
    headers: set[int] = set()
    for node in nodes:
        code -= _lines_of_docstring(node)
        if isinstance(node, ast.Import | ast.ImportFrom):
            headers.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        elif isinstance(node, ast.FunctionDef):
            headers.update(range(node.lineno, max(node.body[0].lineno, node.lineno + 1)))
    counts = [_n_parameters(function) for function in functions]
    is_kernel = "_kernels" in path.parts
    return Weight(
        files=1,
        code=len(code),
        headers=len(code & headers),
        many=sum(count >= MANY for count in counts),
        far_too_many=0 if is_kernel else sum(count >= FAR_TOO_MANY for count in counts),
        constants=sum(map(_sets_a_constant, tree.body)),
    )


def _lines_of_docstring(node: ast.AST) -> set[int]:
    if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
        return set()
    if ast.get_docstring(node, clean=False) is None:
        return set()
    return set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))


def _n_parameters(function: ast.FunctionDef) -> int:
    """Return the number of parameters with a name; 0 for an overload."""
    if any(ast.unparse(decorator).endswith("overload") for decorator in function.decorator_list):
        return 0
    arguments = function.args
    return len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs)


def _sets_a_constant(statement: ast.stmt) -> bool:
    """Return whether a statement gives a name to a number, or to a tuple or product of some."""
    if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
        return False
    allowed = ast.Constant | ast.UnaryOp | ast.BinOp | ast.operator | ast.unaryop
    parts = list(ast.walk(statement.value))
    if not all(isinstance(part, allowed | ast.Tuple | ast.Load) for part in parts):
        return False
    return any(
        isinstance(part, ast.Constant) and type(part.value) in (int, float) for part in parts
    )


def _print_table(columns: list[str], rows: dict[str, list[int]]) -> None:
    first = max(map(len, [columns[0], *rows]))
    for name, *values in [columns, *([name, *row] for name, row in rows.items())]:
        cells = zip(values, columns[1:], strict=True)
        print(name.ljust(first) + "".join(f"{v:>{max(len(c), 6) + 2}}" for v, c in cells))
    print()


if __name__ == "__main__":
    main()
