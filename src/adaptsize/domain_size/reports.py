"""The reports of size functions."""

from adaptsize._checks import check_type
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport


def report_of(size: SizeFunction) -> SizeReport:
    """Return the report of a result of `size_function`."""
    check_type("size", size, SizeFunction)
    if size.report is None:
        raise ValueError("size must be a result of size_function, with a report; got one without")
    return size.report
