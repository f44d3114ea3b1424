"""Decoding: the text of a file's bytes, by byte-order mark and declared encoding."""

from __future__ import annotations

import codecs
import re

from rpctl.description.findings import Findings

BOMS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16, whose mark is its beginning
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
BYTEWISE = re.compile(
    r"utf-8|ascii|iso8859-\d+|cp125\d|cp437|cp850|koi8-[ru]|mac-roman|gb2312|gbk|gb18030|big5|"
    r"shift_jis|euc_jp|euc_kr"
)
DECLARED = re.compile(rb"\s*<\?xml\s[^>]{0,200}?encoding\s*=\s*[\"']([^\"'<>]{1,40})[\"']")
DECLARATION = re.compile(r"(\s*)<\?xml\s[^<>]*\?>")


class Refusal(Exception):
    """Why there is no robot in a file, and the line to blame."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def decode(data: bytes, findings: Findings) -> str:
    """Return a file's text, lines ended by newlines, its XML declaration left blank.

    A wrong declaration of the encoding is mended and noted.

    Args:
        data: The file.
        findings: Where to note warnings.

    Raises:
        Refusal: The bytes are no text.
    """
    text = _text(data, findings).replace("\r\n", "\n").replace("\r", "\n")
    declaration = DECLARATION.match(text)
    if declaration is None:
        return text
    if declaration[1]:
        line = declaration[1].count("\n") + 1
        findings.warn_at(line, "blanks before <?xml; remove them, other readers refuse them")
    return "\n" * declaration[0].count("\n") + text[declaration.end() :]


def _text(data: bytes, findings: Findings) -> str:
    for mark, codec in BOMS:
        if data.startswith(mark):
            return _wide(data[len(mark) :], codec) if codec != "utf-8" else _narrow(
                data[len(mark) :], codec, findings
            )  # fmt: skip
    if data[:2] in (b"<\0", b"\0<"):
        return _wide(data, "utf-16-le" if data[0] else "utf-16-be")
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        raise Refusal("a zero byte: this is a binary or damaged file; a URDF is an XML text", line)
    return _narrow(data, _declared(data, findings), findings)


def _wide(data: bytes, codec: str) -> str:
    try:
        return data.decode(codec)
    except UnicodeDecodeError as error:
        fault = f"not {codec[:6].upper()} as its first bytes say (byte {error.start})"
        raise Refusal(f"{fault}: damaged or truncated; save the file as UTF-8") from None


def _narrow(data: bytes, codec: str, findings: Findings) -> str:
    try:
        return data.decode(codec)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        fault = f"byte 0x{data[error.start]:02X} is not {codec.upper()}, the file's encoding"
        findings.warn_at(line, f"{fault}; it is read as Latin-1, save the file as UTF-8")
        return data.decode("latin-1")


def _declared(data: bytes, findings: Findings) -> str:
    declared = DECLARED.match(data)
    if declared is None:
        return "utf-8"
    name = declared[1].decode("ascii", "replace")
    try:
        codec = codecs.lookup(name).name
    except (LookupError, ValueError):
        codec = ""
    if BYTEWISE.fullmatch(codec):
        return codec
    line = data.count(b"\n", 0, declared.start(1)) + 1
    fault = f'the declared encoding "{name}" is not the file\'s'
    findings.warn_at(line, f'{fault}; it is read as UTF-8, declare encoding="UTF-8"')
    return "utf-8"
