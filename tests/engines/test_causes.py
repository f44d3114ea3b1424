"""Causes are found by switching one thing at a time, in engines whose every fault is known."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rpctl.engines.comparison import EngineGap
from rpctl.engines.engine import ALL_MENDED, Mended, Switch
from rpctl.engines.recording import EngineRecording
from rpctl.engines.referee import Trace, trace
from rpctl.errors import UnknownNameError

KNOWN = tuple(Switch(name, f"{name} is off", f"mend {name}") for name in ("wheel", "cone", "mimic"))
Error = Callable[[Mended], float]  # what an engine is off, in bands, with switches


def compare(asked: EngineRecording, did: EngineRecording) -> tuple[EngineGap, ...]:
    gap = did.off - asked.off  # type: ignore[attr-defined]
    return (EngineGap("path", gap, 1.0, "m", f"is {gap:g} off"),)


def recording(off: float, fault: str = "") -> EngineRecording:
    return cast(EngineRecording, SimpleNamespace(off=off, fault=fault))


def traced(error: Error) -> Trace:
    """Return the trace of an engine that is off by a function of its switches."""

    def run(mended: Mended) -> EngineRecording:
        return recording(error(mended))

    return trace(KNOWN, run, compare, recording(0.0))


def off(mended: Mended, name: str) -> bool:
    return name not in mended


@pytest.mark.parametrize("name", ["wheel", "cone", "mimic"])
def test_the_one_fault_is_named_and_no_other(name: str) -> None:
    found = traced(lambda switches: 5.0 * off(switches, name))
    assert [cause.names for cause in found.causes] == [(name,)]
    assert found.causes[0].gaps[0].words == "is 5 off"
    assert found.complete and not found.remaining and not found.cured


def test_the_largest_of_two_faults_stands_first() -> None:
    found = traced(lambda s: 2.0 * off(s, "wheel") + 7.0 * off(s, "mimic"))
    assert [cause.names for cause in found.causes] == [("mimic",), ("wheel",)]
    assert found.complete


def test_two_that_only_matter_together_are_one_cause() -> None:
    found = traced(lambda s: 4.0 * (off(s, "wheel") and off(s, "cone")))
    assert [cause.names for cause in found.causes] == [("wheel", "cone")]
    assert found.complete


def test_what_only_breaks_the_mended_engine_is_no_cause() -> None:
    """As a step that is too long for hard contacts, and short enough for the soft default."""
    found = traced(lambda s: 3.0 * off(s, "wheel") + 9.0 * (off(s, "cone") and "mimic" in s))
    assert [cause.names for cause in found.causes] == [("wheel",)]


def test_a_fault_that_only_the_default_engine_shows_is_added() -> None:
    """Mending the wheel alone leaves something that cone does only while mimic is default."""
    found = traced(lambda s: 3.0 * off(s, "wheel") + 5.0 * (off(s, "cone") and off(s, "mimic")))
    assert found.causes[0].names == ("wheel",)
    assert len(found.causes) == 2 and found.causes[1].names in (("cone",), ("mimic",))
    assert found.causes[1].gaps == () and found.complete


def test_what_no_switch_mends_remains() -> None:
    found = traced(lambda s: 6.0)
    assert not found.causes and not found.complete
    assert found.remaining[0].gap == 6.0


def test_a_mended_engine_that_cannot_run_is_not_traced_further() -> None:
    runs: list[Mended] = []

    def run(mended: Mended) -> Any:
        runs.append(mended)
        return recording(0.0, "it diverges")

    def never(asked: EngineRecording, did: EngineRecording) -> tuple[EngineGap, ...]:
        return (EngineGap("run", float("inf"), 1.0, "", did.fault),)

    found = trace(KNOWN, run, never, recording(0.0))
    assert runs == [ALL_MENDED] and not found.complete


def test_a_switch_that_means_nothing_to_an_engine_stays_mended() -> None:
    seen: list[Mended] = []

    def error(mended: Mended) -> float:
        seen.append(mended)
        return 2.0 * off(mended, "wheel")

    traced(error)
    assert all("losses" in mended for mended in seen)


def test_a_switch_has_a_name_that_is_known() -> None:
    with pytest.raises(UnknownNameError, match="colour"):
        Switch("colour", "", "")
