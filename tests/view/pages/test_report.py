from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

import rpctl
from rpctl import (
    EndEffector,
    IntegralDynamic,
    PaperKinematic,
    Robot,
    Run,
    UnifiedKinematic,
)
from rpctl.control.registry import Unregistered
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plants.plant import Plant
from rpctl.view.pages.page import embed
from rpctl.view.pages.report import write_report
from rpctl.view.pages.settings import setting_texts
from tests.runs import vary
from tests.view.samples import (
    BOX,
    mesh_visual,
    short_run,
    write_cart,
)

EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"


class Tags(HTMLParser):
    """All elements of a page, with the texts of its scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.inside = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self.inside = tag == "script"
        if self.inside:
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self.inside = False

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.scripts[-1] += data


@pytest.fixture(scope="module")
def page(paper: Robot, paper_run: Run, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    return write_report(paper_run, path, robot=paper).read_text(encoding="utf-8")


def test_nothing_is_fetched(page: str) -> None:
    for tag, attributes in Tags(page).found:
        assert tag not in ("iframe", "object", "embed", "base")
        for name in ("src", "href", "srcset", "action", "poster"):
            assert (attributes.get(name) or "data:").startswith("data:"), (tag, attributes)
    _, meshcat, uplot, _ = Tags(page).scripts
    own = re.sub(r'<details class="licences">.*?</details>', "", page, flags=re.DOTALL)
    own = own.replace(meshcat, "").replace(uplot, "")
    assert not re.findall(r"https?://|@import|url\(|fetch\(|XMLHttpRequest|WebSocket", own)


def test_only_the_scripts_of_the_report_may_run(page: str) -> None:
    tags = Tags(page)
    (policy,) = (a["content"] for _, a in tags.found if "Content-Security-Policy" in a.values())
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    for script in tags.scripts[1:]:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2].partition(";")[0]


def test_no_path_of_the_machine_is_passed_on(tmp_path: Path) -> None:
    visual = mesh_visual(str(tmp_path / "gone.stl")) + BOX
    robot = rpctl.load(write_cart(tmp_path, visual))
    run = short_run(robot, 0.3)
    run = replace(run, config=run.config.with_run(reference=str(tmp_path / "path.csv")))
    text = write_report(run, tmp_path / "report.html", robot=robot).read_text(encoding="utf-8")
    assert "gone.stl" in text
    assert "path.csv" in text
    for private in (str(tmp_path), str(Path.home()), str(Path(rpctl.__file__).parent)):
        assert len(private) < 2 or private not in text


def test_names_from_files_cannot_become_markup(
    paper: Robot, paper_run: Run, tmp_path: Path
) -> None:
    evil = vary(
        paper_run,
        name=EVIL,
        end_effector=EVIL,
        quasi_velocities=(*paper_run.robot.quasi_velocities[:-1], EVIL),
        config=Config(Unregistered(EVIL, {EVIL: 1.0}), run=RunSettings(EVIL)),
        controller_model=EVIL,
        kinematic_report={EVIL: 1.0},
        certificate={
            "passed": False,
            "samples": EVIL,
            "seed": 0,
            "checks": [
                {"name": EVIL, "against": EVIL, "residual": 1.0, "limit": 0.1, "passed": False}
            ],
            "skipped": [{"name": EVIL, "against": EVIL, "note": EVIL}],
        },
    )
    path = write_report(evil, tmp_path / "report.html", robot=paper)
    tags = Tags(path.read_text(encoding="utf-8"))
    assert len(tags.scripts) == 4
    assert "img" not in [tag for tag, _ in tags.found]
    assert not any(name.startswith("on") for _, attributes in tags.found for name in attributes)


def test_embedded_json_cannot_end_its_script() -> None:
    text = embed({"a": "</script><!--"})
    assert "<" not in text
    assert json.loads(text) == {"a": "</script><!--"}


def test_comparison_names_its_runs_and_what_differs(
    paper_run: Run, paper: Robot, tmp_path: Path
) -> None:
    other = short_run(paper, 1.0)
    path = rpctl.write_report([paper_run, other], tmp_path / "compare.html")
    text = path.read_text(encoding="utf-8")
    assert 'data-layer="run-2"' in text
    assert "2: paper, eight" in text
    assert "<td><b>1</b></td>" in text  # their durations differ
    with pytest.raises(rpctl.RpctlError, match="2 runs, 1 names"):
        write_report([paper_run, other], path, names=["one"])
    with pytest.raises(rpctl.RpctlError, match="no run"):
        write_report([], path)


def test_runs_are_called_by_what_differs(paper: Robot, tmp_path: Path) -> None:
    laws = [UnifiedKinematic(), PaperKinematic(), PaperKinematic()]
    runs = [rpctl.track(paper, "line", duration=0.1, kinematic=law) for law in laws]
    text = rpctl.write_report(runs[:2], tmp_path / "two.html").read_text(encoding="utf-8")
    assert "2 runs: UnifiedKinematic · PaperKinematic" in text
    text = rpctl.write_report(runs, tmp_path / "three.html").read_text(encoding="utf-8")
    assert "1: UnifiedKinematic · 2: PaperKinematic · 3: PaperKinematic" in text


def test_laws_within_laws_are_named(paper_run: Run) -> None:
    config = Config(EndEffector(), IntegralDynamic())
    rows = setting_texts(replace(paper_run, config=config))
    assert (rows["Kinematic law"], rows["Law of the base"]) == ("EndEffector", "Horizon")
    assert (rows["Dynamic law"], rows["Law within"]) == ("IntegralDynamic", "BoundedDynamic")


def test_what_is_before_a_law_and_what_the_plant_does_is_told(paper_run: Run) -> None:
    plain = setting_texts(replace(paper_run, config=Config(), law_sentences=()))
    assert (plain["Leash (m, rad)"], plain["Approach (m, rad)"]) == ("0.3, 1", "0.5, 0.8")
    assert plain["Model of the period's middle"] == "yes"
    absent = {"Gains", "Delay, s", "Fraction of samples dropped", "Computing time, s"}
    absent |= {"Reference retimed"}
    assert not absent & plain.keys()
    config = Config(
        UnifiedKinematic(joint_horizon=0.3, leash=None),
        IntegralDynamic(joint_gain=7.0),
        RunSettings(smooth=0.01, retime=True),
        plant=Plant(delay=0.004, dropped=0.3, computing_time=0.006),
    )
    rows = setting_texts(replace(paper_run, config=config, law_sentences=("gains: 5 Hz", "x")))
    assert "Leash (m, rad)" not in rows
    told = {
        "Joints' horizon h, s": "0.3", "Joints' gain k, 1/s": "7", "Gains": "5 Hz",
        "Reference smoothed by, m": "0.01", "Reference retimed": "yes",
        "Delay, s": "0.004", "Fraction of samples dropped": "0.3", "Computing time, s": "0.006",
    }  # fmt: skip
    assert {label: rows.get(label) for label in told} == told
