"""Damage to files in TOML and CSV: to their values, their structure, their text and their bytes."""

from __future__ import annotations

from random import Random
from typing import Any

import tomli_w

NUMBERS = (
    "0", "-0.0", "-1", "1e308", "1.8e308", "5e-324", "1e-320", "1e400", "-1e400", "9" * 19,
    "9" * 400, "9" * 5000, "0." + "9" * 400, "1_000", "0x10", "0b1", "inf", "-inf", "nan",
    "1e9", "1e4", "+3", "0.1", "0.15", "0.2", "0.3", "0.5", "1", "1.5", "2",
)  # fmt: skip
VALUES = (
    *NUMBERS, "true", "''", '""', '"x"', "[]", "[[]]", "{}", "[1, 2]", "[0.1, 0.2, 0.3]", "['a']",
    "{a = 1}", "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", '"\\u001b[31m"', '"[/x]"',
    '"' + "x" * 3000 + '"', "[" * 20 + "]" * 20, "[" * 3000 + "]" * 3000, "[" * 3000,
    "{a = " * 50 + "1" + "}" * 50, "[" + "1, " * 500 + "]",
)  # fmt: skip
KEYS = ("a", "type", "law", "", "a.b", "x" * 500, "\x1b[31m", "\u202e", "[/x]", "1", "-", "é", "\0")
CELLS = (
    *NUMBERS, "", " ", '"1"', '"', '"1,5"', "1;5", "1,5", "1.5.2", "x", "\0", "1e", "--1", "½", "١",
    "#", "0.1m", "90°", "1" * 300, "${x}", "\u202e1", "0.5",
)  # fmt: skip
TEXTS = (
    "\0", "\n", "\r", "\r\n", "\ufeff", "\u2028", "\x85", '"', "'", '"""', "'''", "[", "]",
    "{", "}", "=", ".", ",", ";", "\t", "#", "\\", "[[a]]\n", "[a]\n", "a.b.c = 1\n",
    "x" * 3000, "a." * 3000,
)  # fmt: skip
CODECS = ("utf-8", "utf-8-sig", "utf-16", "utf-32", "latin-1", "cp1252")


def damaged_table(table: dict[str, Any], random: Random) -> bytes:
    """Return a file in TOML that differs from a table in one to three places."""
    copy: dict[str, Any] = _copied(table)
    raw: list[str] = []
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        place = random.choice(_places(copy))
        _damage_value(*place, random, raw)
    text = tomli_w.dumps(copy)
    for k, value in enumerate(raw):
        text = text.replace(f'"@{k}@"', value)
    return damaged_text(text, random) if random.random() < 0.3 else text.encode()


def _damage_value(inside: Any, key: Any, random: Random, raw: list[str]) -> None:
    kind = random.choice(("value", "value", "value", "delete", "rename", "swap", "nest", "repeat"))
    if kind == "delete":
        del inside[key]
    elif kind == "rename" and isinstance(inside, dict):
        inside[random.choice(KEYS)] = inside.pop(key)
    elif kind == "swap":
        other = random.choice(list(inside) if isinstance(inside, dict) else range(len(inside)))
        inside[key], inside[other] = inside[other], inside[key]
    elif kind == "nest":
        inside[key] = random.choice(([inside[key]], {"a": inside[key]}))
    elif kind == "repeat" and isinstance(inside, list):
        inside.extend([inside[key]] * random.choice((1, 2, 50)))
    else:
        raw.append(random.choice(VALUES))
        inside[key] = f"@{len(raw) - 1}@"


def _places(table: Any) -> list[tuple[Any, Any]]:
    """Return every place of a table: what it is in, and its key there."""
    keys = list(table) if isinstance(table, dict) else list(range(len(table)))
    found = [(table, key) for key in keys]
    for key in keys:
        if isinstance(table[key], dict | list):
            found += _places(table[key])
    return found or [({"a": 1}, "a")]


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copied(each) for key, each in value.items()}
    return [_copied(each) for each in value] if isinstance(value, list) else value


def damaged_rows(rows: list[list[str]], random: Random) -> bytes:
    """Return a file in CSV that differs from rows, the first its header, in one to three places."""
    rows = [list(row) for row in rows]
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        k = random.randrange(len(rows))
        kind = random.choice(("cell", "cell", "cell", "drop", "double", "swap", "short", "long"))
        if kind == "cell" and rows[k]:
            rows[k][random.randrange(len(rows[k]))] = random.choice(CELLS)
        elif kind == "drop" and len(rows) > 1:
            del rows[k]
        elif kind == "double":
            rows.insert(k, list(rows[k]))
        elif kind == "swap":
            other = random.randrange(len(rows))
            rows[k], rows[other] = rows[other], rows[k]
        elif kind == "short":
            rows[k] = rows[k][:-1]
        else:
            rows[k] = rows[k] * random.choice((2, 300))
    text = random.choice(("\n", "\r\n", "\r")).join(",".join(row) for row in rows)
    if random.random() < 0.1:
        text = text.replace(",", random.choice(";\t| "))
    return damaged_text(text, random) if random.random() < 0.3 else text.encode()


def damaged_text(text: str, random: Random) -> bytes:
    """Return the bytes of a text that is cut, repeated, interspersed or of another encoding."""
    begin = random.randrange(len(text) + 1)
    end = min(len(text), begin + random.choice((1, 5, 50)))
    kind = random.choice(("cut", "end", "repeat", "insert", "codec", "byte"))
    if kind == "cut":
        text = text[:begin] + text[end:]
    elif kind == "end":
        text = text[:begin]
    elif kind == "repeat":
        text = text[:begin] + text[begin:end] * random.choice((2, 30)) + text[end:]
    elif kind == "insert":
        text = text[:begin] + random.choice(TEXTS) + text[begin:]
    data = text.encode(random.choice(CODECS) if kind == "codec" else "utf-8", "replace")
    if kind == "byte" and data:
        place = random.randrange(len(data))
        data = data[:place] + bytes([random.randrange(256)]) + data[place + 1 :]
    return data
