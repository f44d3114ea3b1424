"""Pages of tables on a phone, 400 px wide: nothing is cut, nothing runs out of the window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rpctl.equivalence.certificate import Check
from rpctl.equivalence.scope import Scope
from rpctl.equivalence.verify import Certificate
from rpctl.study.stress_report import report_of
from rpctl.view.pages.certificate import certificate_page
from rpctl.view.pages.stress import stress_page
from tests.study.stress_samples import battery, made_up
from tests.view.chromium import CLIPPED

PHONE = {"width": 400, "height": 800}
LONG = "gripper_left_inner_double_joint_of_a_long_name"


def certificate() -> str:
    check = Check("inverse dynamics along ν", "Pinocchio, constrained", 3e-16, 1e-12, 66, LONG)
    return certificate_page(
        Certificate(
            robot="robot", samples=100, seed=0, checks=(check,), scope=Scope("all", (), (), None)
        )
    )


def stress() -> str:
    found = battery("payload", laws=2, combinations=1)
    report = report_of(found, {cell.key: made_up(cell.key) for cell in found.cells}, 0.01)
    worst = [("worst-1.toml", f"rpctl track {LONG}"), ("worst-2.toml", "rpctl track x")]
    return stress_page(report, worst).decode()


@pytest.mark.slow
@pytest.mark.parametrize("make", [certificate, stress])
def test_rows_stack_on_a_phone(make: Any, browser: Any, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(make(), encoding="utf-8")
    page = browser.new_page(viewport=PHONE)
    page.goto(file.as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    assert page.locator(".stack td").count() > 2
    assert page.evaluate(CLIPPED, ".stack tr > *") == []
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    first = page.locator(".stack tr:last-child td").last
    assert page.evaluate("(cell) => getComputedStyle(cell, '::before').content",
                         first.element_handle()) in ('"Worst at"', '"why"')  # fmt: skip
    page.set_viewport_size({"width": 1280, "height": 800})
    assert page.locator(".stack thead th").first.is_visible()
    page.close()
