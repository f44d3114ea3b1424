"""The referee's page: every engine's robot on one timeline, and why it is off."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import umsgpack

from rpctl.engines.comparison import compare
from rpctl.engines.engine import Switch
from rpctl.engines.recording import EngineRecording
from rpctl.engines.referee import Cause, EngineVerdict, Trace
from rpctl.view.pages.referee import referee_page
from tests.engines.test_comparison import arc, known, longer

pytestmark = pytest.mark.slow
SWITCH = Switch("wheel", "its wheels <scrub>", 'set <geom friction="MU"/>')


def verdict(name: str, recording: EngineRecording, *, traced: bool = True) -> EngineVerdict:
    robot, contacts = known()
    gaps = compare(robot, contacts, arc(), recording, {})
    trace = None
    if not all(gap.agrees for gap in gaps):
        causes = (Cause((SWITCH,), gaps[:1]),) if traced else ()
        trace = Trace(causes, arc(), () if traced else gaps[:1], ())
    return EngineVerdict(name, "1.0", gaps, trace, arc(), recording, 0.5)


@cache
def page() -> str:
    verdicts = [
        verdict("Fast", longer(1.3)),
        verdict("Same", arc()),
        verdict("Odd", longer(0.5), traced=False),
        verdict("Broken", replace(_first(longer(1.0)), fault="it <b>diverges</b>")),
    ]
    return referee_page(known()[0], verdicts).decode()


def _first(recording: EngineRecording) -> EngineRecording:
    arrays: dict[str, Any] = {
        k: v[:1] for k, v in vars(recording).items() if isinstance(v, np.ndarray)
    }
    return replace(recording, **arrays, joints={k: v[:1] for k, v in recording.joints.items()})


def data() -> dict[str, Any]:
    found = re.search(r'id="rpctl-data">(.*?)</script>', page(), re.DOTALL)
    assert found is not None
    return dict(json.loads(found[1]))


def test_each_motion_is_a_ghost_in_its_place() -> None:
    """The model, Fast, Fast mended, Same, Odd, Odd mended, Broken mended: Broken itself stood."""
    assert [run["prefix"] for run in data()["runs"]] == ["", *(f"run{k}-" for k in range(2, 8))]
    *_, motion = (umsgpack.unpackb(base64.b64decode(c)) for c in data()["commands"])
    tracks = {t["name"]: t for t in motion["animations"][0]["clip"]["tracks"]}

    def ends(node: str) -> np.ndarray:
        values = np.frombuffer(tracks[f"{node}.position"]["values"].data, "<f4")
        return values.reshape(-1, 3)[-1]

    height = -known()[0].drive.ground
    np.testing.assert_allclose(ends("robot-1"), [*arc().pose[-1, :2], height], atol=1e-6)
    fast = [*(1.3 * arc().pose[-1, :2]), height]
    np.testing.assert_allclose(ends("run2-robot-1"), fast, atol=1e-6)
    np.testing.assert_allclose(ends("run3-robot-1"), ends("robot-1"), atol=1e-6)


def test_charts_tell_how_far_each_is_off() -> None:
    chart = data()["plots"]["charts"][0]["variants"][0]
    lines = {line["label"]: line["values"] for line in chart["lines"]}
    assert next(iter(lines)) == "Fast" and "Same" in lines and "Broken" not in lines
    off = np.frombuffer(base64.b64decode(lines["Fast"]), "<f4")
    way = float(np.hypot(*arc().pose[-1, :2]))
    assert off[0] == 0.0 and off[-1] == pytest.approx(300.0 * way, rel=1e-5)
    assert not np.frombuffer(base64.b64decode(lines["Same"]), "<f4").any()


def test_the_page_tells_causes_and_mends_as_text() -> None:
    text = page()
    assert "its wheels &lt;scrub&gt;" in text and "<scrub>" not in text
    assert "set &lt;geom friction=&#34;0.5&#34;/&gt;" in text
    assert "Not explained: drives 50 % too short" in text
    assert "it &lt;b&gt;diverges&lt;/b&gt;" in text
    assert text.count(">agrees</span>") == 1 and "disagrees, not traced" in text
