"""Damaged files of xacro: a text, or one message that names a file; no traceback and no hang."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random

import pytest

from rpctl.description.records import ReadSettings
from rpctl.description.xacro.expansion import expand
from rpctl.errors import RpctlError
from tests.description.mutations import damage
from tests.description.test_fuzz import patience
from tests.grids import cells
from tests.workspaces import fixed, link, package, write, xacro

pytest.importorskip("xacro")

PATIENCE = 90  # s; a hang, however slow the machine
SEED = 7
COUNTS = {4: "quick", 12: "slow", 1500: "thorough"}
EXPRESSIONS = (
    "$(find parts)", "$(find )", "$(find ../parts)", "$(arg size)", "$(arg none)", "$(env HOME)",
    "$(optenv HOME /root)", "$(dirname)/..", "$(cwd)", "$(eval 1/0)", "$(eval find('parts'))",
    "${1/0}", "${[0]*9**9}", "${'a'*10**6}", "${xacro.load_yaml('m.yaml')}", "${m}", "${size*2}",
    "${xacro.load_yaml('/etc/passwd')}", "${(lambda f: f(f))(lambda f: f(f))}", "${vars()}",
    "$${x}", "${python.type('X', (), {})}", "${xacro.fatal('\u202e[/bold]')}",
    "${xacro.warning('w' * 9999)}", "${''.join(map(chr, range(40)))}", "${", "$(",
    "*.xacro", "m.yaml", "/dev/zero", "package://parts", "package://parts/part.xacro",
    "r.urdf.xacro", ".", "parts:=x",
)  # fmt: skip
ELEMENTS = (
    '<xacro:include filename="{}"/>', '<xacro:property name="m" value="{}"/>', "<xacro:wheel/>",
    '<xacro:macro name="{}" params="a *b c:=^|1"><xacro:insert_block name="b"/></xacro:macro>',
    '<xacro:if value="{}"><link/></xacro:if>', '<xacro:arg name="{}" default="{}"/>',
    '<xacro:wheel side="{}" y="{}"/>', '<xacro:call macro="{}"/>',
    '<xacro:element xacro:name="{}"/>', '<xacro:attribute name="{}" value="{}"/>', "<xacro:{}/>",
    '<xacro:property name="{}"/>', '<xacro:include filename="{}" ns="n" optional="true"/>',
    '<mesh filename="{}"/>',
)  # fmt: skip


def workspace(folder: Path) -> Path:
    """Return a robot that uses most of xacro."""
    bot = package(folder / "src" / "bot")
    parts = package(folder / "src" / "parts")
    write(bot / "m.yaml", "m: 4\nlist: [1, {a: 2}]")
    xacro(
        parts / "part.xacro", '<xacro:macro name="wheel" params="side y:=1 *o">',
        link("${side}_wheel", "${m}"), '<xacro:insert_block name="o"/>', "</xacro:macro>",
    )  # fmt: skip
    return xacro(
        bot / "r.urdf.xacro", '<xacro:arg name="size" default="2"/>',
        '<xacro:include filename="$(find parts)/part.xacro"/>',
        "<xacro:property name=\"m\" value=\"${xacro.load_yaml('m.yaml')['m'] * $(arg size)}\"/>",
        link("base", "${m}"), '<xacro:wheel side="left"><origin xyz="0 ${m} 0"/></xacro:wheel>',
        '<xacro:unless value="${m &lt; 3}">', fixed("j", "base", "left_wheel"), "</xacro:unless>",
    )  # fmt: skip


def spoil(data: bytes, random: Random) -> bytes:
    """Return a file with some of xacro's own words where they may not belong."""
    text = data.decode("utf-8")
    for _ in range(random.randint(1, 3)):
        expression = random.choice(EXPRESSIONS)
        if random.random() < 0.5:
            values = text.split('"')
            at = random.randrange(1, len(values), 2)
            values[at] = expression.replace("<", "&lt;").replace("&", "&amp;")
            text = '"'.join(values)
        else:
            pieces = text.split("<")
            at = random.randrange(2, len(pieces))
            pieces[at - 1] += random.choice(ELEMENTS).replace("{}", expression)
            text = "<".join(pieces)
    return text.encode()


@pytest.mark.parametrize(
    "count",
    cells(
        COUNTS,
        quick=[n for n, when in COUNTS.items() if when == "quick"],
        slow=[n for n, when in COUNTS.items() if when == "slow"],
    ),
)
def test_damaged_xacro_is_a_text_or_a_message(
    count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", "/the/home/that/must/not/be/seen")
    monkeypatch.setenv("RPCTL_MAX_XACRO_SECONDS", "10")
    path, outcomes = workspace(tmp_path), Counter[str]()
    part = tmp_path / "src" / "parts" / "part.xacro"
    whole = {file: file.read_bytes() for file in (path, part)}
    assert '<mass value="8"/>' in expand(path).text
    for case in range(count):
        random = Random(f"{SEED} {case}")
        file = random.choice(list(whole))
        done, data = "words", spoil(whole[file], random)
        if random.random() < 0.3:
            done, data = damage(data, random)
        file.write_bytes(data)
        lenient = random.random() < 0.3
        try:
            with patience(PATIENCE):
                text = expand(path, ReadSettings(ignore_missing_packages=lenient)).text
            outcomes["text"] += 1
        except RpctlError as error:
            text = str(error)
            assert all(line.startswith(str(tmp_path)) for line in text.splitlines()), case
            assert text.replace("\n", "").isprintable(), case
            assert len(text) < 100_000, case
            outcomes["message"] += 1
        except Exception as error:
            raise AssertionError(f"seed {SEED}, case {case}: {done}") from error
        assert "root:x:" not in text, case
        assert "must/not" not in text, case
        file.write_bytes(whole[file])
    assert outcomes.total() == count
    assert count < 100 or min(outcomes["text"], outcomes["message"]) > count // 10
    assert capfd.readouterr() == ("", "")
