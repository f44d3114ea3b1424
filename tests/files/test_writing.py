"""Files are written whole or not at all; links and devices stay what they are."""

from __future__ import annotations

import ast
import os
import re
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import rpctl
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable, write_atomically, writing

OLD, NEW = b"old content", b"new"


@pytest.fixture
def umask() -> Iterator[None]:
    before = os.umask(0o027)
    yield
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def names(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


def python(code: str, *words: str | Path, **settings: object) -> subprocess.Popen[bytes]:
    """Start Python on a text, its output piped."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], stdout=subprocess.PIPE, **settings
    )  # type: ignore[call-overload]


def test_a_link_stays_and_what_it_leads_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    target, link, second = tmp_path / "far" / "a.txt", tmp_path / "b", tmp_path / "c"
    target.write_bytes(OLD)
    link.symlink_to("far/a.txt")
    second.symlink_to(link)
    assert write_atomically(second, NEW) == second
    assert second.is_symlink() and link.is_symlink() and target.read_bytes() == NEW
    assert not target.is_symlink() and names(tmp_path / "far") == ["a.txt"]
    with writing(link) as file:
        file.write(OLD)
    assert link.is_symlink() and target.read_bytes() == OLD


def test_a_link_in_a_folder_of_others_is_replaced_on_request(tmp_path: Path) -> None:
    victim, link = tmp_path / "victim", tmp_path / "report.html"
    victim.write_bytes(OLD)
    for target in (victim, Path("/dev/null")):
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        write_atomically(link, NEW, follow_links=False)
        assert not link.is_symlink() and link.read_bytes() == NEW
    assert victim.read_bytes() == OLD


def test_a_pipe_is_written_through(tmp_path: Path) -> None:
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    write_atomically(pipe, NEW)
    reader.join(10.0)
    assert read == [NEW] and stat.S_ISFIFO(pipe.stat().st_mode)


def test_standard_output_is_written_through_in_order(tmp_path: Path) -> None:
    """Redirected to a file it is that file's next bytes: the file is neither cut nor replaced."""
    code = """
from rpctl.files.writing import write_atomically
print("before")
write_atomically("/dev/stdout", b"data\\n")
write_atomically("/dev/fd/1", b"more\\n")
print("after")
"""
    out = tmp_path / "out"
    for prepared in ("w", "a"):
        with out.open(prepared) as file:
            subprocess.run([sys.executable, "-c", code], stdout=file, check=True)
    assert out.read_text() == "before\ndata\nmore\nafter\n" * 2
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("kind", ["folder", "socket"])
def test_what_is_no_file_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "it"
    if kind == "folder":
        path.mkdir()
    else:
        os.mknod(path, stat.S_IFSOCK | 0o666)
    for write in (lambda: write_atomically(path, NEW), lambda: require_writable(path)):
        with pytest.raises(RpctlError, match=rf"it: cannot be written: it is a .*{kind}.*; give a"):
            write()
    assert names(tmp_path) == ["it"]


@pytest.mark.parametrize("kept", [0o600, 0o664, 0o755])
def test_an_older_file_keeps_its_mode(tmp_path: Path, umask: None, kept: int) -> None:
    path = tmp_path / "older"
    path.write_bytes(OLD)
    path.chmod(kept)
    write_atomically(path, NEW)
    assert mode(path) == kept and path.read_bytes() == NEW


def test_a_private_file_is_private_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "secret"
    path.write_bytes(OLD)
    path.chmod(0o600)
    with writing(path):
        assert {mode(each) for each in tmp_path.iterdir()} == {0o600}


def test_a_write_protected_file_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "older"
    path.write_bytes(OLD)
    path.chmod(0o444)
    monkeypatch.setattr(os, "access", lambda file, kind: bool(Path(file).stat().st_mode & 0o222))
    for write in (lambda: write_atomically(path, NEW), lambda: require_writable(path)):
        with pytest.raises(RpctlError, match="older: cannot be written: it is write-protected"):
            write()
    assert path.read_bytes() == OLD


@pytest.mark.parametrize("fault", [KeyboardInterrupt, RpctlError, OSError])
def test_a_fault_leaves_the_older_file(tmp_path: Path, fault: type[BaseException]) -> None:
    path = tmp_path / "file"
    path.write_bytes(OLD)
    told = RpctlError if fault is OSError else fault
    with pytest.raises(told), writing(path) as file:
        file.write(NEW)
        raise fault
    assert path.read_bytes() == OLD and names(tmp_path) == ["file"]


def test_content_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    sync, replace = os.fsync, Path.replace

    def note_sync(number: int) -> None:
        done.append("file")
        assert os.fstat(number).st_size == len(NEW)
        sync(number)

    def note_replace(self: Path, target: Path) -> Path:
        done.append("rename")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(Path, "replace", note_replace)
    write_atomically(tmp_path / "file", NEW)
    assert done == ["file", "rename"]


def test_what_cannot_be_written_is_told_without_a_trace(tmp_path: Path) -> None:
    missing = tmp_path / "not" / "there" / "yet"
    require_writable(missing, makes_folder=True)
    for write in (lambda: require_writable(missing), lambda: write_atomically(missing, NEW)):
        with pytest.raises(RpctlError, match=f"yet: there is no folder {missing.parent}; make it"):
            write()
    require_writable("/dev/null")
    (tmp_path / "file").write_bytes(OLD)
    require_writable(tmp_path / "file")
    assert names(tmp_path) == ["file"] and (tmp_path / "file").read_bytes() == OLD
    cases = [
        (tmp_path / "file" / "a", "Not a directory"),
        (Path("/proc/a"), ""),
        (Path("a\0b"), "NUL"),
        (tmp_path / ("a" * 300), "File name too long"),
    ]
    for path, reason in cases:
        with pytest.raises(RpctlError, match=f"cannot be written: .*{reason}"):
            require_writable(path)


WRITES = {"savefig", "write_text", "write_bytes", "savez", "savez_compressed", "savetxt", "tofile",
          "to_csv", "NamedTemporaryFile", "mkstemp", "rename", "replace"}  # fmt: skip
OPENED = {"buffer", "file"}  # what is written to memory, or to a file that the one writer opened
ELSEWHERE = {
    "files/writing.py": "it is the one writer",
    "simulation/run/part.py": "it sets an older folder aside, under another name",
    "files/worker.py": "it writes to the pipes of a process",
    "simulation/run/file.py": "adds entries to an archive in the file that the one writer opened",
    "study/runner.py": "a reference that was sent lies in a folder of this process alone",
    "study/store.py": "adds a line a run to the file that the one writer began",
    "engines/urdf_engine.py": "engines want a name: it lies in a folder of this process alone",
    "engines/mujoco/export.py": "read back before it is put in place, in a folder of its own",
    "derive/ros2_control.py": "its files lie in a folder that gets its name once all are there",
    "view/film.py": "encoders want a name: it lies in a folder of this process alone",
}


def writes(call: ast.Call) -> bool:
    """Return whether a call can write a file by its name."""
    name = getattr(call.func, "attr", None) or getattr(call.func, "id", "")
    if name in ("open", "fdopen"):
        values = [*call.args, *(each.value for each in call.keywords)]
        modes = [str(each.value) for each in values if isinstance(each, ast.Constant)]
        return any(set(mode) <= set("rwxabt+") and set(mode) & set("wxa+") for mode in modes)
    if name == "replace" and (len(call.args) != 1 or call.keywords):
        return False  # of a text, or of a record
    first = call.args[0] if call.args else None
    return name in WRITES and not (isinstance(first, ast.Name) and first.id in OPENED)


def test_every_file_is_written_by_the_one_writer() -> None:
    package = Path(rpctl.__file__).parent
    words = re.compile(
        rf"\b({'|'.join(WRITES - {'replace'})}|open|fdopen)\(|\.replace\([^,()]+\)"  # as a rename
    )
    found = []
    for file in sorted(package.rglob("*.py")):
        relative, text = file.relative_to(package).as_posix(), file.read_text(encoding="utf-8")
        if relative in ELSEWHERE or not words.search(text):
            continue
        calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
        found += [f"{relative}:{call.lineno}" for call in calls if writes(call)]
    assert not found


@pytest.mark.parametrize(
    "code",
    ["path.write_text(text)", "open(path, 'w')", "path.open(mode='ab')", "np.savez(path, a=1)",
     "figure.savefig(path)", "temporary.replace(path)", "os.fdopen(n, 'r+b')"],
)  # fmt: skip
def test_a_writer_of_its_own_is_found(code: str) -> None:
    assert any(isinstance(node, ast.Call) and writes(node) for node in ast.walk(ast.parse(code)))
