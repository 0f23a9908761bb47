"""Make coast.geojson: a fractal mainland, islands, and the open boundary of the sea between them.

Coordinates are metres in a plane.  The mainland, the islands and the open sea are lines with names.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

#: Middles and mean radii of the islands in kilometres.
_ISLANDS = [(0, 12, 22), (-58, 8, 6), (-48, 22, 3), (62, 24, 5), (70, 12, 2.5), (46, -12, 2)]
_PER_RING = 160


def _rough(n: int, roughness: float, seed: int) -> Any:
    """Return n values of a random fractal line that begins and ends at 0."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, 300)
    wave = np.sin(np.pi * np.linspace(0.0, 1.0, n)[:, None] * k)
    return wave @ (rng.normal(size=len(k)) * k**-roughness)


def _feature(name: str, kind: str, coordinates: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


def _metres(line: Any) -> list[list[int]]:
    return np.rint(1000.0 * np.asarray(line)).astype(int).tolist()


def main() -> None:
    """Write the file beside this one."""
    x = np.linspace(-100.0, 100.0, 2000)
    shore = np.column_stack([x, 55.0 + 14.0 * _rough(len(x), 1.3, seed=1)])
    sea = [shore[-1], (100.0, -100.0), (-100.0, -100.0), shore[0]]
    islands = []
    for seed, (east, north, radius) in enumerate(_ISLANDS, 4):
        angle = np.linspace(0.0, 2.0 * np.pi, _PER_RING)
        away = radius * (1.0 + 0.25 * _rough(_PER_RING, 1.4, seed))
        islands.append((east + away * np.cos(angle), north + 0.6 * away * np.sin(angle)))
    features = [
        _feature("land", "LineString", _metres(shore)),
        _feature("open sea", "LineString", _metres(sea)),
        _feature("island", "MultiLineString", [_metres(np.transpose(i)) for i in islands]),
    ]
    collection = {"type": "FeatureCollection", "features": features}
    Path(__file__).with_name("coast.geojson").write_text(json.dumps(collection) + "\n")


if __name__ == "__main__":
    main()
