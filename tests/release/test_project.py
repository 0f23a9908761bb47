"""What a public project states in several places: its dependencies, Pythons, actions, addresses."""

import re
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def without_spaces(text):
    return re.sub(r"\s", "", text)


def test_conda_installs_what_pip_does():
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    host, run = re.search(r"  host:\n(.*?)  run:.*?\n(.*?)^tests:", recipe, re.M | re.S).groups()
    listed = [set(map(without_spaces, re.findall(r"    - (.*)", part))) for part in (host, run)]
    python = "python" + PROJECT["project"]["requires-python"]
    needed = [without_spaces(one.partition(";")[0]) for one in PROJECT["project"]["dependencies"]]
    assert listed[1] == {python, *needed}
    assert listed[0] == {python, "pip", *PROJECT["build-system"]["requires"]}


def test_the_same_pythons_everywhere():
    of_python = "Programming Language :: Python :: "
    classifiers = PROJECT["project"]["classifiers"]
    named = [one.removeprefix(of_python) for one in classifiers if one.startswith(of_python)]
    assert PROJECT["project"]["requires-python"] == f">={named[0]}"
    page = (ROOT / "docs" / "compatibility.md").read_text(encoding="utf-8")
    assert f"at present {named[0]} to {named[-1]}." in page
    for name in ("tests", "release"):
        text = (ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8")
        assert set(re.findall(r'"(3\.\d+)"', text)) == set(named)


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_actions_are_pinned_and_may_do_little(workflow):
    text = workflow.read_text(encoding="utf-8")
    actions = re.findall(r"uses: (\S+)(.*)", text)
    assert all(re.fullmatch(r"\S+@[0-9a-f]{40}", action) for action, _ in actions)
    assert all(re.fullmatch(r" # v\d+(\.\d+)+", version) for _, version in actions)
    assert re.search(r"^permissions:\n  contents: read\n(?=\S)", text, re.M)
    # The token of the run does not stay where scripts of a pull request could read it.
    assert text.count("actions/checkout@") == text.count("persist-credentials: false")


def test_one_version_of_each_action():
    text = "".join(path.read_text(encoding="utf-8") for path in WORKFLOWS)
    pins = set(re.findall(r"uses: ([^@/]+/[^@/]+)\S*@(\S+)", text))
    assert len(pins) == len({name for name, _ in pins})


def test_addresses_of_the_project_stand_in_one_file():
    domain = re.match(r"https://([^/]+)", PROJECT["project"]["urls"]["Homepage"])[1]
    texts = [*ROOT.glob("*.md"), *ROOT.glob("*.cff"), *(ROOT / ".github").rglob("*.yml")]
    texts += [*(ROOT / "docs").glob("*.md"), *(ROOT / "paper").glob("*.md")]
    assert not [path for path in texts if domain in path.read_text(encoding="utf-8")]


def test_contributors_read_of_the_same_layers_as_the_linter():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.search(r"which `lint-imports` checks: (.*?)\. Optional", text, re.S)[1]
    contract = PROJECT["tool"]["importlinter"]["contracts"][0]["layers"]
    layers = [part.removeprefix("adaptsize.") for row in contract for part in row.split(" | ")]
    named = re.findall(r"`(\w+)`", listed)
    # Below the kernels there are single files that hold no numerics.
    assert named == layers[: layers.index("_kernels") + 1]


def test_the_lowest_versions_that_a_decision_names_are_those_of_the_project():
    page = next((ROOT / "docs" / "decisions").glob("0029-*.md")).read_text(encoding="utf-8")
    found = re.findall(r"(numpy|scipy)\s+(\d+\.\d+)", page)
    assert {package for package, _ in found} == {"numpy", "scipy"}
    for package, version in found:
        assert f"{package}>={version}" in PROJECT["project"]["dependencies"]
