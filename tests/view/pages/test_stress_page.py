"""The page of a battery says what became of each run, and how to replay the worst."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from html import unescape

import pytest

from rpctl.study.stress_report import VERDICTS, StressReport, report_of
from rpctl.view.pages import stress
from tests.study.stress_samples import GOOD, battery, made_up


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pages hold no figures, which take their time."""
    monkeypatch.setattr(stress, "svg_address", lambda figure: "data:,")


def page_of(report: StressReport) -> str:
    files = [(f"worst-{k}.toml", f"track <{k}>") for k in range(1, len(report.worst()) + 1)]
    return stress.stress_page(report, files).decode()


def test_each_run_has_its_row_and_its_verdict() -> None:
    """A ladder tells its nominal level for each law; pairs of stresses stand below."""
    found = battery("payload", "delay", combinations=3)
    report = report_of(found, {cell.key: made_up(cell.key) for cell in found.cells}, 0.01)
    page = page_of(report)
    rows = [
        [
            unescape(re.sub("<[^>]*>", "", cell))
            for cell in re.findall(r"<t[hd][ >].*?</t[hd]>", row)
        ]
        for row in re.findall(r"<tr>.*?</tr>", page)
    ]
    shown = Counter(row[2] for row in rows if row[2] in VERDICTS)
    ladders = [
        report.row("rolling", law, each, level)
        for each in found.stresses
        for level in each.levels
        for law in found.laws
    ]
    pairs = [row for law in found.laws for row in report.combined("rolling", law)]
    assert len(pairs) == 6
    assert shown == Counter(row.verdict.name for row in (*ladders, *pairs))
    heavy = next(row for row in rows if row[:2] == ["5 kg", "paper+paper"])
    stress_of = next(each for each in found.stresses if each.name == "payload")
    expected = report.row("rolling", found.laws[1], stress_of, 5.0)
    assert heavy[2:4] == [expected.verdict.name, expected.figures.outcome]
    assert heavy[5] == expected.verdict.reason
    for verdict, count in Counter(row.verdict.name for row in report.rows).items():
        assert f'<span class="verdict {verdict}">{count} {verdict}</span>' in page
    for k in (1, 2):
        assert f'<a href="worst-{k}.toml">' in page
        assert f"<code>track &lt;{k}&gt;</code>" in page
    assert "<script" not in page and "script-src 'none'" in page


def test_how_far_a_law_holds_is_told_from_its_nominal_level_on() -> None:
    """Good up to 1 kg of 0, .5, 1, 2 and 5, tracked farther away at 2 kg, stuck at 5 kg."""
    found = battery("payload", laws=1, combinations=0)
    made = {0.0: GOOD, 2.0: replace(GOOD, late_base=0.5), 5.0: replace(GOOD, outcome="stuck")}
    figures = {
        cell.key: made.get(dict(cell.levels).get("payload", 0.0), GOOD) for cell in found.cells
    }
    page = page_of(report_of(found, figures, 0.01))
    assert "<li>unified+integral: passes 0 to 1, tracks 0 to 2</li>" in page
    assert "500 mm" in page
    lost = dict.fromkeys(figures, replace(GOOD, outcome="stuck"))
    assert "<li>unified+integral: passes nowhere</li>" in page_of(report_of(found, lost, 0.01))


def test_what_a_plant_leaves_out_is_told() -> None:
    found = battery("payload", "friction", laws=1)
    page = page_of(report_of(found, {cell.key: GOOD for cell in found.cells}, 0.01))
    assert "Left out: friction, its wheels cannot slip." in page
