"""Draw the logo: equilateral triangles around a small one, each larger by a bounded ratio.

    python docs/_ext/make_logo.py

Each triangle is attached to the longest side of all before it.  Their sides are the numbers of
Padovan, 1, 1, 1, 2, 2, 3, 4, 5, 7, 9 ..., whose ratio tends to 1.3247: a mesh with 1 + g = 1.32.
The colours are those of sizes in the pictures.  Writes `docs/_static/logo.svg`.
"""

import math
from pathlib import Path

FILE = Path(__file__).parents[1] / "_static" / "logo.svg"
SIDE = 128.0
COUNT = 11
#: Viridis, from the smallest size to the largest.
COLOURS = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"]


def triangles():
    """Return the corners of all triangles, as complex numbers."""
    turn = complex(0.5, -math.sqrt(0.75))  # by -60 degrees: to the right of a side
    polygon = [0j, 1 + 0j, complex(0.5, math.sqrt(0.75))]  # counter-clockwise
    made = [tuple(polygon)]
    while len(made) < COUNT:
        n = len(polygon)
        sides = [abs(polygon[(i + 1) % n] - polygon[i]) for i in range(n)]
        # The last of equal sides, so that the spiral keeps its sense.
        i = max(range(n), key=lambda k: (round(sides[k], 6), k))
        a, b = polygon[i], polygon[(i + 1) % n]
        apex = a + (b - a) * turn
        made.append((a, apex, b))
        polygon = _without_straight([*polygon[: i + 1], apex, *polygon[i + 1 :]])
    return made


def _without_straight(polygon):
    """Return a polygon without the corners at which it goes straight on."""
    n = len(polygon)
    kept = []
    for i, corner in enumerate(polygon):
        before, after = corner - polygon[i - 1], polygon[(i + 1) % n] - corner
        if abs((before.conjugate() * after).imag) > 1e-9:
            kept.append(corner)
    return kept


def colour(share):
    """Return the colour between those of the list."""
    place = share * (len(COLOURS) - 1)
    k = min(int(place), len(COLOURS) - 2)
    low, high = ([int(COLOURS[i][j : j + 2], 16) for j in (1, 3, 5)] for i in (k, k + 1))
    return "#" + "".join(
        f"{round(a + (place - k) * (b - a)):02x}" for a, b in zip(low, high, strict=True)
    )


def picture():
    """Return the file's text."""
    made = triangles()
    corners = [z for triangle in made for z in triangle]
    left, right = min(z.real for z in corners), max(z.real for z in corners)
    low, high = min(z.imag for z in corners), max(z.imag for z in corners)
    scale = 0.96 * SIDE / max(right - left, high - low)
    middle = complex(left + right, low + high) / 2.0
    largest = math.log(max(abs(t[1] - t[0]) for t in made))
    lines = []
    for triangle in made:
        moved = [(z - middle) * scale for z in triangle]
        points = " ".join(f"{SIDE / 2 + z.real:.2f},{SIDE / 2 - z.imag:.2f}" for z in moved)
        share = math.log(abs(triangle[1] - triangle[0])) / largest
        width = min(1.5, 0.1 * abs(moved[1] - moved[0]))
        lines.append(
            f'<polygon points="{points}" fill="{colour(share)}" stroke-width="{width:.2f}"/>'
        )
    content = "\n".join(lines)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE:g} {SIDE:g}" role="img" '
        f'aria-label="adaptsize">\n<g stroke="#ffffff" '
        f'stroke-linejoin="round">\n{content}\n</g>\n</svg>\n'
    )


if __name__ == "__main__":
    FILE.write_text(picture(), encoding="utf-8")
