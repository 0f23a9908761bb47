"""Sizes for a mesh of which little is said."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptsize.cli.files import nodal_field
from adaptsize.cli.output import say
from adaptsize.cli.sources import parse_source

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.on_surface import ChosenSize


def choose(
    mesh: SimplexMesh,
    elements_per_radian: float | None,
    elements_across: float | None,
    g: float,
    hmin: float | None,
    hmax: float | None,
    crease_angle: float,
    source: list[str] | None,
    field: str | None,
) -> ChosenSize:
    """Return the sizes to use, and say which; a given field alone replaces those from the part."""
    from adaptsize.domain_size.on_surface import choose_size

    if field is not None and elements_per_radian is None:
        elements_per_radian = 0.0
    if field is not None and elements_across is None:
        elements_across = 0.0
    chosen = choose_size(
        mesh,
        elements_per_radian=elements_per_radian,
        elements_across=elements_across,
        g=g,
        hmin=hmin,
        hmax=hmax,
        crease_angle=crease_angle,
        sources=[parse_source(text) for text in source or ()],
        h0=None if field is None else nodal_field(mesh, field),
        progress=True,
    )
    say(f"sizes: {chosen}")
    return chosen
