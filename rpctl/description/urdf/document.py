"""A URDF's text as an XML tree: no entities, no foreign namespaces, every tag at its line."""

from __future__ import annotations

import codecs
import re
from contextlib import suppress
from typing import Any

from lxml import etree

from rpctl.description.urdf.findings import Findings, excerpt
from rpctl.files.caps import cap, how_to_raise

BLANKS = re.compile(r"\s*")
ROOT_NAME = re.compile(r"<([^\s<>/!?\"'=]+)")
PREFIX_MESSAGE = re.compile(r"Namespace prefix (\S+)")
PLACE_SUFFIX = re.compile(r", line \d+, column \d+$")
MULTI_LINE_TAG = re.compile(r"<[^\s<>/!?][^<>\n]*\n[^<>]*>")
TAG = re.compile(  # what is never closed is taken to the end, once: else time is its square
    r"<!--(?:.*?-->|.*)|<!\[CDATA\[(?:.*?\]\]>|.*)|<\?(?:.*?\?>|.*)|(<)(?![/!?])(link\b)?",
    re.DOTALL,
)
MAX_PREFIXES = 20  # undeclared ones that are mended
MAX_LINE = 65535  # libxml2 counts no further
ROTOR_TAGS = ("rotor_inertia", "gear_ratio")  # of an <actuator>, in a namespace: see transmissions
UNDECLARED = etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE
TOO_DEEP = "Excessive depth"
TRUNCATED = "the file is truncated"
FIX_TRUNCATED = "get the whole file"
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
UNPACK = "unpack it and give the .urdf inside"
EXPORT = "export the robot as URDF"
GIVE = "give the .urdf"
MAGIC = (
    (b"\x89PNG", "a PNG picture", GIVE),
    (b"\xff\xd8\xff", "a JPEG picture", GIVE),
    (b"GIF8", "a GIF picture", GIVE),
    (b"%PDF", "a PDF", GIVE),
    (b"PK\x03\x04", "a ZIP archive", UNPACK),
    (b"\x1f\x8b", "a gzip archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"7z\xbc\xaf", "a 7z archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"\x7fELF", "a program", GIVE),
    (b"glTF", "a glTF mesh", GIVE),
    (b"PXR-USDC", "USD", EXPORT),
)
BEGINNINGS = (
    (r"\{|\[", "JSON", GIVE),
    (r"(?i)<!doctype\s+html|<html\b", "HTML, a page", "download the raw file"),
    (r"version https://git-lfs", "a Git LFS pointer", "run `git lfs pull`"),
    (r"\d{3}: [A-Z][a-z]+", "a server's error message", "download the file anew"),
    (r"solid\b", "an STL mesh", GIVE),
    (r"ply\b", "a PLY mesh", GIVE),
    (r"#usda\b", "USD", EXPORT),
    (r"#VRML\b", "VRML", EXPORT),
    (r"%YAML|---\s", "YAML", GIVE),
)
ROOTS = {
    "sdf": ("SDF", EXPORT),
    "gazebo": ("SDF", EXPORT),
    "world": ("SDF", EXPORT),
    "model": ("SDF", EXPORT),
    "mujoco": ("MJCF", EXPORT),
    "mujocoinclude": ("MJCF", EXPORT),
    "COLLADA": ("COLLADA, a mesh", GIVE),
    "html": ("HTML, a page", "download the raw file"),
    "svg": ("an SVG picture", GIVE),
    "launch": ("a ROS launch file", GIVE),
    "package": ("a ROS package's manifest", GIVE),
}


def parse_document(data: bytes, findings: Findings) -> Any:
    """Return the <robot> element of a file's bytes.

    Comments, processing instructions, and elements and attributes of foreign namespaces are left
    out; what was mended on the way is noted.

    Raises:
        Refusal: There is no URDF in the bytes.
    """
    if not data.strip():
        raise Refusal("the file is empty; give a URDF")
    for magic, kind, fix in MAGIC:
        if data.startswith(magic):
            raise Refusal(f"this is {kind}, not URDF; {fix}")
    text = decode(data, findings)
    start = _root_start(text)
    _require_few(text, text.count("\n", 0, start) + 1)
    root = _parsed(text, start, findings)
    if MULTI_LINE_TAG.search(text):
        _place_tags(text, root)
    if "xmlns" in text or findings.items:
        _drop_namespaces(root, findings)
    if text.count("\n") > MAX_LINE:
        findings.add_at("info", None, f"line numbers beyond {MAX_LINE} are not exact")
    return root


def _root_start(text: str) -> int:
    """Return where the root element's name ends.

    Raises:
        Refusal: The text is of another format, or has a document type.
    """
    place = _after_prolog(text)
    line = text.count("\n", 0, place) + 1
    for pattern, kind, fix in BEGINNINGS:
        if re.match(pattern, text[place : place + 200]):
            raise Refusal(f"this is {kind}, not URDF; {fix}", line)
    if text.startswith("<!DOCTYPE", place):
        entities = " and rpctl never reads its entities" if "<!ENTITY" in text else ""
        raise Refusal(f"a DOCTYPE is not part of URDF{entities}; remove it", line)
    root = ROOT_NAME.match(text, place)
    if root is None:
        begins = excerpt(text[place : place + 200].partition("\n")[0])
        raise Refusal(f'not XML: it begins with "{begins}"; a URDF is an XML file', line)
    if root[1] in ROOTS:
        kind, fix = ROOTS[root[1]]
        raise Refusal(f"this is {kind}, not URDF; {fix}", line)
    if root[1].rpartition(":")[2] != "robot":
        raise Refusal(f"the root element is <{root[1][:60]}>; a URDF's is <robot>", line)
    return root.end()


def _after_prolog(text: str) -> int:
    """Return where the root element or the document type begins."""
    place = 0
    while True:
        place = BLANKS.match(text, place).end()  # type: ignore[union-attr]  # it always matches
        for opening, closing in (("<?", "?>"), ("<!--", "-->")):
            if text.startswith(opening, place):
                end = text.find(closing, place + len(opening))
                if end < 0:
                    line = text.count("\n", 0, place) + 1
                    raise Refusal(f"{TRUNCATED}: {opening} is never closed; {FIX_TRUNCATED}", line)
                place = end + len(closing)
                break
        else:
            if place == len(text):
                raise Refusal(f"{TRUNCATED} before its root element, or empty; {FIX_TRUNCATED}")
            return place


def _require_few(text: str, line: int) -> None:
    """Refuse more elements or attributes than memory allows, before the parser takes it.

    Raises:
        Refusal: There are too many; of a file with too many links these are told.
    """
    most = cap("MAX_ELEMENTS")
    if text.count("<") - text.count("</") > most:  # comments are among them: count anew
        links = elements = 0
        for tag in TAG.finditer(text):
            elements += tag[1] is not None
            links += tag[2] is not None
        if elements > most:
            require_few_links(links, line)
            raise Refusal(
                f"{elements} elements; at most {most} are allowed; {how_to_raise('MAX_ELEMENTS')}",
                line,
            )
    most = cap("MAX_ATTRIBUTES")
    if (many := text.count("=")) > most:
        raise Refusal(
            f"{many} attributes; at most {most} are allowed; {how_to_raise('MAX_ATTRIBUTES')}", line
        )


def require_few_links(count: int, line: int) -> None:
    """Refuse more links than time allows.

    Raises:
        Refusal: There are too many.
    """
    most = cap("MAX_LINKS")
    if count > most:
        raise Refusal(
            f"{count} links; at most {most} are allowed; {how_to_raise('MAX_LINKS')}", line
        )


def _parsed(text: str, start: int, findings: Findings) -> Any:
    """Return the root element; a namespace prefix that is not declared is declared and noted."""
    prefixes: list[str] = []
    while True:
        declarations = "".join(f' xmlns:{prefix}="undeclared:{prefix}"' for prefix in prefixes)
        whole = (text[:start] + declarations + text[start:]).encode("utf-8")
        try:
            return etree.fromstring(whole, _parser())
        except etree.XMLSyntaxError as error:
            prefix_match = PREFIX_MESSAGE.match(error.msg or "")
            prefix = prefix_match[1] if prefix_match and error.code == UNDECLARED else None
            if prefix is None or prefix in prefixes or len(prefixes) == MAX_PREFIXES:
                raise _syntax(error, text) from None
            prefixes.append(prefix)
            findings.add_at(
                "warning",
                error.lineno,
                f'the prefix "{prefix}" is not declared; rpctl ignores what has it; add '
                f'xmlns:{prefix}="..." to <robot>',
            )


def _parser() -> Any:
    return etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
    )


def _syntax(error: Any, text: str) -> Refusal:
    """Return the refusal of a text that is not well-formed."""
    reason = PLACE_SUFFIX.sub("", (error.msg or "unknown fault").strip())
    if TOO_DEEP in reason:
        fault = "elements are nested over 256 deep, where a URDF nests 5; close what is left open"
    elif "XML_PARSE_HUGE" in reason:
        fault = "a tag or text is over 10 MB; a URDF refers to meshes, it does not contain them"
    elif _ends_early(text):
        fault = f"{TRUNCATED} ({reason}); {FIX_TRUNCATED}"
    else:
        fault = f"not well-formed XML: {reason}; correct the tag or attribute before this place"
    return Refusal(fault, error.lineno)


def _ends_early(text: str) -> bool:
    """Whether a text that is not well-formed is so only for what is missing at its end."""
    if text.rstrip().endswith("robot>"):
        return False
    try:
        _parser().feed(text.encode("utf-8"))
    except etree.XMLSyntaxError:
        return False
    return True


def _place_tags(text: str, root: Any) -> None:
    """Set each element's line to where its tag begins; the parser gives where it ends."""
    line, last = 1, 0
    elements = root.iter("*")
    for tag in TAG.finditer(text):
        if tag[1] is None:
            continue
        line += text.count("\n", last, tag.start())
        last = tag.start()
        element = next(elements, None)
        if element is not None and line <= MAX_LINE and element.sourceline != line:
            element.sourceline = line


def _drop_namespaces(root: Any, findings: Findings) -> None:
    """Make the URDF's elements plain, and remove those of foreign namespaces.

    Raises:
        Refusal: Some of them are of xacro.
    """
    macros = root.xpath("//*[contains(namespace-uri(), 'xacro') or contains(name(), 'xacro:')]")
    if macros:
        first = f"<{etree.QName(macros[0]).localname}>"
        raise Refusal(
            f"the file contains xacro that is not expanded ({len(macros)} elements, the first is "
            f"{first}); name the file .xacro to let rpctl expand it, or run `xacro FILE > "
            "robot.urdf`",
            macros[0].sourceline,
        )
    own = etree.QName(root).namespace
    if own is not None:
        findings.warn(root, f'<robot> is in the namespace "{excerpt(own)}"; rpctl ignores the '
                            'namespace; remove the xmlns')  # fmt: skip
    for element in root.xpath("//*[namespace-uri() != '']"):
        name = etree.QName(element)
        rotor = name.localname in ROTOR_TAGS and element.getparent().tag == "actuator"
        if name.namespace == own or rotor:
            element.tag = name.localname
        elif element.getparent() is not None:
            element.getparent().remove(element)
    for element in root.xpath("//*[@*[namespace-uri() != '']]"):
        for key in [key for key in element.attrib if key.startswith("{")]:
            del element.attrib[key]
    etree.cleanup_namespaces(root)


class Refusal(Exception):
    """Why there is no robot in a file, and the line to blame."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def decode(data: bytes, findings: Findings) -> str:
    """Return a file's text, lines ended by newlines, its XML declaration left blank.

    A wrong declaration of the encoding is mended and noted.

    Raises:
        Refusal: The bytes are no text.
    """
    text = _text(data, findings).replace("\r\n", "\n").replace("\r", "\n")
    declaration = DECLARATION.match(text)
    if declaration is None:
        return text
    if declaration[1]:
        line = declaration[1].count("\n") + 1
        findings.add_at(
            "warning", line, "blanks before <?xml; remove them, as other parsers reject them"
        )
    return "\n" * declaration[0].count("\n") + text[declaration.end() :]


def _text(data: bytes, findings: Findings) -> str:
    for mark, codec in BOMS:
        if data.startswith(mark):
            data = data[len(mark) :]
            return _narrow(data, codec, findings) if codec == "utf-8" else _wide(data, codec)
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
        raise Refusal(
            f"not {codec[:6].upper()} as its first bytes say (byte {error.start}): "
            "damaged or truncated; save the file as UTF-8"
        ) from None


def _narrow(data: bytes, codec: str, findings: Findings) -> str:
    try:
        return data.decode(codec)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        findings.add_at(
            "warning",
            line,
            f"byte 0x{data[error.start]:02X} is not {codec.upper()}, the file's encoding; rpctl "
            "reads it as Latin-1; save the file as UTF-8",
        )
        return data.decode("latin-1")


def _declared(data: bytes, findings: Findings) -> str:
    declared = DECLARED.match(data)
    if declared is None:
        return "utf-8"
    name = declared[1].decode("ascii", "replace")
    with suppress(LookupError, ValueError):
        if BYTEWISE.fullmatch(codec := codecs.lookup(name).name):
            return codec
    line = data.count(b"\n", 0, declared.start(1)) + 1
    findings.add_at(
        "warning",
        line,
        f'the declared encoding "{name}" is not the file\'s; '
        'it is read as UTF-8, declare encoding="UTF-8"',
    )
    return "utf-8"
