"""The size function of a domain within a number of elements."""

import math
from dataclasses import replace

import numpy as np

from adaptsize._checks import count_text, length_text, warn_caller
from adaptsize._defaults import refused_above
from adaptsize._messages import Message
from adaptsize._progress import Stage
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.domain_size import tuning
from adaptsize.domain_size.by_domain import MeshDomain, SizedDomain
from adaptsize.domain_size.goals import Goal
from adaptsize.domain_size.on_surface import SurfaceDomain, warn_of_outside
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.request import Request
from adaptsize.domain_size.unknowns import as_bytes, system_of
from adaptsize.errors import OptionError, ResolutionWarning, TooManyElementsError
from adaptsize.remeshing.details import SurfaceWithDetails
from adaptsize.sizes import predict
from adaptsize.sizes.budget import calibration
from adaptsize.sizes.prediction import Prediction, integrated
from adaptsize.sizes.search import Search, rounded_up, smallest_tolerance


def within_budget(domain: SizedDomain, request: Request) -> SizeFunction:
    """Return the size function of a domain, scaled to a number of elements, with its report.

    Parameters that the request leaves open are relaxed until the predicted number of elements
    is at most ``max_elements`` and the matrix fits in ``max_memory``, up to 10 % where the boundary
    needs that, or changed until the number of elements, nodes or unknowns is the requested one.
    The tolerance is not changed.

    Raises
    ------
    TooManyElementsError
        If the boundary within the tolerance or the parameters that the request fixes require more
        than a given number or memory, or without one more than is made without ``max_elements``.

    Warns
    -----
    ResolutionWarning
        If they require more than the parameters are relaxed to without ``max_elements``, or do not
        allow as many elements as requested.
    InputWarning
        If a source is outside of the part that a surface encloses.
    """
    search = _searched(domain, request)
    size = search.best.result
    if search.miss > math.log1p(tuning.NEAR):
        _refuse(domain, request, report_of(size))
    elif search.miss < -tuning.NEAR and (goal := request.goal) is not None:
        warn_caller(_shortage(goal, request, report_of(size)), ResolutionWarning)
    return _ordered(domain, request, size)


def nearest_to_budget(domain: SizedDomain, request: Request, start: float = 1.0) -> SizeFunction:
    """Return the sizes nearest to a number of elements, with the fewest if these are too many.

    The search begins with the relaxation ``start``, which is above 1 only if sizes that are not
    relaxed are known to have too many.
    """
    return _ordered(domain, request, _searched(domain, request, start).best.result)


def _ordered(domain: SizedDomain, request: Request, size: SizeFunction) -> SizeFunction:
    """Return sizes of a surface in the order of the given nodes; warn of sources outside."""
    if isinstance(domain, SurfaceDomain):
        size = domain.in_given_order(size)
        warn_of_outside(domain, request.sources, request.g)
    return size


def _searched(domain: SizedDomain, request: Request, start: float = 1.0) -> Search[SizeFunction]:
    """Return the sizes that were tried, relaxed more and more, or tightened.

    If the first ones have too many elements, those of the boundary within the tolerance are counted
    next, unless ``start`` is above 1: where they are too many, nothing else is tried.
    """
    start = min(start, tuning.FARTHEST)
    first = _relaxed(domain, request, start)
    is_kept = bool(np.isfinite(report_of(first).tolerance))
    close = math.log1p(tuning.CLOSE)
    search: Search[SizeFunction] = Search(
        1.0, float(first.background.dim), close, most=16,
        below=close if request.goal is not None else tuning.UNUSED, is_cap=request.goal is None,
        bounds=(1.0 if request.goal is None else 0.0, tuning.FARTHEST if is_kept else np.inf),
        # Where a bound no longer grows, hmin does, and exceeds it in the end; unless it is given.
        patience=3 if _given(request) else 6, start=start,
    )  # fmt: skip
    search.add(_load(report_of(first), request), first)
    known: dict[float, SizeFunction] = {}
    if start == 1.0 and is_kept and search.miss > close:
        fewest = known[tuning.FARTHEST] = _fully_relaxed(domain, request)
        load = _load(report_of(fewest), request)
        if np.log(load) > close:  # those above by less than a tenth are made as they are
            search.add(load, fewest, factor=tuning.FARTHEST)
            return search
    elif start == 1.0 and request.is_fixed:
        return search
    while (factor := search.factor) is not None:
        size = known[factor] if factor in known else _relaxed(domain, request, factor)
        search.add(_load(report_of(size), request), size)
    return search


def _refuse(domain: SizedDomain, request: Request, report: SizeReport) -> None:
    """Raise if sizes have more elements than allowed; warn if only more than relaxed to."""
    if request.is_capped or request.goal is not None:
        raise _refusal(domain, request, report)
    most = refused_above(None)
    if report.n_elements > most:
        request = replace(request, max_elements=most)
        raise _refusal(domain, request, report)
    warn_caller(_excess(request, report), ResolutionWarning)


def _shortage(goal: tuple[Goal, float], request: Request, report: SizeReport) -> Message:
    """Return how many elements the sizes require, fewer than requested, and why."""
    what, wanted = goal
    number = predicted_number(report, what, request.system)
    return Message(
        "the sizes require about {} {} instead of {:.6g}: {}",
        *(count_text(number), what, wanted, _what_forbids(request, report)),
    )


def _excess(request: Request, report: SizeReport) -> Message:
    """Return how many elements the sizes require, more than allowed, and why."""
    name, most = "max_elements", f"{request.max_elements:.0f}"
    needed = f"{count_text(report.n_elements)} elements"
    if report.n_elements <= (1.0 + tuning.CLOSE) * request.max_elements:
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


def _refusal(domain: SizedDomain, request: Request, report: SizeReport) -> TooManyElementsError:
    """Return an error: how many elements the boundary needs, and with what fewer are enough.

    Where no tolerance and no length of details would help, something else requires the elements.
    """
    what, wanted = request.goal or ("elements", request.max_elements)
    allowed, found = f"{request.tolerance:g}", report.n_elements
    if isinstance(domain, MeshDomain | SurfaceDomain):
        whole = domain.mesh.diameter
        allowed = length_text(request.tolerance * whole, whole, "diameter")
    offers = {
        "tolerance": tolerance_that_fits(domain, request, report),
        "least_detail": detail_that_fits(domain, request),
    }
    enough = {name: value for name, value in offers.items() if value is not None}
    if not enough:
        return TooManyElementsError(_excess(request, report), found)
    names = [Message.name(name, f"{value:g}") for name, value in enough.items()]
    needed = f"{count_text(predicted_number(report, what, request.system))} {what}"
    too_few = f"{count_text(wanted)} are"
    if request.goal is None and report.n_elements <= (1.0 + tuning.CLOSE) * request.max_elements:
        needed = f"{system_of(report, *request.system)[1] / 1e9:.2g} GB for the matrix"
        too_few = f"{request.options['max_memory']} is"
    text = Message(
        "within the tolerance of {} the boundary needs about {}; {} not enough: {}",
        *(allowed, needed, too_few, Message.joined(", or ", names)),
    )
    return TooManyElementsError(text, found, enough)


def tolerance_that_fits(domain: SizedDomain, request: Request, report: SizeReport) -> float | None:
    """Return the smallest tolerance, in two digits, within which the boundary needs few enough.

    None if there is none, or it is not known that the tolerance matters.
    """
    if not np.isfinite(report.tolerance):
        return None

    def load(tolerance: float) -> float:
        found = _fully_relaxed(domain, request.with_tolerance(tolerance))
        return _load(report_of(found), request)

    return smallest_tolerance(request.tolerance, _load(report, request), load)


def detail_that_fits(domain: SizedDomain, request: Request) -> float | None:
    """Return the smallest length, in two digits, without whose details few enough are needed.

    None if there is none up to a tenth of the diameter, or the domain is no closed surface.
    """
    if not isinstance(domain, SurfaceDomain) or domain.overlaps or not domain.mesh.is_closed:
        return None
    details = SurfaceWithDetails.of(domain.mesh, request.crease_angle)
    known: dict[int, float] = {}

    def excess(length: float) -> float:
        """Return the logarithm of the elements over the allowed ones."""
        simplified = details.removed(length)
        count = len(simplified.details)
        if count not in known:
            known[count] = np.inf
            if count > 0:
                other = SurfaceDomain.of(simplified.mesh, request.crease_angle)
                known[count] = _load(report_of(_fully_relaxed(other, request)), request)
        return math.log(known[count])

    low, high = (
        request.tolerance * domain.mesh.diameter,
        tuning.LARGEST_DETAIL * domain.mesh.diameter,
    )
    if request.h0 is not None or not low < high or excess(high) > math.log1p(tuning.CLOSE):
        return None
    while high > 1.1 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if excess(middle) <= math.log1p(tuning.CLOSE) else (middle, high)
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
    return _relaxed(domain, replace(request, max_elements=np.inf), tuning.FARTHEST)


def _relaxed(domain: SizedDomain, request: Request, relaxation: float) -> SizeFunction:
    """Return the sizes for relaxed parameters, with the predicted numbers of a mesh by Mmg."""
    request.progress(Stage("sizes"), None)
    size = domain.size_for(replace(request, relaxation=relaxation))
    report, dim = replace(report_of(size), relaxation=relaxation), size.background.dim
    size = replace(size, report=report)
    found = Prediction(calibration("mmg", dim) * report.n_elements)
    if isinstance(domain, SurfaceDomain):
        if domain.overlaps:  # narrow parts between bodies are inside of their union
            found = predict(domain.enclosed, size, backend="mmg")
        else:
            found = domain.thin_parts.added_to(integrated(domain.enclosed, size, "mmg"), size)
    elif isinstance(domain, MeshDomain) and isinstance(size.background, SimplexMesh):
        mesh = domain.mesh
        if mesh.cell_dim >= mesh.dim - 1:
            dim, found = mesh.cell_dim, predict(mesh, size, backend="mmg")
    report = replace(
        report, n_elements=found.cells, n_facets=found.facets, n_nodes=found.nodes,
        element_dim=dim,
    )  # fmt: skip
    return replace(size, report=report)
