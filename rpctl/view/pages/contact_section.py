"""The contact trial on a certificate's page: the proof one can watch."""

from __future__ import annotations

from html import escape

from rpctl.equivalence.contact.record import ContactTrial
from rpctl.view.pages.contact_charts import charts
from rpctl.view.pages.contact_plan_view import plan_view
from rpctl.view.pages.summary_panel import badge

STYLE = """
.trial { background: var(--card); border: 1px solid var(--line); border-radius: 10px;
  padding: 16px 18px 18px; margin-bottom: 16px; }
.trial .head { display: flex; flex-wrap: wrap; align-items: baseline; gap: 4px 12px; }
.trial .head h2 { font-size: 16px; color: var(--ink); margin: 0; letter-spacing: -0.01em; }
.trial .lead { color: var(--soft); max-width: 68ch; margin: 4px 0 12px; }
.trial .lead strong { color: var(--ink); font-weight: 600; }
.trial .views { display: grid; grid-template-columns: minmax(0, 1.35fr) minmax(0, 1fr);
  gap: 18px 22px; }
.trial .views.few { grid-template-columns: minmax(0, 1fr); }
.trial figure { margin: 0; min-width: 0; }
.trial svg { display: block; width: 100%; height: auto; overflow: hidden; }
.trial .ground svg { border-radius: 8px; background: var(--page); border: 1px solid var(--line); }
.trial .charts { display: grid; gap: 14px; align-content: space-between; }
.trial figcaption { display: flex; justify-content: space-between; font-size: 12px;
  font-weight: 600; color: var(--soft); margin-bottom: 2px; }
.trial figcaption span { font-weight: 400; }
.trial .notes { list-style: none; margin-top: 10px; font-size: 12px; color: var(--soft);
  overflow-wrap: anywhere; }
.trial .notes li { padding: 3px 0 3px 34px; }
.trial .small { font-size: 11px; fill: var(--soft); font-variant-numeric: tabular-nums; }
.trial .halo { paint-order: stroke; stroke: var(--page); stroke-width: 4; stroke-linejoin: round; }
.trial .key { display: flex; flex-wrap: wrap; gap: 4px 20px; list-style: none; margin-top: 10px;
  font-size: 13px; }
.trial .key li::before { content: ""; display: inline-block; width: 26px; margin-right: 8px;
  vertical-align: middle; }
.trial .key .engine::before { height: 9px; border-radius: 5px; background: var(--tip);
  opacity: .38; }
.trial .key .reduced::before { height: 0; border-top: 2px solid var(--base); }
.trial .names { display: flex; flex-wrap: wrap; gap: 0 14px; list-style: none; font-size: 12px;
  color: var(--soft); padding-left: 44px; overflow-wrap: anywhere; }
.trial .names li::before { content: ""; display: inline-block; width: 9px; height: 9px;
  border-radius: 50%; background: var(--line); margin-right: 5px; }
.trial .grid { stroke: var(--line); stroke-width: 1; fill: none; }
.trial .bar { stroke: var(--soft); stroke-width: 1.2; fill: none; }
.trial .track { stroke: var(--desired); stroke-width: 1; stroke-dasharray: 2 4; fill: none;
  opacity: .6; }
.trial .ribbon { stroke: var(--tip); stroke-width: 9; stroke-linecap: round; fill: none;
  stroke-linejoin: round; opacity: .38; }
.trial .thread { stroke: var(--base); stroke-width: 2; fill: none; stroke-linejoin: round; }
.trial .charts .ribbon { stroke: var(--line); stroke-width: 6; opacity: .35;
  stroke-linecap: butt; }
.trial .charts .thread { stroke: var(--line); stroke-width: 1.4; }
.trial .area { fill: var(--good); opacity: .16; }
.trial .gap { stroke: var(--good); stroke-width: 1.8; fill: none; }
.trial .failed .area { fill: var(--bad); }
.trial .failed .gap { stroke: var(--bad); }
.trial .allowed { stroke: var(--soft); stroke-width: 1.2; stroke-dasharray: 5 4; }
.trial .stand { fill: none; stroke: var(--desired); stroke-width: 1; opacity: .55;
  stroke-linejoin: round; }
.trial .stand.engine { stroke: var(--tip); opacity: .5; stroke-width: 5; }
.trial .stand.reduced { stroke: var(--base); opacity: 1; stroke-width: 1.2; }
.trial .post { fill: var(--card); stroke: var(--ink); stroke-width: 1.6; }
.trial .robot { transform-origin: 0 0; transform-box: view-box; }
.trial .robot.engine .hull { fill: var(--tip); opacity: .22; }
.trial .robot.engine circle, .trial .robot.engine .nose { fill: var(--tip); opacity: .45; }
.trial .robot.engine circle { r: 5px; }
.trial .robot.reduced .hull { fill: none; stroke: var(--base); stroke-width: 1.6;
  stroke-linejoin: round; }
.trial .robot.reduced circle { fill: var(--base); }
.trial .robot.reduced .nose { fill: none; stroke: var(--base); stroke-width: 1.4;
  stroke-linejoin: round; }
@media (max-width: 720px) { .trial .views { grid-template-columns: minmax(0, 1fr); } }
@media (prefers-reduced-motion: reduce) { .trial .robot { animation: none !important; } }
"""


def contact_section(trial: ContactTrial) -> tuple[str, str]:
    """Return the section of a trial as HTML, and its style."""
    ground, moves = plan_view(trial)
    drawn = "".join(
        f"<figure{_failing(trial, place)}><figcaption>{escape(title)}<span>{escape(unit)}</span>"
        f"</figcaption>{chart}</figure>"
        for place, (title, unit, chart) in enumerate(charts(trial))
    )
    html = f"""<section class="trial">
<div class="head"><h2>Rolling on a plane</h2>{_badge(trial)}</div>
<p class="lead">{_lead(trial)}</p>
<div class="views"><figure class="ground">{ground}
<ul class="key"><li class="engine">MuJoCo: free body, friction</li>
<li class="reduced">reduced model: rolling as an equation</li></ul>{_notes(trial)}</figure>
<div class="charts">{drawn}</div></div>
</section>
"""
    return html, STYLE + moves


def _lead(trial: ContactTrial) -> str:
    """Return what the reader sees, in a sentence or two."""
    apart = f"<strong>{escape(trial.path.format_value(trial.path.gap))}</strong>"
    close = f"the two paths stay within {apart} of each other"
    if not trial.path.passed:
        allowed = escape(trial.path.format_value(trial.path.band))
        close = f"the two paths come {apart} apart, where {allowed} is allowed"
    return (
        "The same robot as a free body with six degrees of freedom: no equation says that its "
        f"wheels roll, friction makes them. Over {trial.distance:.2f} m in {trial.t[-1]:g} s, "
        f"under the same efforts, {close}. Where the thin line lies inside the broad one, both "
        "agree."
    )


def _notes(trial: ContactTrial) -> str:
    """Return what the two sides share and what is not compared, a line each."""
    lines = "".join(f"<li>{escape(note)}</li>" for note in trial.notes)
    return f'<ul class="notes">{lines}</ul>' if lines else ""


def _badge(trial: ContactTrial) -> str:
    broken = sum(not check.passed for check in trial.checks)
    text = f"{broken} of {len(trial.checks)} gaps too wide" if broken else "both agree"
    return badge(not broken, text)


def _failing(trial: ContactTrial, place: int) -> str:
    """Return the mark of a chart whose gap leaves its band: the first is the path's."""
    return ' class="failed"' if place == 0 and not trial.path.passed else ""
