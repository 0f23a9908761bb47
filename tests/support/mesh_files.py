"""Small meshes to write into files, and files of arbitrary cells."""

import meshio
import numpy as np
from meshes import jittered_cube, random_square

from adaptsize import SimplexMesh

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
TWO_TRIANGLES = [[0, 1, 2], [0, 2, 3]]


def tagged_mesh(dim):
    """A mesh with regions, a tagged boundary, and fields of several shapes and types."""
    mesh = random_square(40, 7301) if dim == 2 else jittered_cube(4, 7302)
    rng = np.random.default_rng(7303)
    boundary = mesh.boundary()
    return SimplexMesh(
        mesh.points,
        mesh.cells,
        cell_tags=rng.integers(0, 4, mesh.n_cells),
        tagged_facets=boundary.nodes[boundary.mesh.cells],
        facet_tags=rng.integers(4, 9, boundary.mesh.n_cells),
        point_data={
            "h": rng.random(mesh.n_points),
            "velocity": rng.random((mesh.n_points, 3)),
            "number": np.arange(mesh.n_points),
        },
        cell_data={"quality": rng.random(mesh.n_cells), "rank": np.arange(mesh.n_cells)},
    )


def write_raw(file, points, cells, **options):
    meshio.write(file, meshio.Mesh(np.asarray(points, float), cells, **options))
    return file
