"""The benchmark that remeshes folders of surfaces: outcomes and table."""

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
