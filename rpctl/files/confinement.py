"""What a process gives up for good, so that hostile code in it reaches nothing.

Linux holds it with three measures that no code in the process can take back: limits of resources,
a seccomp filter that admits few system calls by name and none besides, and Landlock, which closes
the file system. Python is no wall: code that finds a way to its modules may call all that Python
may. It needs the standard library only, for it runs in processes that import little else.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from struct import pack
from typing import Any

resource: Any
try:
    import resource
except ImportError:  # Windows
    resource = None

MEASURES = ("rlimits", "seccomp", "landlock")  # all there are
SPOKEN = 2**16  # bytes of its standard error, if that is a file; it opens no other for writing

PR_SET_PDEATHSIG, PR_SET_NO_NEW_PRIVS = 1, 38
SIGKILL = 9
SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC = 1, 1
SECCOMP = {"x86_64": 317, "aarch64": 277}  # numbers of the call itself
CREATE_RULESET, RESTRICT_SELF = 444, 446  # of Landlock, on every architecture
LANDLOCK_VERSION = 1  # a flag: ask for the version
ACCESS_FILES = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}  # by ABI
ACCESS_NETWORK = {4: 3}  # bind, connect
SCOPES = {6: 3}  # abstract UNIX sockets, signals

KILL, REFUSE, ALLOW = 0x80000000, 0x00050000 | 1, 0x7FFF0000  # REFUSE answers EPERM
LOAD, IF_EQUAL, IF_LEAST, IF_ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # of classic BPF
NUMBER, ARCHITECTURE, ARGUMENTS = 0, 4, 16  # offsets in what a filter sees, bytes
X32 = 0x40000000  # a bit of the numbers of a second set of calls on x86_64

Instruction = tuple[int, int, int, int]


def confine(memory: int, seconds: int) -> tuple[str, ...]:
    """Give up for good all but computing and the open files; to be called with one thread.

    What is in force: no file is opened, listed or asked for, no process is started or signalled,
    no socket made, no memory made executable. The process ends with the thread that started it.

    Args:
        memory: Bytes of address space.
        seconds: Of processor time, s.

    Returns:
        The measures in force, of :data:`MEASURES`; the other ones this system lacks.
    """
    libc = ctypes.CDLL(None) if sys.platform.startswith("linux") else None
    bound = libc is not None and _renounce_rights(libc)
    closed = bound and _close_files(libc)
    limited = _limit(memory, seconds)
    filtered = bound and _filter_calls(libc)  # last: it refuses the others
    in_force = zip(MEASURES, (limited, filtered, closed), strict=True)
    return tuple(name for name, holds in in_force if holds)


def open_ways(measures: Sequence[str]) -> tuple[str, ...]:
    """Return what hostile code could still do in a process with so many measures, in words."""
    ways = []
    if "seccomp" not in measures:
        closed = "landlock" in measures  # it guards no modes, owners or times
        ways += ["changing your files' modes" if closed else "reading and writing your files"]
        ways += ["starting processes", "using the network"]
    if "rlimits" not in measures:
        ways += ["using all memory"]
    return tuple(ways)


def _renounce_rights(libc: Any) -> bool:
    """End with the parent, and never gain rights by starting a program; a filter needs it."""
    _call(libc.prctl, PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0)
    return _call(libc.prctl, PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0


def _call(function: Any, *words: int | bytes | None) -> int:
    """Call a function of C whose arguments are machine words or pointers."""
    return int(function(*(ctypes.c_long(w) if isinstance(w, int) else w for w in words)))


def _limit(memory: int, seconds: int) -> bool:
    """Bound what this process may use; return whether memory and time are bounded."""
    if resource is None:
        return False
    bounds = {
        "RLIMIT_CORE": 0,
        "RLIMIT_FSIZE": SPOKEN,
        "RLIMIT_NPROC": 0,
        "RLIMIT_NOFILE": 0,
        "RLIMIT_CPU": seconds,
        "RLIMIT_AS": memory,
    }
    done = [_limit_one(name, bound) for name, bound in bounds.items()]
    return all(done)


def _limit_one(name: str, bound: int) -> bool:
    """Set one limit, no higher than the one in force; return whether it is set."""
    kind = getattr(resource, name, None)
    if kind is None:
        return False
    try:
        hard = resource.getrlimit(kind)[1]
        bound = bound if hard < 0 else min(bound, hard)  # -1 means none
        resource.setrlimit(kind, (bound, bound))
    except (OSError, ValueError):
        return False
    return True


def _close_files(libc: Any) -> bool:
    """Close the file system, and what else Landlock guards; return whether it is closed."""
    version = _call(libc.syscall, CREATE_RULESET, None, 0, LANDLOCK_VERSION)
    if version < 1:
        return False
    guarded = [_newest(table, version) for table in (ACCESS_FILES, ACCESS_NETWORK, SCOPES)]
    rules = pack("=QQQ", *guarded)  # and no exceptions
    ruleset = _call(libc.syscall, CREATE_RULESET, rules, len(rules), 0)
    if ruleset < 0:
        return False
    try:
        return _call(libc.syscall, RESTRICT_SELF, ruleset, 0) == 0
    finally:
        os.close(ruleset)


def _newest(table: dict[int, int], version: int) -> int:
    """Return the entry of the newest version that is not above this one; 0 where there is none."""
    return max((bits for since, bits in table.items() if since <= version), default=0)


def _filter_calls(libc: Any) -> bool:
    """Refuse all system calls but those named; return whether they are refused."""
    machine = os.uname().machine
    if machine not in AUDIT_ARCHITECTURES or sys.maxsize < 2**32:
        return False
    text = b"".join(pack("=HBBI", *each) for each in seccomp_program(machine))
    code = ctypes.create_string_buffer(text, len(text))
    program = pack("@HP", len(text) // 8, ctypes.addressof(code))
    flags = SECCOMP_FILTER_FLAG_TSYNC
    return _call(libc.syscall, SECCOMP[machine], SECCOMP_SET_MODE_FILTER, flags, program) == 0


def seccomp_program(machine: str) -> list[Instruction]:
    """Return the filter: foreign architectures end the process, calls not named are refused.

    Args:
        machine: ``"x86_64"`` or ``"aarch64"``.
    """
    column = list(AUDIT_ARCHITECTURES).index(machine)
    program = [
        (LOAD, 0, 0, ARCHITECTURE),
        (IF_EQUAL, 1, 0, AUDIT_ARCHITECTURES[machine]),
        (RETURN, 0, 0, KILL),
        (LOAD, 0, 0, NUMBER),
        (IF_LEAST, 0, 1, X32),
        (RETURN, 0, 0, KILL),
    ]
    for numbers in ALLOWED.values():
        if (number := numbers[column]) is not None:
            program += [(IF_EQUAL, 0, 1, number), (RETURN, 0, 0, ALLOW)]
    for each in WITH_ARGUMENT:
        tests = _tests(each)
        program += [(IF_EQUAL, 0, len(tests), each.numbers[column]), *tests]
    return [*program, (RETURN, 0, 0, REFUSE)]


def _tests(call: CallWithArgument) -> list[Instruction]:
    """Return the part of the filter that allows a call if one of its arguments is harmless.

    The lower half of the argument is looked at, as the kernel does with flags and commands.
    """
    program: list[Instruction] = [(LOAD, 0, 0, ARGUMENTS + 8 * call.index)]
    for value in call.values:
        program += [(IF_EQUAL, 0, 1, value), (RETURN, 0, 0, ALLOW)]
    if not call.values:
        program += [(IF_ANY_BIT, 1, 0, call.no_bits), (RETURN, 0, 0, ALLOW)]
    return [*program, (RETURN, 0, 0, REFUSE)]


AUDIT_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_DUPFD_CLOEXEC = 0, 1, 2, 3, 1030
TCGETS, FIOCLEX = 0x5401, 0x5451
PROT_EXEC = 4

Numbers = tuple[int | None, int | None]  # as AUDIT_ARCHITECTURES; None: there is none

ALLOWED: dict[str, Numbers] = {  # computing, waiting, and what is open already
    "read": (0, 63),
    "write": (1, 64),
    "close": (3, 57),
    "fstat": (5, 80),
    "poll": (7, None),
    "lseek": (8, 62),
    "munmap": (11, 215),
    "brk": (12, 214),
    "rt_sigaction": (13, 134),
    "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139),
    "pread64": (17, 67),
    "readv": (19, 65),
    "writev": (20, 66),
    "select": (23, None),
    "sched_yield": (24, 124),
    "mremap": (25, 216),
    "madvise": (28, 233),
    "dup": (32, 23),
    "nanosleep": (35, 101),
    "getpid": (39, 172),
    "exit": (60, 93),
    "uname": (63, 160),
    "getcwd": (79, 17),
    "gettimeofday": (96, 169),
    "getrusage": (98, 165),
    "sysinfo": (99, 179),
    "times": (100, 153),
    "sigaltstack": (131, 132),
    "gettid": (186, 178),
    "time": (201, None),
    "futex": (202, 98),
    "sched_getaffinity": (204, 123),
    "restart_syscall": (219, 128),
    "clock_gettime": (228, 113),
    "clock_getres": (229, 114),
    "clock_nanosleep": (230, 115),
    "exit_group": (231, 94),
    "pselect6": (270, 72),
    "ppoll": (271, 73),
    "getcpu": (309, 168),
    "getrandom": (318, 278),
    "membarrier": (324, 283),
}


@dataclass(frozen=True)
class CallWithArgument:
    """A call that is allowed if one of its arguments is harmless.

    Attributes:
        numbers: Its numbers.
        index: Of the argument.
        values: What the argument may be; nothing: whatever lacks some bits.
        no_bits: These bits.
    """

    numbers: tuple[int, int]
    index: int
    values: tuple[int, ...] = ()
    no_bits: int = 0


WITH_ARGUMENT = (
    CallWithArgument((9, 222), 2, no_bits=PROT_EXEC),  # mmap
    CallWithArgument((10, 226), 2, no_bits=PROT_EXEC),  # mprotect
    CallWithArgument((16, 29), 1, values=(TCGETS, FIOCLEX)),  # ioctl
    # fcntl: owners and signals of a file would reach other processes.
    CallWithArgument((72, 25), 1, values=(F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_DUPFD_CLOEXEC)),
)
