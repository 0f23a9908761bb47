"""The size function of a domain within a number of elements."""

from dataclasses import replace

import numpy as np

from adaptsize._checks import count_text, warn_caller
from adaptsize._messages import Message
from adaptsize._progress import Stage
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.by_domain import MeshDomain, SizedDomain
from adaptsize.domain_size.cost import as_bytes, report_of, system_of
from adaptsize.domain_size.on_surface import SurfaceDomain, warn_of_outside
from adaptsize.domain_size.request import Goal, Request
from adaptsize.errors import OptionError, ResolutionWarning, TooManyElementsError
from adaptsize.remeshing.details import SurfaceWithDetails
from adaptsize.sizes import predict
from adaptsize.sizes.budget import calibration
from adaptsize.sizes.prediction import Prediction

#: A predicted number of elements is close enough if its logarithm is off by less.
_CLOSE = 0.02
#: Derivative of the logarithm of the number by that of the relaxation, which is -dim where no
#: parameter is given, above which the number hardly depends on it.
_LEAST_SLOPE = -0.4
#: Relaxation at which the sizes at boundaries are those of chords within the tolerance, or a
#: quarter of an element across, and hmax is nearly the diameter.  A larger one changes little.
_FULLY = 16.0
#: Over the diameter; within a larger one, a mesh has hardly the shape of the part.
_LARGEST_TOLERANCE = 0.05
#: Over the diameter: larger parts of a shape are no details.
_LARGEST_DETAIL = 0.1


def within_budget(domain: SizedDomain, request: Request) -> SizeFunction:
    """Return the size function of a domain, scaled to a number of elements, with its report.

    Parameters that the request leaves open are relaxed until the predicted number of elements
    is at most about ``max_elements`` and the matrix fits in ``max_memory``, or changed until the
    number of elements, nodes or unknowns is the requested one.  The tolerance is not changed.

    Raises
    ------
    TooManyElementsError
        If a number or a memory is given, and the boundary within the tolerance or the parameters
        that the request fixes require more.

    Warns
    -----
    ResolutionWarning
        If they require more than the default of ``max_elements``, or do not allow as many elements
        as requested.
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
        if step == 1.0 and np.isfinite(report.tolerance):
            size = _fully_relaxed(domain, request)
            if _load(report_of(size), request) > 1.0 + _CLOSE:
                break
            return _between(domain, request, load, size)
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
    if request.is_capped:
        raise TooManyElementsError(_refusal(domain, request, report_of(size)))
    warn_caller(_excess(request, report_of(size)), ResolutionWarning)
    return size


def _between(
    domain: SizedDomain, request: Request, load: float, fewest: SizeFunction
) -> SizeFunction:
    """Return the sizes for nearly as many elements as allowed.

    The ``load`` without relaxation is above 1, and that of the ``fewest`` elements is not.
    """
    best, least = fewest, _load(report_of(fewest), request)
    low, high = (0.0, np.log(load)), (np.log(_FULLY), np.log(least))
    for _ in range(8):
        if least >= 0.95:
            break
        share = np.clip(low[1] / (low[1] - high[1]), 0.1, 0.9)
        at = float(low[0] + share * (high[0] - low[0]))
        size = _relaxed(domain, request, float(np.exp(at)))
        found = _load(report_of(size), request)
        if found > 1.0 + _CLOSE:
            low = at, float(np.log(found))
        else:
            high = at, float(np.log(found))
            if found > least:
                best, least = size, found
    return best


def _excess(request: Request, report: SizeReport) -> Message:
    """Return how many elements the sizes require, more than allowed, and why."""
    name, most = "max_elements", f"{request.max_elements:.6g}"
    needed = f"{count_text(report.n_elements)} elements"
    if report.n_elements <= (1.0 + _CLOSE) * request.max_elements:
        name, most = "max_memory", str(request.options["max_memory"])
        needed = f"{system_of(report, *request.system)[1] / 1e9:.2g} GB for the matrix"
    if request.goal is not None:
        name, wanted = request.goal
        needed = f"{count_text(predicted_number(report, name, request.system))} {name}"
        most = f"{wanted:.6g}"
    return Message(
        "the sizes require about {}, more than {} = {}: {}; relax that bound or raise {}",
        *(needed, Message.name(name), most, _what_forbids(request, report), Message.name(name)),
    )


def _refusal(domain: SizedDomain, request: Request, report: SizeReport) -> Message:
    """Return how many elements the boundary within the tolerance needs, and what needs fewer.

    Where no tolerance and no length of details would help, something else requires the elements.
    """
    what, wanted = request.goal or ("elements", request.max_elements)
    offers = []
    tolerance = tolerance_that_fits(domain, request, report)
    if tolerance is not None:
        offers.append(Message.name("tolerance", f"{tolerance:g}"))
    detail = detail_that_fits(domain, request)
    if detail is not None:
        offers.append(Message.name("least_detail", f"{detail:g}"))
    if not offers:
        return _excess(request, report)
    needed = f"{count_text(predicted_number(report, what, request.system))} {what}"
    enough = f"{count_text(wanted)} are"
    if request.goal is None and report.n_elements <= (1.0 + _CLOSE) * request.max_elements:
        needed = f"{system_of(report, *request.system)[1] / 1e9:.2g} GB for the matrix"
        enough = f"{request.options['max_memory']} is"
    return Message(
        "within the tolerance of {:g} the boundary needs about {}; {} not enough: {}",
        *(request.tolerance, needed, enough, Message.joined(", or ", offers)),
    )


def tolerance_that_fits(domain: SizedDomain, request: Request, report: SizeReport) -> float | None:
    """Return the smallest tolerance, in two digits, within which the boundary needs few enough.

    None if there is none, or it is not known that the tolerance matters.
    """
    if not np.isfinite(report.tolerance):
        return None

    def excess(tolerance: float) -> float:
        found = _fully_relaxed(domain, request.with_options(tolerance=tolerance))
        return float(np.log(_load(report_of(found), request)))

    low, high = request.tolerance, _LARGEST_TOLERANCE
    if high <= low or excess(high) > _CLOSE:
        return None
    above = float(np.log(_load(report, request)))
    while high > 1.1 * low:  # the number falls with about the power -1.2 of the tolerance
        middle = low * float(np.exp(above / 1.2)) if above > 0.05 else 0.0
        if not 1.04 * low < middle < high / 1.04:
            middle = float(np.sqrt(low * high))
        found = excess(middle)
        if found > _CLOSE:
            low, above = middle, found
        else:
            high = middle
            if found > -0.1:
                break
    offer = rounded_up(high)
    while excess(offer) > _CLOSE:  # the number falls with the tolerance up to a few per cent
        offer = rounded_up(1.05 * offer)
    return offer


def rounded_up(value: float) -> float:
    """Return the next number of two digits.

    Examples
    --------
    >>> rounded_up(0.00312), rounded_up(0.0031), rounded_up(451.0)
    (0.0032, 0.0031, 460.0)
    """
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / unit - 1e-9) * unit:.2g}")


def detail_that_fits(domain: SizedDomain, request: Request) -> float | None:
    """Return the smallest length, in two digits, without whose details few enough are needed.

    None if there is none up to a tenth of the diameter, or the domain is no closed surface.
    """
    if not isinstance(domain, SurfaceDomain) or domain.overlaps or not domain.mesh.is_closed:
        return None
    details = SurfaceWithDetails.of(domain.mesh, request.crease_angle)
    known: dict[int, float] = {}

    def excess(length: float) -> float:
        simplified = details.removed(length)
        count = len(simplified.details)
        if count not in known:
            known[count] = np.inf
            if count > 0:
                other = SurfaceDomain.of(simplified.mesh, request.crease_angle)
                known[count] = _load(report_of(_fully_relaxed(other, request)), request)
        return known[count] - 1.0

    low, high = request.tolerance * domain.mesh.diameter, _LARGEST_DETAIL * domain.mesh.diameter
    if request.h0 is not None or not low < high or excess(high) > _CLOSE:
        return None
    while high > 1.1 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if excess(middle) <= _CLOSE else (middle, high)
    return rounded_up(high)


def _given(request: Request) -> list[str]:
    """Return the names of the given bounds, which are not relaxed."""
    names = ("elements_per_radian", "elements_across", "elements_between", "hmin", "hmax")
    given = [name for name in (*names, "tolerance") if request.options.get(name) is not None]
    given += ["sources"] if len(request.sources) else []
    return [*given, "h0"] if request.h0 is not None else given


def _what_forbids(request: Request, report: SizeReport) -> Message:
    """Return which bound controls most of the elements, and which parameters are given."""
    given = Message.joined(", ", map(Message.name, _given(request)))
    if not given:
        return Message("{}, and the parameters are relaxed already", what_controls(report))
    return Message("{}, given parameters: {}", what_controls(report), given)


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
    fewest: SizeFunction | None = None
    relaxation, least, n_flat = 1.0, np.inf, 0
    for _ in range(12):
        found = _relaxed(domain, request, relaxation)
        number = predicted_number(report_of(found), what, request.system)
        steps.append((np.log(relaxation), np.log(number / wanted)))
        off = abs(steps[-1][1])
        if len(steps) == 1 and steps[0][1] > _CLOSE and np.isfinite(report_of(found).tolerance):
            fewest = _fully_relaxed(domain, request)
            if _load(report_of(fewest), request) > 1.1:
                raise TooManyElementsError(_refusal(domain, request, report_of(fewest)))
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
        if number > wanted and fewest is not None:
            return _between(domain, request, number / wanted, fewest)
        if number > wanted:
            raise TooManyElementsError(_refusal(domain, request, report_of(best)))
        warn_caller(
            Message(
                "the sizes require about {} {} instead of {:.6g}: {}",
                *(count_text(number), what, wanted, _what_forbids(request, report_of(best))),
            ),
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
        raise OptionError(
            Message("{nodes} needs a mesh or a surface as domain; use {elements} for others")
        )
    return report.n_nodes


def _load(report: SizeReport, request: Request) -> float:
    """Return the predicted number of elements or memory over the allowed or requested one."""
    if request.goal is not None:
        what, wanted = request.goal
        return predicted_number(report, what, request.system) / wanted
    load, memory = report.n_elements / request.max_elements, request.options["max_memory"]
    if memory is None:
        return load
    return max(load, system_of(report, *request.system)[1] / as_bytes(memory))


def _fully_relaxed(domain: SizedDomain, request: Request) -> SizeFunction:
    """Return the sizes that need the fewest elements, those that the boundary needs.

    They do not depend on the number that is allowed.
    """
    return _relaxed(domain, request.with_options(max_elements=np.inf), _FULLY)


def _relaxed(domain: SizedDomain, request: Request, relaxation: float) -> SizeFunction:
    """Return the sizes for relaxed parameters, with the predicted numbers of a mesh by Mmg."""
    request.report(Stage("sizes"), None)
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
