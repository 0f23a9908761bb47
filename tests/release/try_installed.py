"""Try an installed package: import, limit, remesh a sample, and the command.

    python tests/release/try_installed.py DATA

Run it outside of the repository's environment, after ``pip install adaptsize``.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import adaptsize as ads


def main(data: Path) -> None:
    """Raise an error if a step fails or gives a wrong result."""
    print(sys.version.split()[0], ads.__version__, Path(ads.__file__).parent)
    mesh = ads.read(data / "slit.vtu")
    h = ads.limit_gradient(mesh, mesh.point_data["h0"], g=0.3)
    i, j = mesh.edges.T
    slopes = np.abs(h[i] - h[j]) / mesh.edge_lengths
    assert slopes.max() <= 0.3 * (1.0 + 1e-12), slopes.max()
    cube = ads.CartesianGrid((0.0, 0.0, 0.0), 0.5, (3, 3, 3)).mesh.boundary().mesh
    solid = ads.remesh(cube, 0.3)
    volume = float(solid.measures.sum())
    assert solid.cell_dim == 3, solid
    assert abs(volume - 1.0) < 0.01, volume
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "size.vtu")
        words = [sys.executable, "-m", "adaptsize", "size", str(data / "slit.vtu")]
        subprocess.run([*words, "-o", str(output)], check=True)
        assert "h" in ads.read(output).point_data
    print("works:", {n: b.installed for n, b in ads.remeshing.available_backends().items()})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
