"""Sparse sizes are the limited ones in convex domains, and nowhere larger in others."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from meshes import jittered_cube
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.domain_size import SparseSize
from adaptsize.errors import MeshFileError

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "sparse-sizes.md").read_text(encoding="utf-8")


def square(n=400, seed=20261124):
    points = np.random.default_rng(seed).random((n, 2))
    points[:4] = [[0, 0], [1, 0], [1, 1], [0, 1]]
    return ads.SimplexMesh(points, Delaunay(points).simplices)


def cube():
    mesh = jittered_cube(6, 20261124)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return ads.SimplexMesh((mesh.points - low) / (high - low), mesh.cells)


@pytest.mark.parametrize("mesh", [square(), cube()])
def test_sizes_from_points_are_the_limited_ones_everywhere_in_a_convex_domain(mesh):
    rng = np.random.default_rng(20261125)
    places = rng.random((9, mesh.dim))
    smallest = rng.uniform(0.01, 0.1, 9)
    h, info = ads.limit_gradient.with_info(
        mesh, np.full(mesh.n_points, np.inf), 0.25, point_sources=(places, smallest)
    )
    size = ads.SizeFunction(mesh, h, sources=info.sources)
    sparse = size.sparse(0.25)
    assert len(sparse.sizes) <= 9
    inside = rng.dirichlet(np.ones(mesh.dim + 1), mesh.n_cells)
    at = np.einsum("ij,ijd->id", inside, mesh.points[mesh.cells])
    np.testing.assert_allclose(sparse(at), size(at), rtol=1e-11)


@pytest.mark.parametrize("face_sources", [False, True])
def test_nodal_sizes_of_any_bound_in_a_convex_domain_are_kept(face_sources):
    mesh = square()
    h0 = np.where(np.arange(400) % 7 == 0, 0.05 + 0.3 * mesh.points[:, 0] ** 2, np.inf)
    scheme = ads.limiting.Exact(face_sources=face_sources)
    size = ads.SizeFunction(mesh, ads.limit_gradient(mesh, h0, 0.25, method=scheme))
    sparse = size.sparse(0.25)
    np.testing.assert_allclose(sparse(mesh.points), size.values, rtol=1e-11)
    assert len(sparse.sizes) < 100  # of 400 nodes, 58 with a bound


def test_sizes_are_nowhere_larger_where_walls_bend_paths():
    mesh = ads.read(ROOT / "data" / "slit.vtu")
    h, info = ads.limit_gradient.with_info(mesh, mesh.point_data["h0"], 0.15)
    sparse = ads.SizeFunction(mesh, h, sources=info.sources).sparse(0.15)
    found = sparse(mesh.points)
    assert (found <= h * (1.0 + 1e-11)).all()
    assert found.min() == h.min()
    assert (found < 0.5 * h).any()  # straight through the slit


def test_without_a_gradient_limit_there_are_no_sparse_sizes():
    with pytest.raises(ValueError, match="g must be given"):
        ads.SizeFunction(square(), np.full(400, 0.1)).sparse()


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_files_keep_every_bit_and_damaged_ones_are_refused(tmp_path, suffix):
    points = np.random.default_rng(20261126).random((5, 3))
    sparse = SparseSize(points, points[:, 0] + 0.1, 0.3, np.inf)
    path = tmp_path / f"sizes{suffix}"
    sparse.write(path)
    again = SparseSize.read(path)
    assert (again.g, again.hmax) == (0.3, np.inf)
    np.testing.assert_array_equal(again.points, points)
    np.testing.assert_array_equal(again.sizes, sparse.sizes)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(MeshFileError, match=suffix):
        SparseSize.read(path)
    with pytest.raises(ValueError, match=r"path must end in \.csv or \.npz"):
        sparse.write(tmp_path / "sizes.txt")


def written(tmp_path):
    """Return sparse sizes, their file, and 100 points with the sizes there."""
    rng = np.random.default_rng(20261127)
    sparse = SparseSize(rng.random((20, 2)), rng.uniform(0.01, 0.1, 20), 0.25, 0.2)
    sparse.write(tmp_path / "sizes.csv")
    points = rng.random((100, 2))
    return points, sparse(points)


def test_the_lines_of_python_on_the_page_evaluate_the_file(tmp_path, monkeypatch):
    points, expected = written(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(re.search(r"<!-- python -->\n```python\n(.*?)```", PAGE, re.DOTALL)[1], names)
    np.testing.assert_allclose(names["size"](points), expected, rtol=1e-14)


def test_the_lines_of_c_on_the_page_evaluate_the_file(tmp_path):
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no compiler of C")
    points, expected = written(tmp_path)
    code = re.search(r"```c\n(.*?)```", PAGE, re.DOTALL)[1]
    main = """int main(void) {
        double x[2];
        load("sizes.csv");
        while (scanf("%lf %lf", x, x + 1) == 2) printf("%.17g\\n", size(x));
    }"""
    (tmp_path / "sizes.c").write_text(code + main)
    subprocess.run([compiler, "sizes.c", "-o", "sizes", "-lm"], cwd=tmp_path, check=True)
    text = "\n".join(f"{x!r} {y!r}" for x, y in points.tolist())
    done = subprocess.run(
        [tmp_path / "sizes"], cwd=tmp_path, input=text, capture_output=True, text=True, check=True
    )
    np.testing.assert_allclose(np.array(done.stdout.split(), float), expected, rtol=1e-14)
