"""Functions of DOLFINx as fields of `adapt` and `transfer_fields`, over two cycles."""

from mpi4py import MPI  # loads the library of MPI that the wheel of DOLFINx needs

# isort: split
import numpy as np
import pytest
from dolfinx import fem, mesh

import adaptsize as ads

#: Elements, and the degree of the polynomials that they have exactly.
ELEMENTS = [
    *((("Lagrange", order), order) for order in (1, 2)),
    *((("DG", order), order) for order in (0, 1, 2)),
]


def polynomial(x, degree):
    """A polynomial of a degree."""
    terms = [3.0 + 0.0 * x[0], 1.0 + x[0] - 2.0 * x[1], 1.0 + x[0] * x[1] - x[1] ** 2]
    return terms[degree]


def functions(domain, dim):
    """Functions of all elements, and what they are."""
    found = {}
    for (family, order), degree in ELEMENTS:
        for shape in ((), (dim,), (dim, dim)):
            n = int(np.prod(shape))

            def exact(x, degree=degree, n=n, is_scalar=shape == ()):
                value = polynomial(x, degree)
                return value if is_scalar else np.stack([(k + 1) * value for k in range(n)])

            space = fem.functionspace(domain, (family, order, shape) if shape else (family, order))
            own = fem.Function(space, name=f"{family} {order} {shape}")
            own.interpolate(exact)
            found[own.name] = own, exact
    return found


def check_loop(domain, dim):
    """Polynomials of the space stay what they are, also where DOLFINx has numbered anew."""
    part = ads.SimplexMesh.from_object(domain)
    held = functions(domain, dim)
    fields = {name: own for name, (own, _) in held.items()}
    for size in (0.2, 0.27):
        result = ads.adapt(part, h0=np.full(part.n_points, size), fields=fields)
        assert result.remeshed
        part, fields = result.mesh, result.fields
        for name, (_, exact) in held.items():
            found = fields[name]
            assert found.name == name
            assert found.function_space.mesh is part.to_dolfinx().mesh
            wanted = fem.Function(found.function_space)
            wanted.interpolate(exact)
            assert np.allclose(found.x.array, wanted.x.array, rtol=0.0, atol=1e-11), name
    assert "u" in part.with_data(point_data={"u": part.points[:, 0]}).to_dolfinx().functions


def check_integral(domain):
    """The integral of a function that the new mesh does not have exactly is kept."""
    part = ads.SimplexMesh.from_object(domain)
    space = fem.functionspace(domain, ("Lagrange", 2))
    u = fem.Function(space)
    u.interpolate(lambda x: np.exp(-30.0 * ((x[0] - 0.4) ** 2 + (x[1] - 0.6) ** 2)))
    moved = ads.adapt(part, h0=np.full(part.n_points, 0.15), fields={"u": u}).fields["u"]
    import ufl

    before, after = (fem.assemble_scalar(fem.form(f * ufl.dx)) for f in (u, moved))
    assert abs(after - before) <= 1e-12 * abs(before)


def check_refusals(domain):
    """What cannot be done is refused by name."""
    part = ads.SimplexMesh.from_object(domain)
    other = mesh.create_unit_square(MPI.COMM_SELF, 2, 2)
    bad = {
        "Lagrange elements of order 0 to 2": fem.functionspace(domain, ("N1curl", 1)),
        "order 0 to 2, continuous or not": fem.functionspace(domain, ("Lagrange", 3)),
        "must have the cells of mesh": fem.functionspace(other, ("Lagrange", 1)),
    }
    for words, space in bad.items():
        fields = {"u": fem.Function(space)}
        with pytest.raises(ValueError, match=rf"fields\['u'\] .*{words}|{words}"):
            ads.adapt(part, h0=np.full(part.n_points, 0.2), fields=fields)


plane = mesh.create_unit_square(MPI.COMM_SELF, 6, 6)
check_loop(plane, 2)
check_loop(mesh.create_unit_cube(MPI.COMM_SELF, 3, 3, 3), 3)
check_integral(plane)
check_refusals(plane)
print("all right")
