"""The size function of a domain within a number of elements."""

from dataclasses import replace

import numpy as np

from adaptsize._checks import count_text, warn_caller
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.by_domain import MeshDomain, SizedDomain
from adaptsize.domain_size.cost import as_bytes, report_of, system_of
from adaptsize.domain_size.on_surface import SurfaceDomain, warn_of_outside
from adaptsize.domain_size.request import Goal, Request
from adaptsize.errors import ResolutionWarning
from adaptsize.sizes import predict
from adaptsize.sizes.budget import calibration
from adaptsize.sizes.prediction import Prediction

#: A predicted number of elements is close enough if its logarithm is off by less.
_CLOSE = 0.02
#: Derivative of the logarithm of the number by that of the relaxation, which is -dim where no
#: parameter is given, above which the number hardly depends on it.
_LEAST_SLOPE = -0.4


def within_budget(domain: SizedDomain, request: Request) -> SizeFunction:
    """Return the size function of a domain, scaled to a number of elements, with its report.

    Parameters that the request leaves open are relaxed until the predicted number of elements
    is at most about ``max_elements`` and the matrix fits in ``max_memory``, or changed until the
    number of elements, nodes or unknowns is the requested one.

    Warns
    -----
    ResolutionWarning
        If the parameters that the request fixes require more elements, or do not allow so many.
    InputWarning
        If a source is outside of the part that a surface encloses.
    """
    if request.goal is None:
        size = _with_fewer_elements(domain, request)
    else:
        size = _with_number(domain, request, *request.goal)
    if isinstance(domain, SurfaceDomain):
        size = domain.in_given_order(size)
        warn_of_outside(domain, request.sources, request.g)
    return size


def _with_fewer_elements(domain: SizedDomain, request: Request) -> SizeFunction:
    """Return the size function, relaxed to at most the predicted number of elements allowed."""
    relaxation, step, before, n_flat = 1.0, 1.0, np.inf, 0
    for _ in range(16):
        size = _relaxed(domain, request, relaxation)
        report = report_of(size)
        load = _load(report, request)
        if load <= 1.0 + _CLOSE:
            return size
        # Where a bound no longer grows, hmin does, and exceeds it in the end.
        n_flat = n_flat + 1 if load > 0.95 * before else 0
        if request.is_fixed or n_flat == (1 if _given(request) else 6):
            break
        power = float(size.background.dim)
        if step > 1.0:  # the last step shows how the number depends on the relaxation
            power = float(np.clip(np.log(before / load) / np.log(step), 1.0, power))
        step = max(1.2, load ** (1.0 / power))
        before = load
        relaxation *= step
    name, most = "max_elements", f"{request.max_elements:.6g}"
    needed = f"{count_text(report.n_elements)} elements"
    if report.n_elements <= (1.0 + _CLOSE) * request.max_elements:
        name, most = "max_memory", str(request.options["max_memory"])
        needed = f"{system_of(report, *request.system)[1] / 1e9:.2g} GB for the matrix"
    warn_caller(
        f"the sizes require about {needed}, more than {name} = {most}: "
        f"{_what_forbids(request, report)}; relax that bound or raise {name}",
        ResolutionWarning,
    )
    return size


def _given(request: Request) -> list[str]:
    """Return the names of the given bounds, which are not relaxed."""
    names = ("elements_per_radian", "elements_across", "elements_between", "hmin", "hmax")
    given = [name for name in (*names, "tolerance") if request.options.get(name) is not None]
    given += ["sources"] if len(request.sources) else []
    return [*given, "h0"] if request.h0 is not None else given


def _what_forbids(request: Request, report: SizeReport) -> str:
    """Return which bound controls most of the elements, and which parameters are given."""
    given = ", ".join(_given(request))
    rest = f"given parameters: {given}" if given else "and the parameters are relaxed already"
    return f"{what_controls(report)}, {rest}"


def what_controls(report: SizeReport) -> str:
    """Return which bound controls most of the elements."""
    cause = max(report.element_shares, key=lambda name: report.element_shares[name])
    return f"{cause} controls {report.element_shares[cause]:.0%} of the elements"


def _with_number(domain: SizedDomain, request: Request, what: Goal, wanted: float) -> SizeFunction:
    """Return the size function with a predicted number, or the nearest one found.

    With all bounds in proportion to the relaxation r there are about r^-dim of them.  From the
    second step on, the exponent is that of the two last steps.
    """
    steps: list[tuple[float, float]] = []  # logarithms of relaxation and number over the wanted
    best: SizeFunction | None = None
    relaxation, least, n_flat = 1.0, np.inf, 0
    for _ in range(12):
        found = _relaxed(domain, request, relaxation)
        number = predicted_number(report_of(found), what, request.system)
        steps.append((np.log(relaxation), np.log(number / wanted)))
        off = abs(steps[-1][1])
        if off < least:
            best, least = found, off
        if off <= _CLOSE:
            break
        slope = -float(found.background.dim)
        if len(steps) > 1:
            (x0, y0), (x1, y1) = steps[-2:]
            slope = (y1 - y0) / (x1 - x0)
            n_flat = n_flat + 1 if slope > _LEAST_SLOPE else 0
            if n_flat == (3 if _given(request) else 6):  # the given parameters determine the number
                break
            slope = min(slope, _LEAST_SLOPE)
        relaxation *= np.exp(np.clip(-steps[-1][1] / slope, -1.5, 1.5))
    assert best is not None
    if least > 0.1:
        number = predicted_number(report_of(best), what, request.system)
        warn_caller(
            f"the sizes require about {count_text(number)} {what} instead of {wanted:.6g}: "
            f"{_what_forbids(request, report_of(best))}",
            ResolutionWarning,
        )
    return best


def predicted_number(report: SizeReport, what: Goal, system: tuple[int, int]) -> float:
    """Return the predicted number of elements, nodes or unknowns of a finite element."""
    if what == "elements":
        return report.n_elements
    if what == "dofs":
        return system_of(report, *system)[0]
    if np.isnan(report.n_nodes):
        raise ValueError("nodes needs a mesh or a surface as domain; use elements for others")
    return report.n_nodes


def _load(report: SizeReport, request: Request) -> float:
    """Return the predicted number of elements or memory over the largest allowed."""
    load, memory = report.n_elements / request.max_elements, request.options["max_memory"]
    if memory is None:
        return load
    return max(load, system_of(report, *request.system)[1] / as_bytes(memory))


def _relaxed(domain: SizedDomain, request: Request, relaxation: float) -> SizeFunction:
    """Return the sizes for relaxed parameters, with the predicted numbers of a mesh by Mmg."""
    request.report("size function", None)
    size = domain.limited(replace(request, relaxation=relaxation))
    report, dim = report_of(size), size.background.dim
    found = Prediction(calibration("mmg", dim) * report.n_elements)
    if isinstance(domain, SurfaceDomain):
        found = predict(domain.enclosed, size, backend="mmg")
    elif isinstance(domain, MeshDomain) and isinstance(size.background, SimplexMesh):
        mesh = domain.mesh
        if mesh.cell_dim >= mesh.dim - 1:
            dim, found = mesh.cell_dim, predict(mesh, size, backend="mmg")
    report = replace(
        report, n_elements=found.cells, n_facets=found.facets, n_nodes=found.nodes,
        element_dim=dim, relaxation=relaxation,
    )  # fmt: skip
    return replace(size, report=report)
