"""The size function of a domain within a number of elements."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.by_domain import MeshDomain, SizedDomain
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.report import SizeReport
from adaptsize.domain_size.request import Request
from adaptsize.errors import ResolutionWarning
from adaptsize.remeshing.estimate import estimate_n_cells, estimate_n_enclosed
from adaptsize.sizes.budget import calibration

_MAX_ROUNDS = 8

# The number of elements is predicted for this generator.
_GENERATOR = "mmg"


def within_budget(domain: SizedDomain, request: Request) -> tuple[SizeFunction, SizeReport]:
    """Return the size function of a domain, relaxed to a number of elements.

    Parameters that the request leaves open are relaxed until the predicted number of elements
    is at most about ``request.max_elements``.

    Warns
    -----
    ResolutionWarning
        If the parameters that the request fixes require more elements.
    """
    relaxation, before = 1.0, np.inf
    for n_rounds in range(_MAX_ROUNDS + 1):
        if request.report is not None:
            request.report("size function", n_rounds / (_MAX_ROUNDS + 1))
        now = replace(request, relaxation=relaxation)
        size, report = domain.limited(now)
        n_elements = predicted(domain, size, report)
        report = replace(report, n_elements=n_elements, relaxation=relaxation)
        if n_elements <= request.max_elements:
            return size, report
        if request.is_fixed or n_elements > 0.95 * before:
            break
        before = n_elements
        relaxation *= max(1.2, (n_elements / request.max_elements) ** (1.0 / domain.dim))
    warnings.warn(
        f"the sizes require about {n_elements:.2g} elements, more than max_elements = "
        f"{request.max_elements:.3g}, because of the given parameters: relax these or raise "
        "max_elements",
        ResolutionWarning,
        stacklevel=4,
    )
    return size, report


def predicted(domain: SizedDomain, size: SizeFunction, report: SizeReport) -> float:
    """Return the predicted number of elements of a mesh of the domain."""
    if isinstance(domain, SurfaceDomain):
        return calibration(_GENERATOR, 3) * estimate_n_enclosed(domain.mesh, size)
    if isinstance(domain, MeshDomain) and isinstance(size.background, SimplexMesh):
        mesh = domain.mesh
        if mesh.cell_dim >= mesh.dim - 1:
            return calibration(_GENERATOR, mesh.cell_dim) * estimate_n_cells(mesh, size)
    return calibration(_GENERATOR, domain.dim) * report.n_elements
