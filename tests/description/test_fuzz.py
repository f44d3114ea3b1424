"""Damaged files: a robot whose dynamics are finite, or one message that names the file."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rpctl
from rpctl.errors import RpctlError
from rpctl.robot import catalog
from tests.description.corpus import BASE
from tests.description.mutations import ATTRIBUTES, TAGS, VALUES, damage
from tests.grids import cells

PATIENCE = 60  # s; a hang, however slow the machine
QUICK = {"paper": 40, "mixed_chain": 12, "tiago": 3}
LONG = [("paper", 5000), ("mixed_chain", 3500), ("tiago", 1500)]
IN_CI = [("paper", 50), ("mixed_chain", 350), ("tiago", 150)]
SEED = 4


class Hang(Exception):
    pass


@contextmanager
def patience(seconds: int) -> Iterator[None]:
    def give_up(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcome(path: Path) -> str:
    """Return ``"robot"`` or the class of the error; raise where there is anything else."""
    try:
        with patience(PATIENCE):
            robot = rpctl.load(path)
    except RpctlError as error:
        text_of_error = str(error)
        assert error.exit_code == 2
        assert str(path) in text_of_error
        assert text_of_error.isprintable() or "\n" in text_of_error
        assert len(text_of_error) < 100_000
        assert "Traceback" not in text_of_error
        return type(error).__name__
    model, rng = robot.model, np.random.default_rng(0)
    data, q = model.createData(), robot.random_configuration(rng)
    assert np.isfinite(pin.crba(model, data, q)).all()
    v, tau = rng.normal(size=model.nv), rng.normal(size=model.nv)
    assert np.isfinite(pin.aba(model, data, q, v, tau)).all()
    assert np.isfinite(robot.mass)
    return "robot"


def fuzz(name: str, count: int, folder: Path, seed: int) -> Counter[str]:
    original = catalog.find(name).path.read_bytes()
    path, outcomes = folder / f"{name}.urdf", Counter[str]()
    for case in range(count):
        done, data = damage(original, Random(f"{seed} {name} {case}"))
        path.write_bytes(data)
        try:
            outcomes[outcome(path)] += 1
        except Exception as error:
            raise AssertionError(f"{name}, seed {seed}, case {case}: {done}") from error
    return outcomes


@pytest.mark.parametrize("name", QUICK)
def test_damage_is_survived(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    outcomes = fuzz(name, QUICK[name], tmp_path, SEED)
    assert outcomes["robot"] > 0
    assert outcomes["DescriptionError"] > 0
    assert capfd.readouterr() == ("", "")  # nothing leaks from C either


SHELL = """
import json, sys
from typer.testing import CliRunner
from rpctl.cli.app import app
for line in sys.stdin:
    done = CliRunner().invoke(app, json.loads(line))
    fault = None if isinstance(done.exception, SystemExit | None) else repr(done.exception)
    print(json.dumps([done.exit_code, done.stdout[:99], done.stderr[:99], fault]))
"""
MEMORY = 2**30  # bytes of data; that of Pinocchio and its libraries is a third


@pytest.mark.slow
def test_damage_is_told_on_the_command_line_in_bounded_memory(tmp_path: Path) -> None:
    original, requests, names = catalog.find("paper").path.read_bytes(), [], []
    for case in range(30):
        done, data = damage(original, Random(f"{SEED} inspect {case}"))
        path = tmp_path / f"{case}.urdf"
        path.write_bytes(data)
        requests.append(json.dumps(["inspect", str(path), *["--json", "--strict"][case % 3 : 2]]))
        names.append(done)
    shell = subprocess.run(
        [sys.executable, "-c", SHELL], input="\n".join(requests),
        capture_output=True, text=True, check=True, timeout=10 * PATIENCE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY)),
    )  # fmt: skip
    assert shell.stderr == ""
    codes = Counter[int]()
    for done, line in zip(names, shell.stdout.splitlines(), strict=True):
        code, out, err, fault = json.loads(line)
        assert fault is None, done
        assert bool(err) == (code == 2), done
        assert bool(out) == (code == 0), done
        codes[code] += 1
    assert set(codes) == {0, 2}


TEXTS = st.one_of(st.sampled_from(VALUES), st.text(max_size=8), st.floats().map(str))
NAMES = st.sampled_from((*ATTRIBUTES, "a"))


def _markup(tag: str, attributes: dict[str, str], content: list[str]) -> str:
    text_of_error = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
    return f"<{tag}{text_of_error}>{''.join(content)}</{tag}>"


ELEMENTS = st.recursive(
    st.builds(_markup, st.sampled_from(TAGS), st.dictionaries(NAMES, TEXTS), st.just([])),
    lambda inner: st.builds(
        _markup,
        st.sampled_from(TAGS),
        st.dictionaries(NAMES, TEXTS, max_size=4),
        st.lists(inner, max_size=5),
    ),
    max_leaves=30,
)
FILES = st.one_of(
    st.binary(max_size=300),
    st.text(max_size=300).map(lambda text: text.encode("utf-8", "surrogatepass")),
    ELEMENTS.map(lambda inner: f'<robot name="r">{inner}</robot>'.encode()),
    st.tuples(ELEMENTS, st.integers(0, BASE.count("<") - 1)).map(
        lambda drawn: _inserted(*drawn).encode("utf-8", "surrogatepass")
    ),
)


def _inserted(element: str, place: int) -> str:
    """Return the base file with an element before one of its tags."""
    pieces = BASE.split("<")
    return "<".join(pieces[: place + 1]) + element + "<" + "<".join(pieces[place + 1 :])


@settings(max_examples=8, derandomize=True, deadline=None)
@given(FILES)
def test_whatever_is_drawn_is_a_robot_or_a_message(data: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drawn.urdf"
        path.write_bytes(data)
        outcome(path)


@pytest.mark.parametrize(("name", "count"), cells(IN_CI + LONG, slow=IN_CI[:1]))
def test_much_damage_is_survived(
    name: str, count: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    outcomes = fuzz(name, count, tmp_path, SEED + 1)
    assert sum(outcomes.values()) == count
    assert capfd.readouterr() == ("", "")
