"""A URDF's text as an XML tree: no entities, no foreign namespaces, every tag at its line."""

from __future__ import annotations

import re
from typing import Any

from lxml import etree

from rpctl.description.encoding import Refusal, decode
from rpctl.description.findings import Findings, excerpt
from rpctl.description.other_formats import foreign_bytes, foreign_root, foreign_text
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


def parse_document(data: bytes, findings: Findings) -> Any:
    """Return the <robot> element of a file's bytes.

    Comments, processing instructions, and elements and attributes of foreign namespaces are left
    out; what was mended on the way is noted.

    Args:
        data: The file.
        findings: Where to note warnings.

    Raises:
        Refusal: There is no URDF in the bytes.
    """
    if not data.strip():
        raise Refusal("the file is empty; give a URDF")
    alien = foreign_bytes(data)
    if alien:
        raise Refusal(alien)
    text = decode(data, findings)
    start = _root_start(text)
    _require_few(text, text.count("\n", 0, start) + 1)
    root = _parsed(text, start, findings)
    if MULTI_LINE_TAG.search(text):
        _place_tags(text, root)
    if "xmlns" in text or findings.items:
        _drop_namespaces(root, findings)
    if text.count("\n") > MAX_LINE:
        findings.add("info", None, f"lines of this file beyond {MAX_LINE} are not told exactly")
    return root


def _root_start(text: str) -> int:
    """Return where the root element's name ends.

    Raises:
        Refusal: The text is of another format, or has a document type.
    """
    place = _after_prolog(text)
    line = text.count("\n", 0, place) + 1
    alien = foreign_text(text[place : place + 200])
    if alien:
        raise Refusal(alien, line)
    if text.startswith("<!DOCTYPE", place):
        entities = " and its entities are never read" if "<!ENTITY" in text else ""
        raise Refusal(f"a DOCTYPE is not part of URDF{entities}; remove it", line)
    root = ROOT_NAME.match(text, place)
    if root is None:
        begins = excerpt(text[place : place + 200].partition("\n")[0])
        raise Refusal(f'not XML: it begins with "{begins}"; a URDF is an XML file', line)
    alien = foreign_root(root[1])
    if alien:
        raise Refusal(alien, line)
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
            fault = (
                f"{elements} elements, where {most} are the limit; {how_to_raise('MAX_ELEMENTS')}"
            )
            raise Refusal(fault, line)
    most = cap("MAX_ATTRIBUTES")
    if (many := text.count("=")) > most:
        fault = f"{many} attributes, where {most} are the limit; {how_to_raise('MAX_ATTRIBUTES')}"
        raise Refusal(fault, line)


def require_few_links(count: int, line: int) -> None:
    """Refuse more links than time allows.

    Raises:
        Refusal: There are too many.
    """
    most = cap("MAX_LINKS")
    if count > most:
        raise Refusal(
            f"{count} links, where {most} are the limit; {how_to_raise('MAX_LINKS')}", line
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
            findings.warn_at(
                error.lineno,
                f'the prefix "{prefix}" is not declared; what bears it is left out, '
                f'add xmlns:{prefix}="..." to <robot>',
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
        fault = "a tag or text is over 10 MB; a URDF names its meshes, it does not hold them"
    elif _ends_early(text):
        fault = f"{TRUNCATED} ({reason}); {FIX_TRUNCATED}"
    else:
        fault = f"not well-formed XML: {reason}; correct the tag or attribute before this place"
    return Refusal(fault, error.lineno)


def _ends_early(text: str) -> bool:
    """Whether a text that is not well-formed is so only for what is missing at its end."""
    if text.rstrip().endswith("robot>"):
        return False
    parser = _parser()
    try:
        parser.feed(text.encode("utf-8"))
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
            f"xacro is left unexpanded ({len(macros)} elements, the first is {first}); "
            "name the file .xacro and it is expanded, or run `xacro FILE > robot.urdf`",
            macros[0].sourceline,
        )
    own = etree.QName(root).namespace
    if own is not None:
        findings.warn(root, f'<robot> is in the namespace "{excerpt(own)}"; it is left out, '
                      "remove the xmlns")  # fmt: skip
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
