"""Standard output and error: what becomes of them never ends a command, nor loses its files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rpctl.errors import printable

CODE = """
import sys
from rpctl.cli.terminal import Streams, print_document, print_json, say
streams = Streams()
{body}
fault = streams.close()
with open("left", "w") as file:
    file.write(f"{{fault}}")
"""


def run_body(folder: Path, body: str, encoding: str = "utf-8", shell: str = "") -> tuple[str, str]:
    """Run code, its output led where the shell's words lead it; return that, and the fault."""
    (folder / "code.py").write_text(CODE.format(body=body))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                   "PYTHONIOENCODING": encoding}  # fmt: skip
    done = subprocess.run(["bash", "-c", f'"{sys.executable}" code.py {shell}'], cwd=folder,
                          env=environment, capture_output=True, timeout=60)  # fmt: skip
    assert done.stderr == b"", done.stderr
    return done.stdout.decode(encoding), (folder / "left").read_text()


LINES = "for k in range(20000): say(f'line {k}')"


def test_a_reader_who_has_enough_ends_nothing(tmp_path: Path) -> None:
    assert run_body(tmp_path, LINES, shell="| head -1") == ("line 0\n", "None")


@pytest.mark.parametrize("body", [LINES, "say('short')"])
def test_output_that_is_lost_is_told(tmp_path: Path, body: str) -> None:
    told = "[Errno 28] No space left on device"
    assert run_body(tmp_path, body, shell="> /dev/full") == ("", told)


def test_a_closed_output_is_no_file_that_is_opened_next(tmp_path: Path) -> None:
    body = "file = open('data', 'w')\nsay('text')\nsys.stdout.flush()\nfile.write('data')"
    run_body(tmp_path, body, shell=">&- 2>&- <&-")
    assert (tmp_path / "data").read_text() == "data"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_signs_that_an_encoding_lacks_are_replaced(tmp_path: Path, encoding: str) -> None:
    value = {"name": "ν é 🤖", "bad": "\udcff\u202e\x1b"}
    xml = '<robot name="ν é 🤖"/>'
    body = f"say({value['name']!a})\nprint_document({xml!a}, xml=True)"
    body += f"\nsay('')\nprint_json({value!a})"
    out, _ = run_body(tmp_path, body, encoding)
    first, second, rest = out.split("\n", 2)
    kept = value["name"] if encoding == "utf-8" else first
    assert first == kept and ("\\u03bd" in first) == (encoding != "utf-8")
    assert second == (xml if encoding == "utf-8" else '<robot name="&#957; &#233; &#129302;"/>')
    assert json.loads(rest) == value and "\\udcff\\u202e\\u001b" in rest


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Grüße, ν̇ — 日本 🤖", "Grüße, ν̇ — 日本 🤖"),
        ("a\x1b[31mb", "a\\x1b[31mb"),
        ("a\x9bb\x7f\r\b", "a\\x9bb\\x7f\\r\\x08"),
        ("\u202egnp.exe\u2066", "\\u202egnp.exe\\u2066"),
        ("a\u200bb\ufeff\u00ad", "a\\u200bb\\ufeff\\xad"),
        ("a\u3164b\ufe0f\U000e0101", "a\\u3164b\\ufe0f\\U000e0101"),
        ("a\udcff\u2028\n", "a\\udcff\\u2028\\n"),
    ],
)  # fmt: skip
def test_what_would_not_be_seen_is_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(text, keep="\n") == shown.replace("\\n", "\n")


@pytest.mark.slow
def test_a_run_is_kept_whatever_becomes_of_its_output(tmp_path: Path) -> None:
    words = "track paper --duration 0.5 --no-perturbed --samples 1 --out"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    line = f'"{sys.executable}" -m rpctl {words} out > /dev/full'
    done = subprocess.run(["bash", "-c", line], cwd=tmp_path, env=environment, text=True,
                          capture_output=True, timeout=120)  # fmt: skip
    told = "standard output could not be written: No space left on device"
    assert (done.stderr.splitlines(), done.returncode) == ([told], 2)
    assert len([*(tmp_path / "out").iterdir()]) >= 4
