"""The certificate in an exported file: its source, its content, and what was compared.

The file holds it as custom texts: short ones for readers, and the whole as compressed JSON in
base64. It reveals accidental changes; it is no signature, because whoever edits a file can also
write a new certificate.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lxml import etree

from rpctl.engines.mujoco.equations import Witness, as_plain, from_plain
from rpctl.engines.mujoco.mjcf_reader import Table
from rpctl.errors import InputError
from rpctl.files.strict_json import read_json

SCHEMA = 1
TEXT = "rpctl_certificate"
UNSAVED = re.compile("[\"'<>&]")  # characters that MuJoCo writes but cannot read back
MAX_CERTIFICATE_BYTES = 64 * 2**20  # of its JSON; TIAGo's has 150 kB


@dataclass(frozen=True)
class MjcfCertificate:
    """The certificate of an exported file.

    Attributes:
        robot: Name of the robot.
        source: What it was loaded from.
        urdf: Digest of its URDF.
        model: Digest of its model's numbers.
        made_with: Versions of the packages that wrote the file.
        settings: Friction and contact settings.
        checks: The rows that passed when the file was written.
        verified: Digest and size of the certificate of :func:`rpctl.verify`.
        table: The content of the file, element by element.
        witness: The reduced model's numbers.
        facts: How to load the robot again; empty if unknown.
    """

    robot: str
    source: str
    urdf: str
    model: str
    made_with: Mapping[str, str]
    settings: Mapping[str, Any]
    checks: tuple[Mapping[str, Any], ...]
    verified: Mapping[str, Any]
    table: Table = field(repr=False)
    witness: Witness = field(repr=False)
    facts: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @property
    def digest(self) -> str:
        """Digest of the whole certificate."""
        return hashlib.sha256(self._json()).hexdigest()

    @property
    def content(self) -> str:
        """Digest of the file's content."""
        return hashlib.sha256(json.dumps(self.table, separators=(",", ":")).encode()).hexdigest()

    def _json(self) -> bytes:
        plain = {**vars(self), "schema": SCHEMA, "witness": as_plain(self.witness)}
        return json.dumps(plain, separators=(",", ":"), sort_keys=False).encode()

    def parts(self, how: str) -> list[Any]:
        """Return the custom texts of the file.

        Args:
            how: A text on how the controller's state follows from the sensors.
        """
        texts = {
            "rpctl_robot": self.robot,
            "rpctl_version": ", ".join(f"{name} {is_}" for name, is_ in self.made_with.items()),
            "rpctl_urdf_sha256": self.urdf,
            "rpctl_model": self.model,
            "rpctl_content_sha256": self.content,
            "rpctl_certificate_sha256": self.digest,
            "rpctl_settings": ", ".join(f"{name} {is_}" for name, is_ in self.settings.items()),
            "rpctl_sensors": how,
            TEXT: base64.b64encode(zlib.compress(self._json(), 9)).decode(),
        }
        return [
            etree.Element("text", {"name": name, "data": UNSAVED.sub("_", text) or "_"})
            for name, text in texts.items()
        ]


def find_certificate(texts: Mapping[str, str], path: object) -> MjcfCertificate:
    """Return the certificate among the custom texts of a file.

    Raises:
        InputError: There is none, or it is damaged.
    """
    packed = texts.get(TEXT)
    if packed is None:
        raise InputError(
            path,
            "it has no certificate of rpctl: `rpctl export` did not write it, or its <custom> "
            "was removed; export the robot again",
        )
    try:
        data = _unpacked(packed)
        certificate = _from_plain(read_json(data.decode("utf-8")))
    except (ValueError, KeyError, TypeError, AttributeError, zlib.error, binascii.Error) as fault:
        raise InputError(path, f"its certificate is damaged ({fault}); export again") from None
    if texts.get("rpctl_certificate_sha256") != hashlib.sha256(data).hexdigest():
        raise InputError(
            path, "its certificate was edited: the digest does not match; export again"
        )
    return certificate


def _unpacked(packed: str) -> bytes:
    """Return the bytes of a packed text.

    Raises:
        ValueError: The text is damaged or too long.
    """
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(base64.b64decode(packed, validate=True), MAX_CERTIFICATE_BYTES)
    if unpacker.unconsumed_tail or not unpacker.eof:
        raise ValueError("it is cut off or too long")
    return data


def _from_plain(plain: Any) -> MjcfCertificate:
    if plain.pop("schema") != SCHEMA:
        raise ValueError("another version of rpctl wrote it")
    _require_table(plain["table"])
    for name in ("robot", "source", "urdf", "model"):
        if not isinstance(plain[name], str):
            raise TypeError(f"{name} is no text")
    plain["witness"] = from_plain(plain["witness"])
    plain["checks"] = tuple(dict(check) for check in plain["checks"])
    for name in ("made_with", "settings", "verified", "facts"):
        plain[name] = dict(plain[name])
    return MjcfCertificate(**plain)


def _require_table(table: Any) -> None:
    """Refuse what is not a table, so that a forged certificate leads to a message.

    Raises:
        TypeError: It is not a table.
    """
    values = (v for kind in table.values() for fields in kind.values() for v in fields.values())
    for value in values:
        numbers = value if isinstance(value, list) else [value]
        if not all(isinstance(each, float | int | str) for each in numbers):
            raise TypeError("its table has an entry that is not a value")
