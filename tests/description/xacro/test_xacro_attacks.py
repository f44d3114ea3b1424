"""Hostile files of xacro: they run Python, and it reaches no file, process, network or secret."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from random import Random
from typing import Any

import pytest

import rpctl
from rpctl.description.packages import find_packages
from rpctl.description.records import ReadSettings
from rpctl.description.xacro import expansion
from rpctl.description.xacro.expansion import expand
from rpctl.description.xacro.files import (
    MAX_REQUESTS,
    ROWS,
    SINGLES,
    TEXTS,
    XacroFiles,
    check_answer,
)
from rpctl.description.xacro.messages import ExpansionError, findings_of, refuse_faults
from rpctl.files.confinement import open_ways
from rpctl.files.worker import Worker
from tests.description.hostile import ROUTES, run_in_xacro
from tests.grids import every
from tests.workspaces import link, package, write, xacro

pytest.importorskip("xacro")

SECRET = "-----BEGIN KEY-----"
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux has the measures")


def home(folder: Path) -> Path:
    """Return a file of xacro's path in a home with a key, a hidden package and ways out."""
    write(folder / ".ssh" / "id_rsa", SECRET)
    write(folder / "diary" / "today.yaml", SECRET)
    write(package(folder / ".config" / "tool") / "token.yaml", SECRET)
    robots = folder / "robots"
    write(robots / "sizes.yaml", "m: 4")
    write(robots / ".env", SECRET)
    write(robots / ".git" / "config", SECRET)
    (robots / "out.yaml").symlink_to(folder / ".ssh" / "id_rsa")
    (robots / "keys").symlink_to(folder / ".ssh")
    return robots / "r.urdf.xacro"


CODES = [
    "open({home!r} + '/.ssh/id_rsa').read()",
    "io.FileIO({home!r} + '/.ssh/id_rsa').read()",
    "os.listdir({home!r})",
    "open('/proc/self/environ').read()",
    "open('/proc/self/maps').read()",
    "open('/proc/%d/environ' % {parent}).read()",
    "open({home!r} + '/robots/sizes.yaml').read()",
    "open({home!r} + '/robots/written', 'w')",
    "os.mkdir({home!r} + '/made')",
    "os.rename({home!r} + '/robots', {home!r} + '/moved')",
    "os.fork()",
    "os.posix_spawn('/bin/sh', ['sh', '-c', 'touch ' + {home!r} + '/ran'], {{}})",
    "os.execv('/bin/true', ['true'])",
    "os.kill({parent}, 0)",
    "os.pipe()",
    "os.environ['SECRET_TOKEN']",
    "__import__('socket').create_connection(('127.0.0.1', 9))",
    "__import__('subprocess').run(['true'])",
]


@linux
@pytest.mark.parametrize("hook", [False, True])
def test_python_in_an_expression_reaches_nothing(
    hook: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the hook, which such code can switch off, the kernel holds by itself."""
    monkeypatch.setenv("SECRET_TOKEN", SECRET)
    path, parent = home(tmp_path), os.getpid()
    codes = [code.format(home=str(tmp_path), parent=parent) for code in CODES]
    answers = run_in_xacro(path, ["os.getpid()", "dict(os.environ)", *codes], hook)
    assert int(answers[0].removeprefix("got ")) != parent
    assert answers[1] == "got {}"
    for code, answer in zip(codes, answers[2:], strict=True):
        assert not answer.startswith("got "), code
        assert SECRET not in answer
        if "import" not in code and "environ[" not in code:
            assert "Operation not permitted" in answer or (hook and "refused: no .xac" in answer)
    assert {each.name for each in tmp_path.iterdir()} == {".config", ".ssh", "diary", "robots"}
    assert not (tmp_path / "robots" / "written").exists()


@pytest.mark.parametrize("route", every(len(ROUTES), ROUTES))
def test_every_route_to_python_is_a_way_to_nothing(route: str, tmp_path: Path) -> None:
    """If xacro closes one, this fails: put another in its place."""
    codes = ["sum([1, 2])", "open('/etc/passwd').read()"]
    got, refused = run_in_xacro(tmp_path / "r.urdf.xacro", codes, True, route)
    assert got == "got 3"
    assert refused.startswith("PermissionError")


def test_hostile_code_asks_for_files_in_vain(tmp_path: Path) -> None:
    """The pipe to who started it is the one way out, and leads to the file's folders only."""
    path = home(tmp_path)
    wanted = [".ssh/id_rsa", "diary/today.yaml", "robots/out.yaml", "robots/keys/id_rsa",
              "robots/.env", "robots/.git/config", "robots/../diary/today.yaml"]  # fmt: skip
    codes = [f"outside.read({str(tmp_path / each)!r})" for each in wanted]
    codes += ["outside.read('/proc/self/environ')", "outside.find('.ssh')", "outside.find('diary')",
              f"outside.glob({str(tmp_path)!r} + '/*')", "outside.glob('/etc/*')"]  # fmt: skip
    good = f"outside.read({str(path.parent / 'sizes.yaml')!r})"
    *answers, last = run_in_xacro(path, [*codes, good], False)
    for code, answer in zip(codes, answers, strict=True):
        empty = answer in ("got ()", "got []")
        assert empty or answer.startswith("PermissionError: [Errno 13] refused"), code
    assert last == "got b'm: 4'"


FRAMES = [
    b'["answer", {"error": 5}]', b'["answer", {"arguments": [["a"]]}]',
    b'["answer", []]', b'["read", "\\u0000"]', b"[" * 99_999, b'["shut", "x"]', b'["read", 7]',
    b'["find", "\\ud800"]', b"\xff", b'[["a"], ""]',
]  # fmt: skip


@pytest.mark.parametrize("frame", every(len(FRAMES), FRAMES))
def test_a_forged_answer_is_told(frame: bytes, tmp_path: Path) -> None:
    code = f"outside._channel.send({frame!r}), outside._channel.receive(9)"
    with pytest.raises(ExpansionError, match=r"r\.xacro: error: its expansion stopped \(the exp"):
        run_in_xacro(tmp_path / "r.xacro", [code], False)


ANSWER: dict[str, Any] = {
    "told": "", "error": "no", "file": "/a", "line": 3, "macros": ["m"],
    "wants": [["p", "/a", None, "text"]], "left_out": [["/a", 4, "xacro:x"]],
    "moved": [["/a", "/b"]], "undeclared": ["/a"], "arguments": [["n", None, "/a", 2]],
    "open_arguments": ["n"], "old": [["/a", "macro", 2]], "plain": [["/a", "wheel", 3]],
    "defined": [["wheel", "side *origin", 2]],
    "early": [], "unused": ["u"], "asked": ["A"], "dropped": ["d"],
}  # fmt: skip


def test_a_true_answer_is_kept() -> None:
    assert check_answer(ANSWER, {"/a"}, ()) == ANSWER


def test_every_wrong_type_in_an_answer_is_found() -> None:
    wrong: list[Any] = [5.5, {}, [[]], [5], ["x", "y", "z", "w", "v"]]
    for name in {*SINGLES, *TEXTS, *ROWS} - {"no_file"}:
        for value in wrong:
            if name in TEXTS and value == wrong[-1] and name != "undeclared":
                continue
            with pytest.raises(ValueError, match=f'"{name}" of its answer'):
                check_answer({**ANSWER, name: value}, {"/a"}, ())
    for name, rows in ((name, ANSWER[name]) for name in ROWS):
        for column in range(len(rows[0])):
            row = [*rows[0][:column], {}, *rows[0][column + 1 :]]
            with pytest.raises(ValueError, match=name):
                check_answer({**ANSWER, name: [row]}, {"/a"}, ())
    with pytest.raises(ValueError, match="unknown form"):
        check_answer({**ANSWER, "more": 1}, {"/a"}, ())


def test_an_answer_names_no_file_that_was_not_asked_for() -> None:
    for known in (set[str](), {"/b"}):
        with pytest.raises(ValueError, match="of its answer"):
            check_answer(ANSWER, known, ())
    told = {"error": "x", "no_file": "/home/u/.ssh/x"}
    assert "no_file" not in check_answer(told, (), ())
    assert check_answer(told, (), {"/home/u/.ssh/x"})["no_file"] == told["no_file"]


def test_any_answer_of_that_form_is_findings_or_a_message(tmp_path: Path) -> None:
    """Whatever hostile code leaves out of it, or says in it."""
    path, random = tmp_path / "r.xacro", Random(15)
    texts = [
        "",
        "x",
        "\n",
        "\u202e",
        "[/bold]",
        str(path),
        "/etc",
        "a" * 2000,
        "\ud800",
        "$(arg x)",
    ]

    def value(types: tuple[type, ...]) -> object:
        return random.choice(texts) if random.choice(types) is str else random.choice([None, -1, 7])

    for case in range(400):
        said: dict[str, Any] = {name: value(types) for name, types in SINGLES.items()}
        said |= {name: random.choices(texts, k=random.randint(0, 3)) for name in TEXTS}
        said |= {name: [[value(types) for types in row] for _ in range(random.randint(0, 3))]
                 for name, row in ROWS.items()}  # fmt: skip
        kept = random.sample(sorted(said), random.randint(0, len(said)))
        known = {*texts}
        try:
            checked = check_answer({name: said[name] for name in kept}, known, texts[:-1])
        except ValueError:
            continue  # a line of no number
        answer = {**checked, "text": "", "open": None}
        try:
            refuse_faults(path, answer, ReadSettings())
            told = "\n".join(each.message for each in findings_of(path, answer, ReadSettings()))
        except ExpansionError as error:
            told = str(error)
        assert "\u202e" not in told, case


def files_of(path: Path, *package_dirs: Path) -> XacroFiles:
    return XacroFiles(path, find_packages(path, package_dirs))


def test_a_package_is_a_folder_with_a_manifest(tmp_path: Path) -> None:
    path = home(tmp_path)
    real = package(tmp_path / "parts")
    files = files_of(path)
    assert files.find("parts") == (str(real),)
    for name in ("diary", ".ssh", ".config", "tool", "keys", ".git", "..", "", "robots/.git"):
        assert files.find(name) == (), name
    assert files.find("robots") == (str(path.parent),)  # its own folder, which paths reach, too
    declared = files_of(path, tmp_path / "diary", tmp_path / ".config" / "tool")
    assert declared.find("diary") == (str(tmp_path / "diary"),)
    assert declared.find("tool") == (str(tmp_path / ".config" / "tool"),)
    assert declared.find(".ssh") == ()
    package(tmp_path / ".ssh")
    (tmp_path / "robots" / "bare").symlink_to(tmp_path / ".ssh")
    assert files_of(path).find(".ssh") == files_of(path).find("bare") == ()


def test_files_are_read_where_the_file_may_name_them(tmp_path: Path) -> None:
    path = home(tmp_path)
    part = write(package(tmp_path / "parts") / "part.xacro", "part")
    files = files_of(path)
    with pytest.raises(PermissionError, match="outside the folders"):
        files.read(str(part))
    files.find("parts")
    assert files.read(str(part)) == b"part"
    with pytest.raises(PermissionError, match="hidden folder"):
        files.read(str(path.parent / ".env"))
    os.mkfifo(path.parent / "pipe")
    with pytest.raises(OSError, match="a pipe, not a regular file"):
        files.read(str(path.parent / "pipe"))
    with pytest.raises(FileNotFoundError):
        files.read(str(path.parent / "none"))
    assert files.missing == {str(path.parent / "none")}
    assert files.match(f"{path.parent}/*.yaml") == [str(path.parent / "sizes.yaml")]
    hidden = write(tmp_path / ".cache" / "robots" / "r.xacro", "r")
    assert files_of(hidden).read(str(hidden)) == b"r"  # what is given may lie anywhere
    assert files_of(path.parent / ".env").read(str(path.parent / ".env")) == SECRET.encode()


def test_the_systems_own_files_are_nobodys(tmp_path: Path) -> None:
    """Also where the robot lies in the root of a container: its folder is the whole disk."""
    for own in (Path("/r.xacro"), tmp_path / "r.xacro"):
        for file in ("/proc/self/environ", "/proc/1/cmdline", "/sys/kernel/notes", "/dev/null"):
            with pytest.raises(PermissionError):
                files_of(own).read(file)


def test_requests_in_any_form_are_answered_or_refused(tmp_path: Path) -> None:
    path, random = home(tmp_path), Random(14)
    files = files_of(path)
    pieces = ["..", "/", "*", "[", "]", "?", ".", "~", "\n", "\ud800", "keys", "robots", "id_rsa",
              ".ssh", str(tmp_path), "a" * 5000, "\0", "{}"]  # fmt: skip
    verbs: list[object] = ["read", "find", "place", "match", "kill", None, 7]
    for case in range(500):
        verb = random.choice(verbs)
        text = random.choice(["", "/"]).join(random.choices(pieces, k=random.randint(0, 6)))
        try:
            assert SECRET.encode() not in files.reply(verb, text), case
        except (ValueError, KeyError):
            assert verb not in verbs[:4] or "\0" in text or "\ud800" in text, case


def test_requests_are_bounded_in_length_and_number(tmp_path: Path) -> None:
    files = files_of(home(tmp_path))
    long = "/" + "a" * 5000
    assert b"name too long" in files.reply("read", long)
    replies = [files.reply(verb, text) for verb in ("find", "place", "match") for text in
               (long, long[1:], long + "*")]  # fmt: skip
    assert {*replies} == {b"[]", b"null"}
    assert len(files.known) == 1
    with pytest.raises(ValueError, match="too many"):
        for case in range(20_000):
            files.reply("read", f"/{case}")
    assert len(files.known) <= MAX_REQUESTS + 1


def test_patterns_name_files_that_may_be_read(tmp_path: Path) -> None:
    path = home(tmp_path)
    for name in ("a/1.xacro", "a/2.xacro", "b/1.xacro", "b/.c/1.xacro", ".d/1.xacro", "b/x"):
        write(path.parent / name, "")
    files, here = files_of(path), path.parent
    assert files.match(f"{here}/*/1.xacro") == [f"{here}/a/1.xacro", f"{here}/b/1.xacro"]
    assert files.match(f"{here}/a/[12].xac??") == [f"{here}/a/1.xacro", f"{here}/a/2.xacro"]
    assert files.match(f"{here}/a/../b/*.xacro") == [f"{here}/a/../b/1.xacro"]
    for none in ("*/none", ".*", "*/.*/1.xacro", ".d/*", "../*", "../.ssh/*", "keys/*", "r*/.."):
        assert files.match(f"{here}/{none}") == [], none
    assert files.match("*") == files.match("/*") == files.match("/etc/pass*") == []


def test_patterns_look_into_few_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = home(tmp_path).parent
    for folder in "abc":
        write(here / folder / "1.xacro", "")
    monkeypatch.setenv("RPCTL_MAX_FOLDERS", "2")  # this one, and one in it
    assert files_of(here / "r.xacro").match(f"{here}/*/*.xacro") == [f"{here}/a/1.xacro"]


def test_variables_are_those_that_are_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = xacro(tmp_path / "r.urdf.xacro", link("base", "$(optenv BOT_MASS 3)"))
    note = 'environment variable "BOT_MASS" is hidden from the file; add env:BOT_MASS:=VALUE if'
    monkeypatch.setenv("BOT_MASS", "5")
    found = expand(path)
    assert '<mass value="3"/>' in found.text
    assert [finding.message[: len(note)] for finding in found.findings] == [note]
    given = expand(path, ReadSettings(xacro_args={"env:BOT_MASS": "7"}))
    assert '<mass value="7"/>' in given.text
    assert given.findings == ()
    with pytest.raises(ExpansionError, match=r'"env:BOT_MAS"; did you mean env:BOT_MASS\?'):
        expand(path, ReadSettings(xacro_args={"env:BOT_MAS": "7"}))


def test_a_variable_that_nobody_gives_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BOT_MASS", SECRET)
    path = xacro(tmp_path / "r.urdf.xacro", "<!-- -->", link("base", "$(env BOT_MASS)"))
    with pytest.raises(ExpansionError) as caught:
        rpctl.load(path)
    assert str(caught.value) == (
        f'{path}:3: error: xacro: environment variable "BOT_MASS" has no value, as the file '
        "cannot read your environment; add env:BOT_MASS:=VALUE"
    )


def test_what_a_system_lacks_is_told_before_expanding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = xacro(tmp_path / "r.urdf.xacro", link("base"))
    said: list[int] = []
    send = Worker.send

    def watch(worker: Worker, message: bytes) -> None:
        if b'"file"' in message:
            said.append(len(caplog.messages))
        send(worker, message)

    monkeypatch.setattr(Worker, "send", watch)
    with caplog.at_level(logging.WARNING):
        assert expand(path).findings == ()
        assert (said, caplog.messages) == ([0], [])
        monkeypatch.setattr(expansion, "open_ways", lambda _: open_ways(("rlimits",)))
        (finding,) = expand(path).findings
    assert said == [0, 1]
    assert finding.severity == "warning"
    assert finding.message == (
        "this system cannot prevent the file's expressions from reading and writing your files "
        "or starting processes or using the network; expand only files that you trust"
    )
    assert caplog.messages == [f"{path}: warning: {finding.message}"]
