"""Pages of scenes that can be turned, from the files of examples and the viewer of `report`.

They are written into the site when it is built: ``_static/scenes/NAME.html`` of
``figures/NAME.scenes.json``.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import gallery
from sphinx.application import Sphinx

from adaptsize.reporting.page import SCENE

FIGURES = Path(__file__).parents[1] / "figures"
STYLE = """body { box-sizing: border-box; display: flex; flex-direction: column; height: 100vh;
  margin: 0; max-width: none; padding: 0; }
.scene { flex: 1; height: auto; min-height: 0; }
#note { margin: 0.3rem 0; }"""


def page_of(name: str, data: str) -> str:
    """Return the page of scenes from their data, which are JSON."""
    viewer = files("adaptsize.reporting.page")
    style, script = (viewer.joinpath(one).read_text("utf-8") for one in ("page.css", "viewer.js"))
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{name}: a scene that can be turned</title>",
            f"<style>{style}\n{STYLE}</style></head><body>",
            SCENE,
            f"<script>const DATA = {data.replace('<', chr(92) + 'u003c')};\n{script}</script>",
            "</body></html>",
        ]
    )


def write_scenes(app: Sphinx, error: Exception | None) -> None:
    """Write the pages of all scenes."""
    folder = Path(app.outdir) / "_static" / "scenes"
    folder.mkdir(parents=True, exist_ok=True)
    for file in FIGURES.glob(f"*{gallery.SCENES}"):
        target = folder / gallery.scene_page(file.name)
        name = file.name.removesuffix(gallery.SCENES).replace("_", " ")
        target.write_text(page_of(name, file.read_text(encoding="utf-8")), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("build-finished", write_scenes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
