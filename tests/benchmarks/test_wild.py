"""Generated parts with defects, and runs of programs on them."""

import argparse
import sys
from pathlib import Path

import numpy as np
import pytest
import wild
from _measures import distances_slow, enclosed_volume
from _shapes import box, moved
from _wild_surfaces import part_of, write_parts
from judge import Mesh, Surface, edges_not_manifold, judge, judged, open_edges, read_surface

SEED = 1
#: Defects that change the triangles only, not the shape.
OF_TRIANGLES = {"slivers", "zero", "tjoints", "twins", "doubled", "flipped"}


@pytest.fixture(scope="module")
def parts():
    return {number: part_of(number, SEED) for number in range(24)}


def test_a_number_fixes_a_part(parts):
    for number in (0, 5, 17):
        again = part_of(number, SEED)
        assert again[0] == parts[number][0]
        np.testing.assert_array_equal(again[1].points, parts[number][1].points)
        np.testing.assert_array_equal(again[2].cells, parts[number][2].cells)
    assert any(part_of(n, SEED + 1)[0] != parts[n][0] for n in range(4))


def test_each_part_has_two_to_four_defects_of_all_kinds(parts):
    lists = [names for names, *_ in parts.values()]
    assert {len(names) for names in lists} == {2, 3, 4}
    assert all(len(set(names)) == len(names) for names in lists)
    assert len({name for names in lists for name in names}) == 16


def test_references_are_closed_up_to_holes_and_enclose_a_volume(parts):
    for number, (names, _, reference, _) in parts.items():
        assert (open_edges(reference.cells) == 0) == ("holes" not in names), number
        if "holes" not in names:
            assert edges_not_manifold(reference.cells) == 0
            assert enclosed_volume(*reference) > 0.0


def test_defects_of_triangles_leave_the_shape(parts):
    checked = 0
    for names, part, reference, _ in parts.values():
        if not OF_TRIANGLES & set(names) or len(reference.cells) > 1500:
            continue
        diagonal = np.linalg.norm(np.ptp(reference.points, axis=0))
        for one, other in ((part, reference), (reference, part)):
            middles = one.points[one.cells].mean(axis=1)[:: max(1, len(one.cells) // 50)]
            # Nodes given twice are up to some 1e-8 apart.
            assert distances_slow(*other, middles).max() < 1e-7 * diagonal
        checked += 1
    assert checked > 3


def test_files_hold_the_part_and_its_reference(tmp_path, parts):
    files = write_parts(tmp_path, 3, SEED)
    assert write_parts(tmp_path, 3, SEED) == files
    for number, file in enumerate(files):
        names, part, reference, _ = parts[number]
        assert file.stem == f"{number:03d}-{'-'.join(names)}"
        assert len(read_surface(file).triangles) == len(part.cells)
        stored = read_surface(file.with_suffix(".reference.npz"))
        np.testing.assert_array_equal(stored.triangles, reference.cells)


# --- runs of programs -----------------------------------------------------------------------------

CUBE = moved(box(n=1), 0.5)
MAKE_CUBE = """
import sys, numpy as np
points = np.argwhere(np.ones((2, 2, 2))).astype(float)
paths = [(0, 4, 6, 7), (0, 6, 2, 7), (0, 2, 3, 7), (0, 3, 1, 7), (0, 1, 5, 7), (0, 5, 4, 7)]
np.savez(sys.argv[1], points=points * float(sys.argv[2]), cells=np.array(paths))
"""


@pytest.fixture
def given(tmp_path, monkeypatch):
    np.savez(tmp_path / "cube.npz", points=CUBE.points, triangles=CUBE.cells)
    monkeypatch.setattr(wild, "SUFFIXES", {".npz"})

    def coarse(*given):
        return judge(*given[:3], count=400, grid=8)

    monkeypatch.setattr(wild, "judged", coarse)
    names = {"tolerance": 1e-2, "timeout": 60.0, "patience": 1.0, "memory": 8.0, "options": []}
    return argparse.Namespace(**names, judge_python=sys.executable)


def program(size, code=0):
    def command(_part, _cap, folder, _given):
        made = Path(folder) / "made.npz"
        script = f"{MAKE_CUBE}\nsys.exit({code})"
        return [sys.executable, "-c", script, str(made), str(size)], made

    return command


def test_a_run_is_measured_and_kept(tmp_path, given, monkeypatch, capsys):
    calls = []

    def counted(*arguments):
        calls.append(1)
        return program(0.9)(*arguments)

    monkeypatch.setattr(wild, "PROGRAMS", {wild.OURS: counted, wild.THEIRS: program(1.0)})
    output = tmp_path / "table.md"
    words = ["wild.py", str(tmp_path), "--caps", "4", "--output", str(output)]
    for _ in range(2):  # the second time from the file
        monkeypatch.setattr(sys, "argv", words)
        wild.main()
    assert len(calls) == 1
    text = output.read_text()
    line = next(one for one in text.splitlines() if one.startswith("| cube.npz"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    named = dict(zip(wild.HEADS[:14], cells[:14], strict=True))
    # A side of .9 instead of 1: the corner is sqrt 3 / 10 away, over a diagonal of sqrt 3.
    assert named["H"] == "100"
    assert (named["exit"], named["true"]) == ("0", "**no**")
    assert (named["missed"], named["cells"]) == ("distance, volume, number", "6")
    assert named["volume %"] == "-27.10"
    assert float(cells[15]) < 1e-6  # that of fTetWild
    assert "H <= 1.05: 0 of 1" in text
    assert "exit code true: 0 of 1" in text
    assert "more than 10 % above the cap: 1" in text
    capsys.readouterr()


def test_exit_1_is_true_of_a_bad_mesh(tmp_path, given, monkeypatch):
    given.tolerance = 1e-3
    monkeypatch.setattr(wild, "PROGRAMS", {wild.OURS: program(0.9, 1)})
    row = wild.run(tmp_path / "cube.npz", None, wild.OURS, given)
    assert row["code"] == 1
    line = wild.line_of({"part": "cube", "cap": None, **row}, None)
    assert line[3] == "yes"


def test_a_run_that_takes_too_long_is_ended_and_late(tmp_path, given):
    given.timeout = 0.5
    row = wild.in_child([sys.executable, "-c", "while True: pass"], tmp_path, given)
    assert row["code"] is None
    assert row["wall"] < 20.0


def test_another_python_measures_the_same():
    points = np.argwhere(np.ones((2, 2, 2))).astype(float)
    cells = np.array([(0, 4, 6, 7), (0, 6, 2, 7), (0, 2, 3, 7), (0, 3, 1, 7), (0, 1, 5, 7)])
    part, mesh = Surface(*CUBE), Mesh(points, cells, np.full(8, 1.2))
    folder, _, name = sys.executable.rpartition("/")
    other = judged(part, mesh, 1e-2, f"{folder}/./{name}", 400, 8)
    here = judged(part, mesh, 1e-2, sys.executable, 400, 8)
    assert {**other, "seconds": 0} == {**here, "seconds": 0}
    assert other["band"] == pytest.approx(17.0 / 18.0)  # not the diagonal
