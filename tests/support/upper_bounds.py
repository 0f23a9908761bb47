"""Upper bounds of several causes, limited together as by `size_function`."""

from adaptsize.domain_size.request import Bounds, Request
from adaptsize.options import SizeFunctionOptions, checked


def limit_bounds(background, bounds, g, *, hmin, hmax, **options):
    """Return the limited sizes, and the report on their causes."""
    request = Request.of(checked(SizeFunctionOptions, {"g": g}))
    return Bounds(background, bounds, (hmin, hmax)).limited(request, **options)
