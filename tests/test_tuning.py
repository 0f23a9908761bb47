"""Tuned values are read when they are used, and have one meaning in all rooms."""

import ast
from collections import Counter
from pathlib import Path

import pytest

import adaptsize

PACKAGE = Path(adaptsize.__file__).parent
ROOMS = sorted(PACKAGE.rglob("tuning.py"))
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


def read_at_import(tree):
    """The tuned values in a module that are read before any function is called."""
    found = []

    def visit(node):
        if isinstance(node, FUNCTIONS):
            for default in [*node.args.defaults, *filter(None, node.args.kw_defaults)]:
                visit(default)
            return
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "tuning":
            found.append(node.attr)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(tree)
    imports = [one for one in ast.walk(tree) if isinstance(one, ast.ImportFrom)]
    bound = [one for one in imports if (one.module or "").endswith(".tuning")]
    return {*found, *(alias.name for one in bound for alias in one.names)}


@pytest.mark.parametrize(
    "source",
    [
        "from adaptsize.remeshing.tuning import TURNS",
        "def f():\n    from adaptsize.remeshing.tuning import TURNS",
        "HALF = 0.5 * tuning.TURNS",
        "def f(x=tuning.TURNS): pass",
        "class A:\n    def f(self, *, x: int = tuning.TURNS): pass",
        "class A:\n    x: int = tuning.TURNS",
    ],
)
def test_a_value_that_is_read_too_early_is_found(source):
    assert read_at_import(ast.parse(source)) == {"TURNS"}
    assert not read_at_import(ast.parse("def f(x=None): return tuning.TURNS"))


def test_tuned_values_are_read_when_they_are_used():
    early = {
        str(path.relative_to(PACKAGE)): names
        for path in PACKAGE.rglob("*.py")
        if (names := read_at_import(ast.parse(path.read_text(encoding="utf-8"))))
    }
    assert not early


def test_no_name_is_used_for_two_tuned_values():
    names = Counter()
    for path in ROOMS:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            targets = (
                node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", node)]
            )
            names.update(
                one.id
                for target in targets
                for one in ast.walk(target)
                if isinstance(one, ast.Name)
            )
    assert len(names) > 200
    assert [name for name, count in names.items() if count > 1] == []


def test_the_table_of_contributing_lists_all_rooms():
    page = (PACKAGE.parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| values that were tuned"))
    rooms = [f"`{path.parent.relative_to(PACKAGE).as_posix()}/`" for path in ROOMS]
    assert [room for room in rooms if room not in row] == []
