"""``--report`` of the commands that check a mesh."""

from pathlib import Path

import numpy as np
import pytest
from command_line import call

from adaptsize import CartesianGrid, write


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["check", "plate.vtu", "--original", "plate.vtu"], "boundary"),
        (["check", "plate.vtu", "--field", "u"], "served"),
        (["image", "disc.npy", "-o", "o.vtu"], "area"),
        (
            ["adapt", "plate.vtu", "--field", "u", "--elements", "60", "-o", "o.vtu"],
            "of the diagonal)",
        ),
    ],
)
def test_other_commands_write_a_page_too(tmp_path, monkeypatch, words, expected):
    monkeypatch.chdir(tmp_path)
    plate = CartesianGrid([0.0, 0.0], 0.25, (5, 5)).mesh
    write("plate.vtu", plate, fields={"u": 0.25 + 0.1 * plate.points[:, 0] ** 2})
    x, y = np.mgrid[-9:10, -9:10]
    np.save("disc.npy", np.hypot(x, y) < 7)
    assert call(*words, "--report", "page.html", "-q") in (0, 1)
    page = Path("page.html").read_text(encoding="utf-8")
    assert f"adaptsize {words[0]} {words[1]}" in page
    assert expected in page
    assert "<h2>Checks</h2>" in page


@pytest.mark.parametrize("command", ["check", "image", "adapt"])
def test_a_page_of_another_suffix_is_refused_before_reading(refused, command):
    more = [] if command == "check" else ["-o", "o.vtu"]
    more += ["--field", "u", "--elements", "9"] if command == "adapt" else []
    assert "--report must end in .html" in refused(command, "no.npy", *more, "--report", "a.txt")
