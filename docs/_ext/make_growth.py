"""Draw how sizes grow from their sources, frame by frame: an animation that plays once.

    python docs/_ext/make_growth.py

The plate with a slit, data/slit.vtu, has two sources: a point and a line.  A frame shows the sizes
up to a level; the level rises, and the front that bounds them goes around the slit.  The last
frames show the mesh with these sizes.  Writes `docs/_static/growth.webp`, and its last frame,
`growth.png`, for readers who prefer no motion.  Needs adaptsize[mmg].
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from PIL import Image

import adaptsize as ads
from adaptsize.plot.style import INK, NOTHING, SETTINGS

FOLDER = Path(__file__).parents[1] / "_static"
DATA = Path(__file__).parents[2] / "data"
POINT, LINE = (1.2, 2.0), [(2.6, 2.7), (3.5, 2.7)]
AT_POINT, AT_LINE, G = 0.03, 0.1, 0.15
FRAMES, SECONDS = 24, 4.0
WIDTH, HEIGHT = 720, 500  # pixels


def main() -> None:
    """Write the animation and its last frame."""
    matplotlib.rcParams.update(SETTINGS)
    plate = ads.read(DATA / "slit.vtu").without_data()
    sources = [ads.PointSource(POINT, AT_POINT), ads.CurveSource(LINE, AT_LINE)]
    fine = ads.remesh(plate, 0.04)
    h0 = ads.size_from_sources(fine, sources, g=G)
    h = ads.limit_gradient(fine, h0, G, method="fast-marching")
    new = ads.remesh(plate, ads.SizeFunction(fine, h))
    levels = np.linspace(AT_POINT, h.max(), FRAMES + 1)[1:]
    frames = [frame(fine, h, level) for level in levels]
    frames.append(frame(fine, h, levels[-1], new))
    times = [round(1000 * SECONDS / FRAMES)] * FRAMES + [1000]
    frames[0].save(
        FOLDER / "growth.webp", save_all=True, append_images=frames[1:], duration=times,
        loop=1, lossless=True, quality=60, method=3,
    )  # fmt: skip
    frames[-1].quantize(128).save(FOLDER / "growth.png", optimize=True)
    for path in sorted(FOLDER.glob("growth.*")):
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def frame(
    fine: ads.SimplexMesh, h: np.ndarray, level: float, mesh: ads.SimplexMesh | None = None
) -> Image.Image:
    """Draw the sizes up to a level, and a mesh."""
    figure = Figure((WIDTH / 100, HEIGHT / 100), dpi=100, layout="constrained")
    axes = figure.subplots()
    norm = LogNorm(AT_POINT, h.max())
    x, y = fine.points.T
    shares = np.linspace(0.0, 1.0, 28)
    steps = AT_POINT * (h.max() / AT_POINT) ** shares
    axes.tricontourf(x, y, fine.cells, h, [0.0, 2.0 * h.max()], colors=[f"{NOTHING}59"])
    shown = np.append(steps[steps < level], level)
    axes.tricontourf(x, y, fine.cells, h, shown, norm=norm, antialiased=True)
    if level < h.max():
        axes.tricontour(x, y, fine.cells, h, [level], colors=INK, linewidths=2.0)
    if mesh is not None:
        lines = list(mesh.points[mesh.edges])
        axes.add_collection(LineCollection(lines, colors="#0f1729", linewidths=0.35))
    rim = fine.points[fine.facets[fine.facet_cell_counts == 1]]
    axes.add_collection(LineCollection(list(rim), colors=INK, linewidths=1.5))
    axes.plot(*POINT, "o", color="#d55e00", markersize=6)
    axes.plot(*np.transpose(LINE), color="#d55e00", linewidth=3)
    label = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    for size, place in ((AT_POINT, POINT), (AT_LINE, LINE[0])):
        axes.annotate(
            f"h = {size}", place, (8, 9), textcoords="offset points", color="#a33c00", bbox=label
        )
    title = f"sizes up to {level:.2f}" if mesh is None else f"the mesh: {mesh.n_cells} triangles"
    axes.set_title(title, loc="left")
    axes.set(aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    mapped = matplotlib.cm.ScalarMappable(norm, "adaptsize")
    bar = figure.colorbar(mapped, ax=axes, shrink=0.8, label="mesh size h", format="%g")
    bar.set_ticks([0.03, 0.05, 0.1, 0.2, 0.3])
    bar.minorticks_off()
    bar.outline.set_visible(False)
    canvas = matplotlib.backends.backend_agg.FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba()))
    return picture.quantize(96, dither=Image.Dither.NONE).convert("RGBA")


if __name__ == "__main__":
    main()
