"""The system calls that a confined process may make, by the numbers of two architectures.

What is not named here is refused: whatever opens or changes files, starts or signals processes,
makes sockets, traces, mounts, or was added to Linux since.
"""

from __future__ import annotations

from dataclasses import dataclass

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
