"""Names of others are text wherever they are shown: no markup, formula, code, or hidden sign."""

from __future__ import annotations

import ast
import csv
import json
import random
import re
import shutil
import subprocess
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from rich.text import Text
from typer.testing import CliRunner

from rpctl.cli.app import app
from rpctl.cli.options import default_folder
from rpctl.cli.terminal import PIPED_WIDTH, console, escape
from rpctl.errors import printable
from rpctl.files.writing import to_json
from rpctl.view.labels import literal
from rpctl.view.pages.page import embed, render
from tests import urdf
from tests.grids import cells
from tests.robots import SET_A, platform

NASTY = {
    "closing tag": "[/x]",
    "open tag": "[red",
    "link": "[link=http://evil.example]here[/link]",
    "emoji code": ":warning:",
    "backslashes": "a\\[b\\\\\\",
    "formula": "$\\frac{$",
    "low line": "_hidden",
    "direction": "\u202egnp.exe\u2066",
    "no width": "a\u200bb\ufeff\u3164",
    "beyond the plane": "🤖日本\U000e0041",
    "page": "</script><img src=x onerror=alert(1)>\"'&lt;",
    "comment": "*/ int main(void) { } /* \"\"\" ''' // ?? \\",
    "LaTeX": "\\end{document}\\input{/etc/passwd}%^~#&_",
    "table": "=cmd|' /C calc'!A0",
    "template": "%s{}{0}${data}$data",
    "path": "../../../etc/passwd",
    "option": "-rf",
    "long": "n" * 3000,
}
MARKUP = "[]\\/#@=:ab \x1b\u202e"
runner = CliRunner()


def robot(name: str) -> str:
    """Return a URDF whose robot, base, wheel and arm have a name, each with a letter behind it."""
    arm = [
        urdf.link("arm", urdf.inertial(1, (0.1, 0.1, 0.1))),
        urdf.joint("turn", "revolute", ("base", "arm"), "0 0 0.3", "0 0 1",
                   urdf.limit(-2, 2, 30, 2)),
    ]  # fmt: skip
    text = platform(SET_A, extra="\n".join(arm))
    for word in ("platform", "base", "arm", "turn", "left_joint", "left_wheel"):
        text = text.replace(f'"{word}"', quoteattr(f"{name}{word[0]}"))
    return text


def run(*words: str | Path) -> str:
    """Run a command that must succeed; check that nothing of what it prints is hidden."""
    result = runner.invoke(app, [*map(str, words)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    shown = result.stdout + result.stderr
    assert result.exit_code in (0, 1), shown  # 1: so short a run does not arrive
    assert printable(shown, keep="\n") == shown
    return result.stdout


def texts(seed: int, count: int) -> list[str]:
    """Return random texts of what markup is made of, and the nasty ones."""
    drawn = random.Random(seed)
    return [*NASTY.values(), *("".join(drawn.choices(MARKUP, k=5)) for _ in range(count))]


def letters(text: str) -> str:
    """Return a text without the backslashes, of which Rich's markup may show more."""
    return text.replace("\\", "")


def test_markup_of_others_is_shown() -> None:
    """Also of two texts together, where the second closes the first's bracket."""
    drawn = random.Random(7)
    for first in texts(7, 400):
        second = drawn.choice(texts(8, 40))
        shown = Text.from_markup(f"{escape(first)}: [bold]{escape(second)}[/] end", emoji=False)
        expected = f"{printable(first)}: {printable(second)} end"
        assert letters(shown.plain) == letters(expected), (first, second)
        assert {span.style for span in shown.spans} <= {"bold"}, (first, second)
    assert console().render_str(":warning:").plain == ":warning:"
    assert console().width == PIPED_WIDTH  # no line of piped text is broken


def test_ordinary_names_are_shown_as_they_are() -> None:
    for text in ("arm_left_1_joint", "wheel [front]", "Größe ν", "a\\b", "x[0]", "C:\\robots\\a"):
        assert Text.from_markup(escape(text)).plain == text


def test_texts_of_others_in_pages_are_seen() -> None:
    for text in texts(9, 50):
        data = embed({"name": text, text: [text]})
        assert "<" not in data
        seen = printable(text)
        assert json.loads(data, strict=False) == {"name": seen, seen: [seen]}, text
        assert json.loads(embed(text, shown=False)) == text
        page = render("notebook.html", summary=text, title="", fault="none", page="")
        paragraph = page.removeprefix("<p>").partition("</p>")[0]
        assert "<" not in paragraph and printable(paragraph, keep="\n") == paragraph


def test_json_says_what_does_not_print_in_ascii_and_is_read_again() -> None:
    for text in (*texts(10, 50), "\udcff\x80\x9b\u2028"):
        written = to_json({text: text})
        assert printable(written, keep="\n") == written
        assert json.loads(written) == {text: text}
    assert to_json("Größe ν") == '"Größe ν"'


def test_figures_read_no_formulas() -> None:
    from matplotlib.cbook import is_math_text

    for text in (*NASTY.values(), "$x$", "\\$x$", "a$"):
        unescaped = is_math_text(literal(text))
        assert not unescaped and not literal(text).startswith("_")


@pytest.mark.parametrize("name", NASTY.values(), ids=NASTY)
def test_no_name_leads_out_of_the_folder_of_runs(name: str) -> None:
    folder = default_folder(name, name)
    assert folder.parent == Path("runs") and folder.name not in ("", ".", "..")
    assert not folder.name.startswith(("-", ".")) and len(folder.name.encode()) < 255
    assert default_folder(name, "eight") != default_folder(name, "line")


def test_a_name_with_a_control_character_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    for sign in ("\x9b", "\n", "\t", "\x85"):
        path.write_text(robot(f"a{sign}b"), encoding="utf-8")
        result = runner.invoke(app, ["inspect", str(path)])
        assert result.exit_code == 2
        lines = result.stderr.splitlines()
        assert f'link "a{printable(sign)}bb" has a control character in its name' in result.stderr
        assert all(line.startswith(f"{path}:") for line in lines)


@pytest.mark.parametrize("name", ["comment"])
def test_a_robot_of_any_name_is_inspected_and_derived(name: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(robot(NASTY[name]), encoding="utf-8")
    assert printable(NASTY[name])[:6] in run("inspect", path)
    assert json.loads(run("inspect", path, "--json"))["name"] == f"{NASTY[name]}p"
    ast.parse(run("derive", path, "--format", "python"))
    source = run("derive", path, "--format", "c")
    assert re.sub(r"/\*.*?\*/", "", source, flags=re.DOTALL).isascii()
    assert "main(" not in re.sub(r"/\*.*?\*/|//[^\n]*", "", source, flags=re.DOTALL)


def joined(*names: str) -> str:
    return "".join(NASTY[name] for name in names)


TOGETHER = [  # each begins with what counts at the beginning only
    joined("closing tag", "open tag", "emoji code", "formula", "backslashes"),
    joined("low line", "link"),
    joined("table", "page", "direction", "no width", "beyond the plane"),
    joined("path", "comment"),
    joined("option", "LaTeX", "template"),
    joined("long"),
]


@pytest.mark.parametrize("name", cells(TOGETHER, slow=TOGETHER[2:3]), ids=lambda name: name[:4])
def test_every_command_takes_any_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("robot.urdf").write_text(robot(name), encoding="utf-8")
    run("verify", "robot.urdf", "--samples", "1", "--html", "certificate.html")
    for form in ("text", "latex"):
        run("derive", "robot.urdf", "--format", form)
    source = run("derive", "robot.urdf", "--format", "c")
    if shutil.which("cc"):
        subprocess.run(["cc", "-x", "c", "-fsyntax-only", "-Werror", "-"], input=source.encode(),
                       check=True)  # fmt: skip
    out = Path("out")
    run("track", "robot.urdf", "--duration", "0.1", "--no-perturbed", "--samples", "1",
        "--out", out)  # fmt: skip
    run("plot", out)
    run("view", "robot.urdf", "--html", "robot.html")
    run("compare", "robot.urdf", "--duration", "0.1", "--laws", "unified", "--references", "line",
        "--scenarios", "nominal", "--workers", "1", "--out", out)  # fmt: skip
    for page in ("certificate.html", "robot.html", "out/report.html"):
        html = Path(page).read_text(encoding="utf-8")
        assert "<img src=x" not in html
        assert page == "robot.html" or "\u202e" not in html
    from rpctl import Run

    Run.load(out / "run.npz").to_csv("run.csv")
    for file in ("run.csv", "out/compare.csv"):
        with Path(file).open(encoding="utf-8", newline="") as opened:
            header, *rows = csv.reader(opened)
        assert not [cell for cell in header if cell.startswith(("=", "+", "-", "@"))]
        assert all(len(row) == len(header) for row in rows)


@pytest.mark.slow
def test_a_path_that_is_no_utf8_can_be_read_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a\udcff"  # the byte 0xff
    folder.mkdir()
    monkeypatch.chdir(folder)
    Path("robot\udcfe.urdf").write_text(robot("name"), encoding="utf-8")
    file, out = folder / "robot\udcfe.urdf", folder / "out\udcfd"
    words = ("--duration", "0.1", "--no-perturbed", "--samples", "1")
    report = json.loads(run("track", file, *words, "--out", out, "--json"))["report"]
    assert Path(report).is_file()
    run("plot", out)
    run("inspect", file)
