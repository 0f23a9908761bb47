"""The page: HTML around the figures, with nothing to fetch."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from adaptsize.quality.certificate import MeshCheck

_STYLE = """
body { color: #222; font: 15px/1.45 system-ui, sans-serif; margin: 1rem auto; max-width: 1100px;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0.5rem 0; } h2 { font-size: 1.15rem; margin: 1.5rem 0 0.5rem; }
table { border-collapse: collapse; } .scroll { overflow-x: auto; }
td, th { border-bottom: 1px solid #ddd; padding: 0.25rem 0.9rem 0.25rem 0; text-align: left;
  vertical-align: top; }
th { font-weight: 600; white-space: nowrap; } .number { font-variant-numeric: tabular-nums; }
.failed { color: #a33c00; font-weight: 600; } footer { color: #666; margin: 2rem 0; }
/* The scale of a scene follows its height: on narrow pages the mesh would be cut at its sides. */
.scene { height: min(640px, 60px + 64vw); } .scene > div { height: 100%; }
.charts { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(26rem, 100%), 1fr)); }
.warning { background: #fff6e0; border-left: 4px solid #d99a00; padding: 0.3rem 0.8rem; }
"""


def page_of(
    title: str,
    kind: str,
    *,
    rows: Sequence[tuple[str, str]],
    warnings: Sequence[str],
    check: MeshCheck,
    scene: go.Figure,
    charts: Sequence[go.Figure],
) -> str:
    """Return the page as text."""
    import adaptsize

    heading = f"{escape(title)}: {escape(kind)}"
    config = {"responsive": True, "displaylogo": False}
    mesh = scene.to_html(full_html=False, include_plotlyjs=True, config=config)
    bars = [
        chart.to_html(full_html=False, include_plotlyjs=False, config=config) for chart in charts
    ]
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{heading}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{heading}</h1>",
        *(f'<p class="warning">{escape(text)}</p>' for text in warnings),
        "<h2>Mesh</h2><p>Choose what to show from the list; drag to turn, scroll to zoom.</p>",
        f'<div class="scene">{mesh}</div>',
        "<h2>Summary</h2>",
        _table(rows),
        "<h2>Edge lengths and angles</h2>",
        '<div class="charts">',
        *bars,
        "</div>",
        "<h2>Demands</h2>",
        _demands(check),
        f"<footer>adaptsize {escape(adaptsize.__version__)}</footer>",
        "</body></html>",
    ]
    return "\n".join(parts)


def _table(rows: Sequence[tuple[str, str]]) -> str:
    body = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f'<div class="scroll"><table>{body}</table></div>'


def _demands(check: MeshCheck) -> str:
    """Return the table of demands, with the worst places below those that are not met."""
    rows = []
    for demand in check.demands:
        state = "met" if demand.is_met else '<span class="failed">not met</span>'
        rows.append(
            f"<tr><th>{escape(demand.name)}</th><td>{state}</td><td>{escape(demand.text)}</td></tr>"
        )
        for place in demand.places:
            at = ", ".join(f"{x:.6g}" for x in place.point)
            rows.append(
                f'<tr><td></td><td></td><td class="number">{place.value:.4g} at ({at})</td></tr>'
            )
    rows += [f"<tr><th>note</th><td></td><td>{escape(note)}</td></tr>" for note in check.notes]
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'
