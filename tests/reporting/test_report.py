"""The page about a mesh: complete, without references to the network, and shown by a browser."""

import base64
import json
import re
import shutil
import subprocess
import zlib
from dataclasses import replace

import numpy as np
import pytest
from meshes import jittered_square
from PIL import Image

from adaptsize import CartesianGrid, PointSource, SizeFunction, report, size_function
from adaptsize.reporting.page.scenes import data_of, scenes_of_mesh

#: A cube in 4^3 smaller ones of six tetrahedra each.
CUBE = CartesianGrid((0.0, 0.0, 0.0), 0.25, (5, 5, 5)).mesh
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def square():
    mesh = jittered_square(12, 1, half_width=0.5)
    source = PointSource([0.1, 0.1], 0.02)
    size = size_function(mesh, sources=source, hmax=0.2)
    return mesh, size


def test_the_page_has_the_findings_and_nothing_to_fetch(square, tmp_path):
    mesh, size = square
    path = tmp_path / "square.html"
    about = {"input": "a < b.stl"}
    report(path, mesh, size, original=mesh, times=[("sizes", 1.5)], about=about)
    text = path.read_text(encoding="utf-8")
    assert "<title>square: triangles</title>" in text
    assert f"{mesh.n_cells} triangles, {size.report.n_elements:.0f} predicted" in text
    assert "1.5 s: sizes 1.5" in text
    head = dict(re.findall(r"<tr><th>(\w+)</th><td>([^<]*)</td></tr>", text))
    assert head["input"] == "a &lt; b.stl"
    assert head.keys() >= {"date", "version", "units"}
    fetched = re.findall(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=[^>]*>", text)
    assert fetched == []
    assert list(tmp_path.iterdir()) == [path]


def test_worst_places_are_listed_and_names_cannot_break_out_of_the_page(square, tmp_path):
    mesh, *_ = square
    size = SizeFunction(mesh, np.full(mesh.n_points, 5.0))
    report(tmp_path / "x.html", mesh, size, title="<script>alert(1)</script>")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert "<script>alert(1)" not in text
    assert "failed" in text
    (worst, *_) = re.findall(r'<button data-at="(\[.*?\])">.*? degrees at \((.*?)\)', text)
    assert worst[0] == f"[{worst[1]}]"


def test_tetrahedra_are_shown_whole_and_cut_open():
    mesh = CUBE
    size = SizeFunction(mesh, np.full(mesh.n_points, 0.25))
    views = scenes_of_mesh(mesh, size)
    whole, cut = views["size h"], views["size h, cut open"]
    assert len(whole.cells) == len(mesh.boundary().mesh.cells)
    assert np.ptp(cut.points[np.unique(cut.cells)], axis=0).min() == pytest.approx(0.5)
    ratio = views["edge length over size"]
    assert 1.0 <= ratio.values.min() < ratio.values.max() <= np.sqrt(3.0)  # edges 1/4 to sqrt(3)/4


def test_the_page_has_the_points_and_values_of_its_scenes():
    size = SizeFunction(CUBE, 0.1 + 2.0 * CUBE.points[:, 0])
    scenes = scenes_of_mesh(CUBE, size)
    data = json.loads(json.dumps(data_of(scenes)))
    assert len(data["geometries"]) == 2  # cut open, and whole
    number = list(scenes).index("size h")
    found, scene = data["scenes"][number], scenes["size h"]
    geometry = data["geometries"][found["geometry"]]
    steps, cells, values = (
        np.frombuffer(zlib.decompress(base64.b64decode(packed)), kind)
        for kind, packed in (
            ("<u2", geometry["points"]), ("<u4", geometry["cells"]), ("<u1", found["values"])
        )
    )  # fmt: skip
    points = geometry["low"] + steps.reshape(-1, 3) / 65535.0 * geometry["size"]
    np.testing.assert_allclose(points[cells], scene.points[scene.cells.ravel()], atol=1e-5)
    assert found["logarithmic"]
    h = found["low"] * (found["high"] / found["low"]) ** (values / 255.0)
    np.testing.assert_allclose(h[cells], scene.values[scene.cells.ravel()], rtol=0.01)


def test_more_than_256_regions_keep_their_numbers():
    mesh = jittered_square(16, 1, half_width=0.5)
    mesh = replace(mesh, cell_tags=np.arange(1, mesh.n_cells + 1))
    scenes = scenes_of_mesh(mesh, None)
    number = list(scenes).index("region")
    found = data_of(scenes)["scenes"][number]
    places = np.frombuffer(zlib.decompress(base64.b64decode(found["values"])), "<u4")
    names = np.array([name for _, name in found["ticks"]])
    assert len(names) > 256
    assert names[places].tolist() == [f"{tag:g}" for tag in scenes["region"].values]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_without_network_draws_the_page(square, tmp_path):
    mesh, size = square
    report(tmp_path / "square.html", mesh, size)
    picture = tmp_path / "square.png"
    words = "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader"
    words += " --disable-background-networking --no-first-run --virtual-time-budget=15000"
    words += " --window-size=1000,1600 --enable-logging=stderr --hide-scrollbars"
    done = subprocess.run(
        [
            CHROMIUM,
            *words.split(),
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={tmp_path / 'profile'}",
            f"--screenshot={picture}",
            (tmp_path / "square.html").as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
    )
    logged = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert [line for line in logged if "error" in line.lower()] == []
    drawn = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3)
    assert len(np.unique(drawn, axis=0)) > 500  # the colours of the sizes, which are drawn


def test_regions_and_faces_are_listed_by_name_in_the_colours_of_their_scenes(tmp_path):
    regions = 3 + (CUBE.points[CUBE.cells].mean(axis=1)[:, 0] > 0.5)
    skin = CUBE.facets[CUBE.facet_cell_counts == 1]
    left = (CUBE.points[skin][:, :, 0] == 0.0).all(axis=1)
    mesh = replace(
        CUBE,
        cell_tags=regions,
        tagged_facets=skin,
        facet_tags=np.where(left, 5, 9),
        tag_names={(3, 4): "steel", (2, 5): "inlet <1>"},
    )
    report(tmp_path / "x.html", mesh)
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    row = r"<tr><th>(region|face) (\d)</th><td><span[^>]*background: (#\w+)\"></span> ([^<]*)</td>"
    rows = re.findall(row, text)
    colours = {f"{kind} {tag}": colour for kind, tag, colour, _ in rows}
    assert [name for *_, name in rows] == ["", "steel", "inlet &lt;1&gt;", ""]
    assert text.count("volume 0.5<") == 2
    assert "area 1<" in text
    scenes = scenes_of_mesh(mesh, None)
    for label in ("region, cut open", "region", "face"):
        scene = scenes[label]
        found = data_of({label: scene})["scenes"][0]
        for place, tag in enumerate(scene.names):
            kind = label.partition(",")[0]
            assert found["colours"][place] == colours[f"{kind} {tag:.0f}"]


def test_a_region_has_one_colour_also_where_others_are_hidden():
    inner = (np.abs(CUBE.points[CUBE.cells].mean(axis=1) - 0.5) < 0.25).all(axis=1)
    mesh = replace(CUBE, cell_tags=np.where(inner, 1, 2))  # region 1 is inside
    scenes = scenes_of_mesh(mesh, None)
    data = data_of({name: scenes[name] for name in ("region", "region, cut open")})
    ticks = [[label for _, label in scene["ticks"]] for scene in data["scenes"]]
    assert ticks == [["1", "2"], ["1", "2"]]
