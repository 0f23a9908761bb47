"""The gallery: a page per example, made from its docstring, its pictures and its code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

# What Persson's paper shows, and where no example answers: the page that does.
FIGURES = {
    1: "background grids",
    2: "a shock of the distance, between two parabolas",
    3: "medial axes of planar shapes",
    4: "gradient limiting in one dimension",
    5: "sizes from the curvature of a boundary",
    6: "a slit between small sizes and large ones",
    7: "curvature, feature size and gradient limiting together",
    8: "a size function of a geometry with smooth boundaries",
    9: "a size function in space, and tetrahedra",
    10: "narrow regions in space",
    11: "the schemes on a Cartesian grid",
    12: "adaptation for compressible flow over a bump",
    13: "objects in an image",
    14: "g(x), different from place to place",
    15: "g(h), different from size to size",
}
# The subjects of the gallery, in their order; examples that nobody listed come last.
SUBJECTS = {
    "Start here": ["plot_point_source", "plot_bracket", "plot_image", "fem_loop"],
    "Gradient limiting": [
        "plot_one_dimension", "plot_two_sources", "plot_slit", "plot_exact_maze", "plot_sources",
        "plot_grid_schemes", "plot_space_dependent_g", "plot_g_of_h", "plot_g_on_a_domain",
        "plot_backgrounds", "plot_great_circles", "plot_sparse_sizes",
    ],
    "Geometry: distance, curvature, width": [
        "plot_distance", "plot_medial_axis", "plot_curved_boundary", "plot_feature_and_curvature",
        "plot_width", "plot_level_set_curvature", "plot_octree",
    ],
    "Meshes of parts, scans, images and implicit domains": [
        "plot_scan", "plot_two_regions", "plot_volume", "plot_smooth_boundaries",
        "plot_implicit_background", "plot_mesh_family", "plot_cost",
    ],
    "Adaptive solutions": [
        "plot_lshape", "plot_fichera", "plot_hot_spot", "plot_front", "plot_moving_spot",
        "plot_goal", "plot_euler_bump",
    ],
    "Anisotropic sizes": [
        "plot_metric_gradation", "plot_anisotropic_layers", "plot_boundary_layer",
        "plot_euler_anisotropic",
    ],
}  # fmt: skip
#: Suffix of files with scenes for the viewer of `report`.
SCENES = ".scenes.json"
ELSEWHERE = {2: "[how the medial axis is found](../width.md#the-medial-axis-of-the-paper)"}


@dataclass(frozen=True)
class Example:
    """One script: title, caption and text of its docstring, and the pictures it writes."""

    path: Path
    title: str
    caption: str
    text: str
    code: str
    pictures: tuple[str, ...]
    scenes: tuple[str, ...]
    figures: tuple[int, ...]
    first_line_of_code: int

    @property
    def name(self) -> str:
        """The name of the script and of its page, such as ``plot_slit``."""
        return self.path.stem

    @property
    def thumbnail(self) -> str:
        """The square picture on its card."""
        return self.pictures[0].replace(".png", ".thumb.png")


def read_examples(folder: Path) -> list[Example]:
    """Return the examples in a folder, those of the paper's figures first, in their order."""
    examples = [read_example(path) for path in folder.glob("[!_]*.py")]
    return sorted(examples, key=lambda e: (e.figures or (99,), e.name))


def read_example(path: Path) -> Example:
    """Return what a script says of itself; it is not run."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstring = ast.get_docstring(tree)
    if not docstring:
        raise ValueError(f"{path.name} has no docstring, of which its page would be made")
    title, _, text = docstring.partition("\n")
    text, code = essential_lines(path.name, text)
    caption, _, text = text.partition("\n\n")
    numbers = re.findall(r"Figures? ((?:\d+(?:, | and )?)+)", docstring)
    figures = sorted({int(number) for found in numbers for number in re.findall(r"\d+", found)})
    return Example(
        path=path,
        title=title.rstrip("."),
        caption=" ".join(caption.split()),
        text=text,
        code=code,
        pictures=tuple(dict.fromkeys(_written(tree, ".png")))
        or (f"{path.stem.removeprefix('plot_')}.png",),
        scenes=tuple(dict.fromkeys(_written(tree, SCENES))),
        figures=tuple(figures),
        first_line_of_code=tree.body[1].lineno,
    )


def essential_lines(name: str, text: str) -> tuple[str, str]:
    """Return the text above the code block of a docstring, and the code.

    Below it there is only how to run the script.
    """
    blocks = re.split(r"^```(?:python)?$\n?", text, flags=re.MULTILINE)
    if len(blocks) != 3:
        raise ValueError(f"{name} must have one block ```python in its docstring")
    return blocks[0].strip(), blocks[1]


def missing_pictures(examples: Sequence[Example], figures: Path) -> list[str]:
    """Return one line for each picture that an example writes and the folder does not have."""
    return [
        f"{example.path.name} writes {picture}, which is not in {figures.name}: make gallery"
        for example in examples
        for picture in (*example.pictures, example.thumbnail, *example.scenes)
        if not (figures / picture).is_file()
    ]


def scene_page(name: str) -> str:
    """Return the name of the page with scenes from a file in ``figures``."""
    return name.removesuffix(SCENES) + ".html"


def _viewer(example: Example, name: str) -> str:
    """Return what opens scenes in the page; they are loaded when they are opened."""
    return (
        f'<details class="turned"><summary>Turn this in 3-D</summary>'
        f'<iframe src="../_static/scenes/{scene_page(name)}" loading="lazy" '
        f'title="{example.title}: a scene that can be turned"></iframe></details>'
    )


def page_of(example: Example) -> str:
    """Return the page of an example, in Markdown, for a folder beside ``figures``."""
    script = f"../../examples/{example.path.name}"
    alt = re.split(r"(?<=[.:]) ", example.caption)[0].rstrip(".:")
    pictures = [f"![{alt}](../figures/{picture})" for picture in example.pictures]
    whole = [
        f"```{{literalinclude}} {script}",
        ":language: python",
        f":lines: {example.first_line_of_code}-",
        "```",
    ]
    parts = [
        f"# {example.title}",
        *pictures,
        *(_viewer(example, name) for name in example.scenes),
        f":::{{container}} caption\n{example.caption}\n:::",
        example.text,
        "## The essential lines",
        "They run as they are in a clone of the repository, and are shorter than the script that "
        "draws the picture.",
        f"```python\n{example.code}```",
        "## The whole script",
        f"[Download {example.path.name}]({script}). What it shares with other examples is in "
        "[_gallery.py](../../examples/_gallery.py). In a clone, "
        f"`python examples/{example.path.name}` writes its pictures to `examples/output/`.",
        "<details><summary>Show the script</summary>",
        "\n".join(whole),
        "</details>",
        "[All examples](index.md)",
    ]
    return "\n\n".join(parts) + "\n"


def index_of(examples: Sequence[Example]) -> str:
    """Return the first page of the gallery: the figures of the paper, then all pictures."""
    rows = []
    for number, subject in FIGURES.items():
        answers = [f"[{e.title}]({e.name}.md)" for e in examples if number in e.figures]
        shown = "; ".join(answers) or ELSEWHERE.get(number, "")
        rows.append(f"| {number} | {subject} | {shown} |")
    return "\n".join(
        [
            "# Gallery",
            "",
            "Each page has a picture, the essential lines of its method, which run as they are in",
            "a clone of the repository, and the script in `examples/` that draws the picture.",
            "",
            *_cards(examples),
            "## Figure by figure",
            "",
            "The figures of Persson's paper and the examples that reproduce them:",
            "",
            "| figure | of | here |",
            "|---:|---|---|",
            *rows,
            "",
            "```{toctree}",
            ":hidden:",
            "",
            *[f"{e.title} <{e.name}>" for _, chosen in _by_subject(examples) for e in chosen],
            "```",
            "",
        ]
    )


def _by_subject(examples: Sequence[Example]) -> Iterator[tuple[str, list[Example]]]:
    """Yield each subject with its examples."""
    by_name = {e.name: e for e in examples}
    listed = {name for names in SUBJECTS.values() for name in names}
    for subject, names in {**SUBJECTS, "More": sorted(set(by_name) - listed)}.items():
        if chosen := [by_name[name] for name in names if name in by_name]:
            yield subject, chosen


def _cards(examples: Sequence[Example]) -> Iterator[str]:
    """Yield the cards of the examples under the headings of their subjects."""
    for subject, chosen in _by_subject(examples):
        yield f"## {subject}\n\n:::::{{container}} gallery"
        yield from (_card(e) for e in chosen)
        yield ":::::\n"


def _card(example: Example) -> str:
    link = f"{example.name}.md"
    return "\n".join(
        [
            "::::{container} card",
            f"[![{example.title}](../figures/{example.thumbnail})]({link})",
            "",
            f"[{example.title}]({link})",
            "::::",
        ]
    )


def _written(tree: ast.Module, suffix: str) -> Iterator[str]:
    """Yield the names in ``output_dir / "name.png"``, for a suffix."""
    for node in ast.walk(tree):
        match node:
            case ast.BinOp(
                left=ast.Name(id="output_dir"), op=ast.Div(), right=ast.Constant(value=str(name))
            ) if name.endswith(suffix):
                yield name
