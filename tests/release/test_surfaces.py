"""The benchmark that remeshes folders of surfaces: outcomes, tables, generated surfaces."""

import json
import subprocess
import sys
from pathlib import Path

from solids import box

import adaptsize as ads

ROOT = Path(__file__).parents[2]


def surfaces(*options):
    command = [sys.executable, "benchmarks/surfaces.py", *map(str, options)]
    return subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True)


def test_a_folder_of_surfaces_is_tabulated(tmp_path):
    folder = tmp_path / "parts"
    folder.mkdir()
    ads.write(folder / "good.stl", box(1.0, 1.0, 1.0))
    (folder / "bad.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n")
    done = surfaces(folder, "--output", tmp_path / "table.md", "--max-elements", 300)
    assert done.returncode == 0, done.stdout + done.stderr
    table = (tmp_path / "table.md").read_text()
    assert "| good.stl | 12 |" in table
    assert "2 files: 1 kept, 1 refused." in table


def test_nasty_surfaces_are_fixed_by_their_seed_and_tabulated_by_defect(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    from _nasty_surfaces import write_surfaces

    folder, again = tmp_path / "nasty", tmp_path / "again"
    write_surfaces(folder, 20, 5)
    write_surfaces(again, 20, 5)
    files = sorted(folder.iterdir())
    assert [f.read_bytes() for f in files] == [f.read_bytes() for f in sorted(again.iterdir())]
    assert len({f.stem[4:] for f in files}) == 20
    assert {f.suffix for f in files} == {".off", ".stl"}
    rows = [
        {"file": f.name, "kind": "refused", "outcome": "", "CPU s": 1.0, "MB": 9} for f in files
    ]
    output = tmp_path / "table.md"
    store = tmp_path / "table.md.jsonl"
    store.write_text("".join(json.dumps(row) + "\n" for row in rows))
    options = (folder, "--nasty", 20, "--seed", 5, "--output", output)
    done = surfaces(*options)
    assert done.returncode == 0, done.stderr
    assert "| fins | 1 |  |  |  | 1 |  | 1 | 1 | 9 |" in output.read_text()
    assert "20 files: 20 refused." in output.read_text()
