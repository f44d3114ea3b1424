"""What pages carry of others: known scripts only, with the whole of their licences."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import sys
from html import unescape
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path

import pytest

from rpctl import Robot, Run
from rpctl.errors import RpctlError
from rpctl.view.pages import third_party
from rpctl.view.pages.report import write_report
from rpctl.view.pages.robot_page import robot_page
from rpctl.view.pages.third_party import SHA256, licences, meshcat_script, uplot_script
from rpctl.view.scene.scene import build_scene
from tests.view.pages.pages import bare_scene, waiting_page

FOUND = find_spec("meshcat")
MESHCAT = Path(*(FOUND.submodule_search_locations or ()) if FOUND else ())
FILES = [third_party.MESHCAT_SCRIPT, third_party.MESHCAT_LICENCE, third_party.BUNDLED_LICENCES]


@pytest.fixture
def pages(cart: Robot, cart_run: Run, tmp_path: Path) -> dict[str, str]:
    report = write_report(cart_run, tmp_path / "report.html", robot=cart)
    return {  # plain text: older MarkupSafe escapes what a page is parted at
        "report": report.read_text(encoding="utf-8"),
        "robot": str(robot_page(cart)),
        "served": str(waiting_page(cart)),
        "scene": str(bare_scene(build_scene(cart, cart_run))),
    }


def allowed(page: str) -> set[str]:
    """Return the SHA-256 (hexadecimal) of the scripts that a page's policy lets run."""
    found = re.findall(r"'sha256-([^']*)'", page.partition("</head>")[0])
    return {base64.b64decode(each).hex() for each in found}


def test_the_scripts_of_others_that_may_run_are_those_with_a_recorded_hash(
    pages: dict[str, str],
) -> None:
    meshcat, uplot = SHA256[third_party.MESHCAT_SCRIPT], SHA256[third_party.UPLOT_SCRIPT]
    for name, page in pages.items():
        scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
        assert allowed(page) == {hashlib.sha256(each.encode()).hexdigest() for each in scripts}
        assert meshcat in allowed(page)
        assert (uplot in allowed(page)) is (name in ("report", "served"))


def other_meshcat(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let a copy of the files that pages take stand for meshcat."""
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(MESHCAT / name, folder / name)
    spec = ModuleSpec("meshcat", None, is_package=True)
    spec.submodule_search_locations = [str(folder)]
    monkeypatch.setattr(third_party, "find_spec", {"meshcat": spec}.get)
    return folder


@pytest.mark.parametrize("name", FILES)
def test_a_meshcat_that_is_not_the_known_one_goes_into_no_page(
    name: str, cart: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = other_meshcat(tmp_path, monkeypatch) / name
    assert len(robot_page(cart)) > 800_000
    file.write_bytes(file.read_bytes() + b" ")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()[:8]
    with pytest.raises(RpctlError, match=f"{name}: not the file .* begins {digest}.* pip install .*"
                       "'meshcat==0.3.2'"):  # fmt: skip
        robot_page(cart)
    file.unlink()
    with pytest.raises(RpctlError, match=f"{name} is missing; run: pip install 'meshcat==0.3.2'"):
        robot_page(cart)
    monkeypatch.setattr(third_party, "find_spec", lambda name: None)
    with pytest.raises(RpctlError, match="meshcat or its"):
        robot_page(cart)


def test_a_uplot_that_was_changed_goes_into_no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    script = uplot_script()
    monkeypatch.setattr(third_party, "asset", lambda name: script.replace("uPlot", "uPl0t"))
    with pytest.raises(RpctlError, match=r"uPlot\.iife\.min\.js: not the file .*'rpctl'"):
        uplot_script()


def test_every_work_in_the_scripts_has_the_whole_of_its_licence() -> None:
    """Each work that the bundler lists or names is there; one comes without its words."""
    found = {each.work: each for each in licences(charts=True)}
    listed = json.loads((MESHCAT / third_party.BUNDLED_LICENCES).read_text(encoding="utf-8"))
    works = {f"{each['name']} {each['version']}" for each in listed}
    assert set(found) == {"meshcat 0.3.2", "uPlot 1.6.32"} | works
    assert "three 0.132.2" in works
    banner = (MESHCAT / f"{third_party.MESHCAT_SCRIPT}.LICENSE.txt").read_text(encoding="utf-8")
    for named in ("ieee754", "Three.js", "event-lite"):
        assert named in banner
        assert any(work.startswith(named.lower().removesuffix(".js")) for work in works)
    ends = {"MIT": "SOFTWARE.", "BSD-3-Clause": "SUCH DAMAGE.", "Apache-2.0": "under the License."}
    for each in found.values():
        words = " ".join(each.text.split()).replace("THE USE OR OTHER DEALINGS IN THE", "")
        assert words.upper().rstrip().endswith(ends[each.name].upper()), each.work
        assert "copyright" in each.text.lower(), each.work
        assert len(each.text) > 1000, each.work
    assert found["isarray 1.0.0"].text.startswith("Copyright (c) Julian Gruber")
    assert "uPlot 1.6.32" not in {each.work for each in licences(charts=False)}


def test_pages_carry_the_licences_of_their_scripts(pages: dict[str, str]) -> None:
    for name, page in pages.items():
        block = page.partition('<details class="licences">')[2].partition("</details>")[0]
        texts = [unescape(each) for each in re.findall("<pre>(.*?)</pre>", block, re.DOTALL)]
        assert texts == [each.text for each in licences(charts=name in ("report", "served"))]
        assert "<details open" not in page
    kept = pages["scene"].partition('<template id="licences">')[2]
    assert kept.startswith('<details class="licences">')  # part of the page, and nothing drawn


def test_pages_take_nothing_but_files_of_meshcat(
    cart: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its Python would load IPython, a server and the client of a tunnel: they cannot be loaded."""
    for module in ("IPython", "pyngrok", "tornado", "zmq", "meshcat.visualizer"):
        monkeypatch.setitem(sys.modules, module, None)
    assert meshcat_script() in robot_page(cart)
    assert "meshcat" not in sys.modules
