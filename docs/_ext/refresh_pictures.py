"""Run the examples and put their pictures into docs/figures, each below 200 kB.

    python docs/_ext/refresh_pictures.py [NAME ...]

Takes about ten minutes for all; names such as plot_slit choose some.  Needs adaptsize[mmg].
"""

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
    for example in gallery.read_examples(ROOT / "examples"):
        if names and example.name not in names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, str(example.path), folder], check=True)
            for picture in example.pictures:
                size = shrink(Path(folder, picture), FIGURES / picture)
                print(f"{picture}: {size / 1000:.0f} kB", flush=True)


def shrink(source: Path, target: Path) -> int:
    """Write a picture with a palette, smaller if it must be; return its size in bytes."""
    picture = Image.open(source).convert("RGB")
    width = min(picture.width, WIDEST)
    while True:
        height = round(picture.height * width / picture.width)
        scaled = picture.resize((width, height), Image.Resampling.LANCZOS)
        # The default palette of Pillow loses rare dark colours, such as those of lines.
        palette = scaled.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        palette.save(target, optimize=True)
        if (size := target.stat().st_size) <= LARGEST:
            return size
        width = int(0.9 * width)


if __name__ == "__main__":
    main(sys.argv[1:])
