"""Run fTetWild alone on a surface: python _tetwild_alone.py PART OUT.npz EPSILON."""

import sys

import numpy as np
from judge import read_surface
from pytetwild import tetrahedralize


def main():
    part, output, epsilon = sys.argv[1:]
    points, triangles = read_surface(part)
    points, cells = tetrahedralize(
        np.ascontiguousarray(points, float),
        np.ascontiguousarray(triangles, np.int32),
        epsilon=float(epsilon),
        vtk_ordering=True,
    )
    np.savez(output, points=points, cells=cells)


if __name__ == "__main__":
    main()
