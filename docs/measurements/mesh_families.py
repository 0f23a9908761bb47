"""Orders of convergence on mesh families, and on meshes made by halving hmax.

Poisson's equation with a known smooth solution by linear elements of scikit-fem.  The error of the
gradient is of order 1, that of the solution of order 2.  The table of docs/mesh-families.md.

    python docs/measurements/mesh_families.py
"""

from pathlib import Path

import numpy as np

import adaptsize as ads
from adaptsize.domain_size.family import mean_cell_size

DATA = Path(__file__).parents[2] / "data"

#: Name of the file, coarsest hmax over the diameter, and further options.
CASES = {
    "slit.vtu": ("slit.vtu", {}),
    "curved.vtu": ("curved.vtu", {}),
    "lshape.vtu, point source": (
        "lshape.vtu",
        {"sources": ads.PointSource([0.0, 0.0], 0.004)},
    ),
}


def exact(x):
    """Return the solution at points x[dim, ...]."""
    return np.sin(3 * x[0] + 0.3) * np.sinh(0.5 * x[1] + 0.2) + x[0] ** 2


def gradient(x):
    """Return its gradient."""
    return (
        3 * np.cos(3 * x[0] + 0.3) * np.sinh(0.5 * x[1] + 0.2) + 2 * x[0],
        0.5 * np.sin(3 * x[0] + 0.3) * np.cosh(0.5 * x[1] + 0.2),
    )


def errors(mesh):
    """Return the L2 norms of the errors of the gradient and of the solution."""
    import skfem
    from skfem.helpers import dot, grad

    basis = skfem.Basis(mesh.to_skfem(), skfem.ElementTriP1(), intorder=6)
    stiffness = skfem.BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(basis)
    form = skfem.LinearForm(lambda v, w: (8.75 * (exact(w.x) - w.x[0] ** 2) - 2.0) * v)
    laplace = form.assemble(basis)
    nodal = exact(basis.mesh.p)
    u = skfem.solve(*skfem.condense(stiffness, laplace, x=nodal, I=basis.mesh.interior_nodes()))
    found = basis.interpolate(u)
    of_gradient = skfem.Functional(
        lambda w: sum((w["u"].grad[i] - gradient(w.x)[i]) ** 2 for i in range(2))
    ).assemble(basis, u=found)
    of_solution = skfem.Functional(lambda w: (w["u"] - exact(w.x)) ** 2).assemble(basis, u=found)
    return np.sqrt([of_gradient, of_solution])


def slope(sizes, values):
    """Return the slope of logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def main():
    """Print the table, and the orders of 20 families."""
    print(f"{'case':26}{'':10}{'cells':>28}{'sizes':>9}  order (gradient, solution)")
    for name, (file, options) in CASES.items():
        mesh = ads.read(DATA / file)
        largest = mesh.diameter / 15
        family = ads.mesh_family(mesh, hmax=largest, **options)
        halved = [
            ads.remesh(mesh, ads.size_function(mesh, hmax=largest / 2**k, **options))
            for k in range(4)
        ]
        rows = {
            ("family", "mean"): (family.meshes, family.mean_sizes),
            ("halved", "hmax"): (halved, largest / 2.0 ** np.arange(4)),
            ("halved", "mean"): (
                halved,
                np.array([mean_cell_size(mesh) for mesh in halved]),
            ),
        }
        for (kind, which), (meshes, sizes) in rows.items():
            found = np.array([errors(one) for one in meshes])
            orders = "  ".join(f"{slope(sizes, column):.2f}" for column in found.T)
            cells = " ".join(str(one.n_cells) for one in meshes)
            print(f"{name:26}{kind:10}{cells:>28}{which:>9}  {orders}")
    gradients, solutions = [], []
    corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
    square = ads.SimplexMesh(corners, [[0, 1, 2], [0, 2, 3]])
    domains = [(square, {"sources": ads.PointSource([0.3, 0.4], 0.02)})]
    domains += [(ads.read(DATA / f"{name}.vtu"), {}) for name in ("lshape", "slit", "curved")]
    for mesh, options in domains:
        for parts in (10.0, 15.0, 20.0, 23.3, 25.0):
            family = ads.mesh_family(mesh, hmax=mesh.diameter / parts, **options)
            found = np.array([errors(one) for one in family.meshes])
            gradients.append(slope(family.mean_sizes, found[:, 0]))
            solutions.append(slope(family.mean_sizes, found[:, 1]))
    for name, orders, exact_order in (("gradient", gradients, 1), ("solution", solutions, 2)):
        off = np.abs(np.array(orders) - exact_order)
        print(
            f"{name}: orders of {len(orders)} families {min(orders):.2f} to {max(orders):.2f}, "
            f"{np.count_nonzero(off <= 0.05)} within .05, median deviation {np.median(off):.3f}"
        )


if __name__ == "__main__":
    main()
