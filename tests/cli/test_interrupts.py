"""Signals at any moment: one line and an exit code, files whole, no traceback."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import pytest

from tests.grids import cells

START = """
import os, signal, sys
signals = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
for number in signals:
    signal.signal(number, signal.default_int_handler)  # as in a shell's foreground
signal.pthread_sigmask(signal.SIG_BLOCK, signals)  # those that come before its first line wait
import rpctl.cli.interrupts as interrupts
install = interrupts.leave_at_signals
def leave_at_signals():
    install()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)
interrupts.leave_at_signals = leave_at_signals
ready, sys.argv = int(sys.argv[1]), ["rpctl", *sys.argv[2:]]
os.close(ready)
from rpctl.__main__ import main
main()
"""
SPAN = 1.2  # s in which signals come
COMMANDS = ("--help", "inspect paper", "robots", "compare --help",
            "track paper --duration 2 --no-perturbed --out out")  # fmt: skip


def start(words: Sequence[str], folder: Path, code: str = START) -> subprocess.Popen[str]:
    """Start rpctl, and return when it is about to be imported."""
    seen, ready = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(ready), *words],
        cwd=folder, pass_fds=[ready], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    os.close(ready)
    os.read(seen, 1)  # nothing is written: it ends when the other end is closed
    os.close(seen)
    return process


def check_ended(process: subprocess.Popen[str], number: int, folder: Path) -> bool:
    """Check what a signal left; return whether it came before the end."""
    out, err = process.communicate(timeout=60)
    assert "Traceback" not in out + err and "Exception ignored" not in err
    assert process.returncode in (0, 128 + number)
    if process.returncode:
        assert err.splitlines()[-1] == {2: "interrupted", 15: "terminated", 1: "hung up"}[number]
    assert not [*folder.rglob("*.part")]
    return process.returncode != 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_during_imports_ends_the_process(number: int, tmp_path: Path) -> None:
    process = start(["--help"], tmp_path)
    time.sleep(0.05)
    process.send_signal(number)
    assert check_ended(process, number, tmp_path)
    assert not [*tmp_path.iterdir()]


TIMES = cells(product(COMMANDS, (1, 2)), slow=[(COMMANDS[1], 1), (COMMANDS[4], 2)])


@pytest.mark.parametrize(("command", "times"), TIMES)
def test_ctrl_c_at_any_moment(command: str, times: int, tmp_path: Path) -> None:
    """Twice in a row as well: what the first left to be written is written."""
    words = command.split()
    drawn = random.Random(" ".join(words) + str(times))
    came = 0
    for _ in range(3):
        moment = drawn.uniform(0.0, 0.3 if words == ["--help"] else SPAN)  # it is soon done
        process = start(words, tmp_path)
        for wait in (moment, drawn.uniform(0.0, 0.1))[:times]:
            time.sleep(wait)
            process.send_signal(signal.SIGINT)
        try:
            came += check_ended(process, signal.SIGINT, tmp_path)
        except AssertionError:
            print(f"{words} at {moment:.3f} s")
            raise
    assert came  # else nothing was shown


BODY = """
import os, signal, sys, time
from pathlib import Path
from rpctl.cli.interrupts import exit_code, leave_at_signals, raised_signals
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
sys.path.insert(0, ".")
def ask(number=signal.SIGINT):
    os.kill(os.getpid(), number)
leave_at_signals()
try:
    with raised_signals():
        {body}
except KeyboardInterrupt as error:
    ask()  # ignored: all is done
    print("left with", exit_code(error), error)
"""


def run_body(body: str, folder: Path) -> tuple[int, str, str]:
    return run_code(BODY.format(body=body.replace("\n", "\n        ")), folder)


def run_code(code: str, folder: Path) -> tuple[int, str, str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment,
                          capture_output=True, text=True, timeout=60)  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def test_a_running_command_is_told_of_each_signal(tmp_path: Path) -> None:
    for number, word in ((signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")):
        body = f"try:\n    ask({int(number)})\nfinally:\n    print('kept')\nprint('not here')"
        told = f"kept\nleft with {128 + number} {word}\n"
        assert run_body(body, tmp_path) == (0, told, "")


def test_a_second_signal_does_not_cut_what_the_first_left_to_be_written(tmp_path: Path) -> None:
    body = "try:\n    ask()\nfinally:\n    ask()\n    time.sleep(0.05)\n    print('kept')"
    assert run_body(body, tmp_path) == (0, "kept\nleft with 130 interrupted\n", "")


def test_a_later_signal_ends_what_does_not_end(tmp_path: Path) -> None:
    body = """
import rpctl.cli.interrupts as interrupts
interrupts.PATIENCE = 0.01
try:
    ask()
finally:
    time.sleep(0.05)
    ask()
    print("not here")
"""
    assert run_body(body, tmp_path) == (130, "", "interrupted\n")


def test_a_signal_during_an_import_waits_for_its_end(tmp_path: Path) -> None:
    """Modules in C turn what is raised in their imports into errors of their own."""
    (tmp_path / "outer.py").write_text("try:\n    import inner\nexcept BaseException:\n    pass\n")
    (tmp_path / "inner.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(0.1)\nwhole = 1\n"
    )
    body = """
try:
    import outer
    while True:
        time.sleep(0.01)
finally:
    print(sys.modules["inner"].whole)
"""
    assert run_body(body, tmp_path) == (0, "1\nleft with 130 interrupted\n", "")


def test_a_signal_that_a_destructor_lost_comes_again(tmp_path: Path) -> None:
    body = """
class Held:
    def __del__(self):
        ask()
        time.sleep(0.01)
Held()
while True:
    time.sleep(0.01)
"""
    assert run_body(body, tmp_path) == (0, "left with 130 interrupted\n", "")


def test_signals_that_the_parent_ignores_stay_ignored(tmp_path: Path) -> None:
    """A job in the background of a script is not meant by the terminal's Ctrl-C."""
    code = """
import os, signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGHUP, signal.SIG_IGN)
from rpctl.cli.interrupts import leave_at_signals, raised_signals
leave_at_signals()
with raised_signals():
    os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGHUP)
print("done")
"""
    assert run_code(code, tmp_path) == (0, "done\n", "")


def test_signals_of_another_program_are_its_own() -> None:
    from rpctl.cli.interrupts import raised_signals

    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with raised_signals():
        assert before == [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
    assert before == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
