"""Workers: hostile code in one reaches no file, process, socket or secret, by the kernel's word."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from struct import pack, unpack_from

import pytest

import rpctl
from rpctl.files.confinement import (
    ALLOW,
    IF_ANY_BIT,
    IF_EQUAL,
    IF_LEAST,
    KILL,
    LOAD,
    MEASURES,
    REFUSE,
    RETURN,
    X32,
    seccomp_program,
)
from rpctl.files.system_calls import ALLOWED, AUDIT_ARCHITECTURES, WITH_ARGUMENT
from rpctl.files.worker import SHORT, Worker, WorkerError
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


def test_memory_ends_in_an_error(blind: Worker) -> None:
    assert ask(blind, f"len('a' * {2 * MEMORY})") == "MemoryError()"
    assert ask(blind, "1 + 1") == "2"


BARE = f"""  # rpctl itself would load Pinocchio
import sys, types
sys.modules["rpctl"] = types.ModuleType("rpctl")
sys.modules["rpctl"].__path__ = [{str(Path(rpctl.__file__).parent)!r}]
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
    ("channel.send(bytes(70000))", "a message of 70000 bytes, where 65536 are the most"),
    ("channel._outgoing.write(bytes([255]) * 8) + channel._outgoing.flush()", "a message of"),
    ("os._exit(7)", "exit code 7"),
    ("ctypes.string_at(0)", "exit code -11"),
    ("os.close(3) or os.close(4) or sleep(60)", "exit code -9"),
    ("sys.exit('no more')", "no more"),
]


@pytest.mark.parametrize(("code", "expected"), every(5, BAD))
def test_one_that_answers_badly_is_told(code: str, expected: str) -> None:
    with Worker(MODULE, MEMORY, PATIENCE) as worker:
        with pytest.raises(WorkerError, match=expected) as caught:
            ask(worker, code)
        assert not caught.value.late


def test_what_it_prints_is_no_message(blind: Worker) -> None:
    assert ask(blind, "print('x' * 10, flush=True)") == "None"
    assert ask(blind, "print('x' * 10, flush=True, file=sys.stderr)") == "None"
    assert "File too large" in ask(blind, "os.write(2, bytes(2**16)) + os.write(2, bytes(2**16))")


def test_a_module_that_is_not_there_is_told() -> None:
    with pytest.raises(WorkerError, match="No module named"):
        Worker("tests.files.nowhere", MEMORY, PATIENCE)
