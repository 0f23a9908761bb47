"""Run the examples and put their pictures into docs/figures, each below 200 kB.

    python docs/_ext/refresh_pictures.py [NAME ...]

Takes about ten minutes for all; names such as plot_slit choose some.  Needs adaptsize[mmg], and the
program pngquant, which reduces pictures to 256 colours.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import gallery
from PIL import Image

ROOT = Path(__file__).parents[2]
FIGURES = ROOT / "docs" / "figures"
LARGEST = 200_000  # bytes of a picture in the repository
WIDEST = 1800  # pixels


def main(names: list[str]) -> None:
    """Refresh the pictures of the examples with these names, of all if there are none."""
    examples = gallery.read_examples(ROOT / "examples")
    if unknown := set(names) - {example.name for example in examples}:
        sys.exit(f"no example is called {', '.join(sorted(unknown))}; names are like plot_slit")
    for example in examples:
        if names and example.name not in names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, str(example.path), folder], check=True)
            put(example, Path(folder))


def put(example: gallery.Example, folder: Path) -> None:
    """Put the pictures of an example from a folder into docs/figures."""
    for picture in (*example.pictures, example.thumbnail):
        size = shrink(folder / picture, FIGURES / picture)
        print(f"{picture}: {size / 1000:.0f} kB", flush=True)
    for name in example.scenes:
        shutil.copy(folder / name, FIGURES / name)


def shrink(source: Path, target: Path) -> int:
    """Write a picture with a palette, smaller if it must be; return its size in bytes."""
    picture = Image.open(source).convert("RGBA")
    width = min(picture.width, WIDEST)
    while True:
        height = round(picture.height * width / picture.width)
        # Premultiplied, so that transparent pixels do not darken the edges.
        scaled = picture.convert("RGBa").resize((width, height), Image.Resampling.LANCZOS)
        scaled.convert("RGBA").save(target)
        words = ["pngquant", "--force", "--strip", "--speed", "1", "--nofs", "--output"]
        subprocess.run([*words, str(target), "256", str(target)], check=True)
        if (size := target.stat().st_size) <= LARGEST:
            return size
        width = int(0.9 * width)


if __name__ == "__main__":
    main(sys.argv[1:])
