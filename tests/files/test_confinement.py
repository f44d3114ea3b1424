"""Workers: hostile code in one reaches no file, process, socket or secret, by the kernel's word."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from struct import pack, unpack_from
from types import SimpleNamespace

import pytest

import rpctl
from rpctl.files import confinement
from rpctl.files.confinement import (
    ALLOW,
    ALLOWED,
    AUDIT_ARCHITECTURES,
    IF_ANY_BIT,
    IF_EQUAL,
    IF_LEAST,
    KILL,
    LOAD,
    MEASURES,
    REFUSE,
    RETURN,
    WITH_ARGUMENT,
    X32,
    open_ways,
    seccomp_program,
)
from rpctl.files.worker import GRACE_S, SHORT, Worker, WorkerError
from tests.grids import every

MODULE = "tests.files.confined"
MEMORY = 2**30
PATIENCE = 60  # s

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux has the measures")


def ask(worker: Worker, code: str) -> str:
    worker.send(code.encode())
    return worker.receive(SHORT).decode()


@pytest.fixture(scope="module")
def blind() -> Iterator[Worker]:
    """A worker that may read nothing, started by somebody with a secret in the environment."""
    os.environ["SECRET_TOKEN"] = "s3cret"
    try:
        with Worker(MODULE, MEMORY, PATIENCE) as worker:
            yield worker
    finally:
        del os.environ["SECRET_TOKEN"]


@linux
def test_all_measures_are_in_force_here(blind: Worker) -> None:
    assert blind.measures == MEASURES


REFUSED = [  # each of these answers without confinement
    "os.open('/etc/passwd', os.O_RDONLY)",
    "os.open('/proc/self/environ', os.O_RDONLY)",
    "os.listdir('/')",
    "os.stat('/')",
    "os.readlink('/proc/self/exe')",
    "os.mkdir('/tmp/made')",
    "os.open('/tmp/written', os.O_CREAT | os.O_WRONLY)",
    "os.link('/etc/passwd', '/tmp/linked')",
    "os.chmod('/tmp', 0o777)",
    "os.fork()",
    "os.posix_spawn('/bin/true', ['true'], {})",
    "os.execv('/bin/true', ['true'])",
    "os.kill(os.getpid(), 0)",
    "os.pipe()",
    "os.memfd_create('m')",
    "os.sched_setaffinity(0, {0})",
    "socket.socket(socket.AF_INET, socket.SOCK_STREAM)",
    "socket.socketpair()",
    "mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_EXEC)",
    "sys.stdin and open('/etc/passwd')",
]


@linux
@pytest.mark.parametrize("code", REFUSED)
def test_the_kernel_refuses(blind: Worker, code: str) -> None:
    assert ask(blind, code) == "PermissionError(1, 'Operation not permitted')"


@linux
@pytest.mark.parametrize(
    "number", [56, 57, 58, 59, 62, 101, 165, 272, 319, 321, 322, 425, 434, 435, 438]
)
def test_calls_without_a_function_of_python_are_refused(blind: Worker, number: int) -> None:
    """Call clone, fork, vfork, execve, kill, ptrace, mount, unshare, memfd, bpf, io_uring, ..."""
    if os.uname().machine != "x86_64":
        pytest.skip("numbers of x86_64")
    call = f"ctypes.CDLL(None, use_errno=True).syscall({number}, 0, 0, 0, 0, 0, 0)"
    assert ask(blind, f"({call}, ctypes.get_errno())") == "(-1, 1)"  # EPERM


def test_it_knows_nothing_of_who_started_it(blind: Worker) -> None:
    assert ask(blind, "dict(os.environ)") == "{}"
    held = ask(blind, "[k for k in range(3, 64) if not os.get_inheritable(k)]")
    assert "Bad file descriptor" in held  # 3 and 4 are its pipes
    assert "s3cret" not in Path(f"/proc/{blind._process.pid}/environ").read_text("utf-8")


@linux
def test_its_limits_are_those_asked_for(blind: Worker) -> None:
    lines = Path(f"/proc/{blind._process.pid}/limits").read_text("utf-8").splitlines()
    limits = {line[:26].strip(): tuple(line[26:].split()[:2]) for line in lines}
    expected = {"cpu time": PATIENCE + GRACE_S, "address space": MEMORY, "open files": 0,
                "processes": 0, "core file size": 0, "file size": confinement.SPOKEN}  # fmt: skip
    for name, bound in expected.items():
        assert limits[f"Max {name}"] == (str(bound), str(bound)), name


def test_what_measures_leave_open() -> None:
    assert open_ways(MEASURES) == ()
    assert open_ways(("rlimits", "seccomp")) == ()  # no file can be opened at all
    without = ("changing your files' modes", "starting processes", "using the network")
    assert open_ways(("rlimits", "landlock")) == without
    assert open_ways(("rlimits",)) == ("reading and writing your files", *without[1:])
    assert open_ways(("seccomp", "landlock")) == ("using all memory",)


def test_an_unknown_architecture_has_no_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "uname", lambda: SimpleNamespace(machine="riscv64"))
    assert not confinement._filter_calls(None)


def test_memory_ends_in_an_error(blind: Worker) -> None:
    assert ask(blind, f"len('a' * {2 * MEMORY})") == "MemoryError()"
    assert ask(blind, "1 + 1") == "2"


BARE = f"""  # rpctl itself would load Pinocchio
import sys, types
sys.modules["rpctl"] = types.ModuleType("rpctl")
sys.modules["rpctl"].__path__ = [{str(Path(rpctl.__file__).parent)!r}]
sys.path.append({str(Path(__file__).parents[2])!r})
"""
ALONE = (
    BARE
    + """
import ctypes, os
from rpctl.files import confinement
libc = ctypes.CDLL(None)
assert confinement._renounce_rights(libc)
if sys.argv[1] == "landlock":
    assert confinement._close_files(libc)
else:
    assert confinement._limit(2**30, 9)
def tried(what):
    try:
        what()
    except OSError as error:
        return type(error).__name__
    return "done"
print([tried(lambda: os.open("/etc/passwd", 0)), tried(lambda: os.open(sys.argv[2], 0o101)),
       tried(lambda: os.kill(os.getppid(), 0))])
"""
)


@linux
@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        ("landlock", ["PermissionError", "PermissionError", "PermissionError"]),
        ("rlimits", ["OSError", "OSError", "done"]),  # too many files
    ],
)
def test_each_measure_holds_alone(measure: str, expected: list[str], tmp_path: Path) -> None:
    words = [sys.executable, "-c", ALONE, measure, str(tmp_path / "new")]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=PATIENCE)
    assert done.stdout.strip() == str(expected)


def decide(program: list[tuple[int, int, int, int]], architecture: int, number: int,
           arguments: tuple[int, ...] = ()) -> int:  # fmt: skip
    """Return what a filter answers to a call, as the kernel runs it."""
    words = (*arguments, *[0] * (6 - len(arguments)))
    data = pack("=iIQ6Q", number, architecture, 0, *words)
    at, value = 0, 0
    while True:
        code, yes, no, k = program[at]
        at += 1
        if code == RETURN:
            return k
        if code == LOAD:
            (value,) = unpack_from("=I", data, k)
            continue
        holds = {IF_EQUAL: value == k, IF_LEAST: value >= k, IF_ANY_BIT: bool(value & k)}[code]
        at += yes if holds else no


@pytest.mark.parametrize("machine", AUDIT_ARCHITECTURES)
def test_the_filter_admits_what_is_named_and_nothing_else(machine: str) -> None:
    """Both architectures, by running the filter's program here."""
    program, own = seccomp_program(machine), AUDIT_ARCHITECTURES[machine]
    column = list(AUDIT_ARCHITECTURES).index(machine)
    free = {numbers[column] for numbers in ALLOWED.values()} - {None}
    partly = {each.numbers[column] for each in WITH_ARGUMENT}
    for number in {*range(600)} - partly:
        assert decide(program, own, number) == (ALLOW if number in free else REFUSE), number
    for number in (0, 63, X32, X32 | 59, X32 | 520):
        assert decide(program, 0x40000003, number) == KILL  # i386
    assert decide(program, own, X32) == decide(program, own, X32 | 59) == KILL
    mmap, mprotect, ioctl, fcntl = (each.numbers[column] for each in WITH_ARGUMENT)
    for number in (mmap, mprotect):
        assert decide(program, own, number, (0, 4096, 3)) == ALLOW
        assert decide(program, own, number, (0, 4096, 4)) == REFUSE
        assert decide(program, own, number, (0, 4096, 7)) == REFUSE
    assert decide(program, own, ioctl, (0, 0x5401)) == ALLOW
    assert decide(program, own, ioctl, (0, 0x5412)) == REFUSE  # TIOCSTI types into a terminal
    assert decide(program, own, fcntl, (0, 3)) == ALLOW
    assert decide(program, own, fcntl, (0, 8)) == REFUSE  # F_SETOWN signals another process


NAMED = {  # by name, as the kernel's tables have them
    "x86_64": {"read": 0, "write": 1, "close": 3, "futex": 202, "exit_group": 231, "brk": 12,
               "getrandom": 318, "rt_sigreturn": 15, "munmap": 11, "clock_gettime": 228},
    "aarch64": {"read": 63, "write": 64, "close": 57, "futex": 98, "exit_group": 94, "brk": 214,
                "getrandom": 278, "rt_sigreturn": 139, "munmap": 215, "clock_gettime": 113},
}  # fmt: skip
FORBIDDEN = {  # open, openat, execve, clone, fork, socket, connect, kill, ptrace, io_uring, ...
    "x86_64": (
        2,
        257,
        437,
        59,
        322,
        56,
        57,
        58,
        435,
        41,
        42,
        62,
        200,
        234,
        101,
        310,
        425,
        319,
        157,
    ),
    "aarch64": (56, 437, 221, 281, 220, 435, 198, 203, 129, 130, 131, 117, 270, 425, 279, 167),
}


@pytest.mark.parametrize("machine", AUDIT_ARCHITECTURES)
def test_numbers_are_those_of_the_architecture(machine: str) -> None:
    column = list(AUDIT_ARCHITECTURES).index(machine)
    for name, number in NAMED[machine].items():
        assert ALLOWED[name][column] == number
    program = seccomp_program(machine)
    for number in FORBIDDEN[machine]:
        assert decide(program, AUDIT_ARCHITECTURES[machine], number) == REFUSE, number


def test_landlock_guards_all_that_its_version_knows() -> None:
    versions = range(1, 8)
    bits = [0x1FFF, 0x3FFF, 0x7FFF, 0x7FFF, 0xFFFF, 0xFFFF, 0xFFFF]
    assert [confinement._newest(confinement.ACCESS_FILES, v) for v in versions] == bits
    network = [confinement._newest(confinement.ACCESS_NETWORK, v) for v in versions]
    assert network == [0, 0, 0, 3, 3, 3, 3]
    assert [confinement._newest(confinement.SCOPES, v) for v in versions] == [0, 0, 0, 0, 0, 3, 3]


class Resources:
    """Limits as a system may have them."""

    def __init__(self, *missing: str, hard: int = -1, refused: int = -1) -> None:
        names = ("CORE", "FSIZE", "NPROC", "NOFILE", "CPU", "AS")
        self.__dict__.update({f"RLIMIT_{name}": k for k, name in enumerate(names)})
        for name in missing:
            del self.__dict__[name]
        self._hard, self._refused = hard, refused
        self.set: dict[int, tuple[int, int]] = {}

    def getrlimit(self, _: int) -> tuple[int, int]:
        return 0, self._hard

    def setrlimit(self, kind: int, bounds: tuple[int, int]) -> None:
        if kind == self._refused:
            raise ValueError
        self.set[kind] = bounds


@pytest.mark.parametrize(
    ("system", "holds"),
    [
        (Resources(), True), (None, False), (Resources("RLIMIT_AS"), False),
        (Resources(refused=4), False),
    ],
)  # fmt: skip
def test_limits_count_where_all_are_set(
    system: Resources | None, holds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(confinement, "resource", system)
    assert confinement._limit(1000, 9) is holds
    if system is not None:
        expected = {0: 0, 1: confinement.SPOKEN, 2: 0, 3: 0, 4: 9, 5: 1000}
        assert system.set.items() <= {k: (v, v) for k, v in expected.items()}.items()
        assert len(system.set) == (6 if holds else 5)


def test_a_limit_in_force_is_not_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    system = Resources(hard=7)
    monkeypatch.setattr(confinement, "resource", system)
    assert confinement._limit(1000, 3)
    assert (system.set[4], system.set[5]) == ((3, 3), (7, 7))


def _alive(pid: int) -> bool:
    """Whether a process runs; one that is dead and not yet buried does not."""
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text("utf-8")
    except OSError:
        return False


@pytest.mark.parametrize("code", every(2, ["[k for k in iter(int, 1)]", "sleep(60)"]))
def test_one_that_takes_too_long_is_ended(code: str) -> None:
    begin, seconds = time.monotonic(), 0.8
    with pytest.raises(WorkerError) as caught, Worker(MODULE, MEMORY, seconds) as worker:
        ask(worker, code)
    assert caught.value.late
    assert seconds <= time.monotonic() - begin < PATIENCE / 2
    assert not _alive(worker._process.pid)


def test_it_is_ended_where_its_user_is_interrupted() -> None:
    with pytest.raises(KeyboardInterrupt), Worker(MODULE, MEMORY, PATIENCE) as worker:
        worker.send(b"sleep(60)")
        signal.raise_signal(signal.SIGINT)
    assert not _alive(worker._process.pid)


ORPHAN = f"""{BARE}
import os
from rpctl.files.worker import Worker
worker = Worker({MODULE!r}, {MEMORY}, {PATIENCE})
worker.send(b"sleep(60)")
print(worker._process.pid, flush=True)
os.kill(os.getpid(), 9)
"""


@pytest.mark.slow
def test_who_forgets_it_ends_all_the_same() -> None:
    forgetful = ORPHAN.replace("os.kill(os.getpid(), 9)", "")
    begin = time.monotonic()
    subprocess.run([sys.executable, "-c", forgetful], check=True, timeout=2 * PATIENCE)
    assert time.monotonic() - begin < PATIENCE / 2


@linux
def test_it_ends_with_who_started_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ORPHAN],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    pid, until = int(done.stdout), time.monotonic() + PATIENCE
    while _alive(pid) and time.monotonic() < until:
        time.sleep(0.01)
    assert not _alive(pid)


BAD = [
    ("channel.send(bytes(70000))", "a message of 70000 bytes; at most 65536 are allowed"),
    ("channel._outgoing.write(bytes([255]) * 8) + channel._outgoing.flush()", "a message of"),
    ("os._exit(7)", "exit code 7"),
    ("ctypes.string_at(0)", "exit code -11"),
    ("os.close(3) or os.close(4) or sleep(60)", "exit code -9"),
    ("sys.exit('no more')", "no more"),
]


@linux
def test_it_outlives_the_thread_that_started_it() -> None:
    started: list[Worker] = []
    thread = threading.Thread(target=lambda: started.append(Worker(MODULE, MEMORY, PATIENCE)))
    thread.start()
    thread.join()
    (worker,) = started
    with worker:
        time.sleep(0.2)  # a signal would have come
        assert ask(worker, "6 * 7") == "42"


@linux
def test_one_that_nobody_needs_leaves_no_zombie() -> None:
    with Worker(MODULE, MEMORY, PATIENCE) as worker:
        assert worker.measures
        worker.grant(0.01)
        until = time.monotonic() + PATIENCE
        while Path(f"/proc/{worker._process.pid}").exists() and time.monotonic() < until:
            time.sleep(0.01)
        assert time.monotonic() < until


@pytest.mark.parametrize(("code", "expected"), every(5, BAD))
def test_one_that_answers_badly_is_told(code: str, expected: str) -> None:
    with Worker(MODULE, MEMORY, PATIENCE) as worker:
        with pytest.raises(WorkerError, match=expected) as caught:
            ask(worker, code)
        assert not caught.value.late


def test_nobody_is_ended_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its number may be another process's once it has ended."""
    with Worker(MODULE, MEMORY, PATIENCE) as worker:
        pass
    ended: list[int] = []
    monkeypatch.setattr(os, "killpg", lambda number, _: ended.append(number))
    worker.close()
    worker._end_late()
    assert ended == []


def test_what_it_prints_is_no_message(blind: Worker) -> None:
    assert ask(blind, "print('x' * 10, flush=True)") == "None"
    assert ask(blind, "print('x' * 10, flush=True, file=sys.stderr)") == "None"
    assert "File too large" in ask(blind, "os.write(2, bytes(2**16)) + os.write(2, bytes(2**16))")


def test_a_system_without_room_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(subprocess, "Popen", fail)
    with pytest.raises(WorkerError, match=r"no process could be started \(No space left on"):
        Worker(MODULE, MEMORY, PATIENCE)
    monkeypatch.setattr(tempfile, "TemporaryFile", fail)
    with pytest.raises(WorkerError, match=r"no temporary file could be made \(No space"):
        Worker(MODULE, MEMORY, PATIENCE)


def test_a_module_that_is_not_there_is_told() -> None:
    with (
        Worker("tests.files.nowhere", MEMORY, PATIENCE) as worker,
        pytest.raises(WorkerError, match="No module named"),
    ):
        worker.receive(SHORT)
