"""A generator that misses the expected number of elements by a known factor."""

import math

import numpy as np
import pytest
from meshes import structured_square

from adaptsize import SimplexMesh
from adaptsize.adaptation import cycle, new_mesh
from adaptsize.remeshing import protocol
from adaptsize.remeshing.driver import Remeshed
from adaptsize.sizes import predict
from adaptsize.sizes.budget import count_elements


@pytest.fixture
def generator(monkeypatch):
    """Replaces the generator by one that makes ``made.factor`` times the cells expected."""

    class Generator:
        factor = 1.0
        calls = 0

        def __call__(self, mesh, size, **options):
            self.calls += 1
            n_cells = self.factor * predict(mesh, size.values).cells
            made = structured_square(max(1, round(math.sqrt(n_cells / 2.0))), half_width=1.0)
            if mesh.cell_tags is None:
                return made
            return SimplexMesh(made.points, made.cells, cell_tags=np.zeros(made.n_cells, int))

    made = Generator()
    monkeypatch.setattr(new_mesh, "trial", lambda *a, **k: Remeshed(made(*a, **k), None))
    monkeypatch.setattr(protocol, "find_spec", lambda package: True)
    # Unlike Mmg, it keeps no cells.
    monkeypatch.setattr(cycle, "triangles_by_mmg", lambda mesh, h, stays: count_elements(mesh, h))
    return made
