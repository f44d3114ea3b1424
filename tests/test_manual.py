"""The README and the manual do what they say: commands, their output, Python, TOML, links."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app, load_command
from rpctl.simulation.config import read_config
from rpctl.simulation.loop.track import default_duration
from rpctl.simulation.merits.outcome import OUTCOMES
from tests.grids import cells

ROOT = Path(__file__).parents[1]
WRITTEN = [*sorted((ROOT / "docs").rglob("*.md"))]
MADE = {"gallery.md", "command_line.md", "keys.md", "api.md"}  # by docs/_ext/from_code.py
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *WRITTEN]
    if path.name not in MADE and "_build" not in path.parts
}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
LONG = 130  # lines: the README has no more


def blocks(page: str, language: str) -> list[str]:
    """Return the fenced blocks of a page in a language."""
    return [body for kind, body in FENCE.findall(PAGES[page]) if kind == language]


def commands(page: str) -> list[tuple[str, list[str]]]:
    """Return the commands of a page in their order, each with what it prints as it is written."""
    found: list[tuple[str, list[str]]] = []
    for line in "".join(blocks(page, "console")).splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def served(command: str) -> bool:
    """Return whether a command serves a page until Ctrl-C."""
    return command.startswith("rpctl view")


def in_words(text: str) -> str:
    """Return a text without the figures that a machine or a version makes, spaces as one."""
    return " ".join(re.sub(r"[\d.]+(e-\d+)?( [mµn]?m\b)?", "0", text).split())


WITH_COMMANDS = [page for page in PAGES if any(not served(c) for c, _ in commands(page))]


@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_commands_have_the_options_that_are_written(page: str) -> None:
    """Those that serve a page included."""
    for line, _ in commands(page):
        name, *words = shlex.split(line.partition(" > ")[0].removeprefix("rpctl "))
        with load_command(name).make_context(name, words):
            pass


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_commands(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They run in their order as they are written, and print what is written below them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    (tmp_path / "demos").symlink_to(ROOT / "demos")
    for line, printed in commands(page):
        if served(line):
            continue
        if any(word in line for word in ("contact", "referee", "mjcf", "check", "onset")):
            pytest.importorskip("mujoco")
        command, _, file = line.removeprefix("rpctl ").partition(" > ")
        result = CliRunner().invoke(app, shlex.split(command))
        assert result.exit_code == 0, result.output
        if file:
            Path(file).write_text(result.stdout, encoding="utf-8")
        output = in_words(result.output)
        missing = [each for each in printed if each != "..." and in_words(each) not in output]
        assert not missing, result.output


WITH_PYTHON = [page for page in PAGES if blocks(page, "python")]


@pytest.mark.parametrize("page", cells(WITH_PYTHON, slow=WITH_PYTHON[1:]))
def test_python(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks of a page are one script, whose prints say what stands behind them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demos").symlink_to(ROOT / "demos")
    script, printed = "".join(blocks(page, "python")), list[str]()
    code = compile(script, page, "exec", dont_inherit=True)
    exec(code, {"__name__": page, "print": lambda *v: printed.append(" ".join(map(str, v)))})
    assert printed == re.findall(r"^ *print\(.*?\)\s+# (.*)", script, flags=re.MULTILINE)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "toml")])
def test_toml(page: str, tmp_path: Path) -> None:
    """Drive files load the robot that they are of, files of runs are read, paths are paths."""
    for k, text in enumerate(blocks(page, "toml")):
        file = tmp_path / f"{k}.toml"
        file.write_text(text, encoding="utf-8")
        if text.startswith("type"):
            declared, found = rpctl.load("tricycle", drive=file).drive, rpctl.load("tricycle").drive
            assert [(w.joint, w.driven) for w in declared.wheels] == [
                (w.joint, w.driven) for w in found.wheels
            ]
            assert [(s.joint, s.role) for s in declared.swivels] == [
                (s.joint, s.role) for s in found.swivels
            ]
        elif text.startswith("waypoints"):
            assert default_duration(rpctl.load_reference(rpctl.load("paper"), str(file))) > 1.0
        else:
            read_config(file)


@pytest.mark.parametrize("page", PAGES)
def test_links_and_files_exist(page: str) -> None:
    folder = (ROOT / page).parent
    links = re.findall(r"\]\(([^)#\s]+)(?:#[\w-]+)?\)", PAGES[page])
    names = re.findall(r"`((?:rpctl|demos|tests|docs)/[\w/.]+)`", PAGES[page])
    lost = [each for each in links if "://" not in each and not (folder / each).exists()]
    lost = [each for each in lost if Path(each).name not in MADE]
    assert not lost + [name for name in names if not (ROOT / name).exists()]


def test_every_page_is_in_the_contents() -> None:
    index = PAGES["docs/index.md"]
    pages = {page.removeprefix("docs/").removesuffix(".md") for page in PAGES if "docs/" in page}
    listed = set(re.findall(r"^[\w/]+$", index, flags=re.MULTILINE))
    assert pages - {"index"} <= listed
    assert {"gallery", "reference/api", "reference/keys", "reference/command_line"} <= listed


def test_every_outcome_is_told() -> None:
    rows = re.findall(r"^\| (`.*?`) \|", PAGES["docs/concepts/outcomes.md"], flags=re.MULTILINE)
    told = [word for row in rows for word in re.findall(r"`([\w-]+)`", row)]
    assert sorted(told) == sorted(OUTCOMES)


def test_the_readme_is_short() -> None:
    assert PAGES["README.md"].count("\n") <= LONG
    figure = re.search(r"!\[.*\]\((\S+)\)", PAGES["README.md"])
    assert figure is not None
    assert (ROOT / figure[1]).stat().st_size < 5e6


@pytest.mark.slow
def test_the_manual_is_built(tmp_path: Path) -> None:
    """Warnings are errors; pages work from the disk, without a script or a style of the network."""
    pytest.importorskip("sphinx")
    words = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(tmp_path / "trees")]
    command = [sys.executable, "-m", "sphinx", *words, str(ROOT / "docs"), str(tmp_path / "html")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for page in (tmp_path / "html").rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="https?:', text), page
    equations = (tmp_path / "html/concepts/dynamics.html").read_text(encoding="utf-8")
    assert equations.count("<math") > 1
