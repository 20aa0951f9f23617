"""Read the XML document of a MusicXML file, in any packing, encoding and order."""

from __future__ import annotations

import codecs
import contextlib
import io
import posixpath
import re
import unicodedata
import zipfile
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from sb3_piano.files import read_member
from sb3_piano.music.text_file import is_hidden

MOST_BYTES = 64 * 2**20
"""Limit of a document's size; the longest piano works take a fifth of it."""

_MOST_ELEMENTS = 3_000_000
"""Limit of elements and attributes, to save memory; the longest works have a sixth of it."""

CONTAINER_NAME = "META-INF/container.xml"

_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",  # before UTF-16, whose mark is its beginning
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_ZEROS = {"0001": "utf-32-be", "1000": "utf-32-le", "0101": "utf-16-be", "1010": "utf-16-le"}
"""Encodings by pattern of the first four bytes, of ASCII characters: 1 where a byte is not 0."""

_DECLARATION = re.compile(r"<\?xml\s[^<>]{0,999}>", re.IGNORECASE)
_EIGHT_BITS = re.compile(
    rb"encoding\s*=\s*.((?:iso|latin|windows|cp|mac|koi8|shift|euc|big5|gb)[\w-]*)", re.IGNORECASE
)
_CONTROL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]+")


def read_document(content: bytes) -> Element:
    """Parse the bytes of a MusicXML file; return the root of its partwise document.

    Raises:
        ValueError: If it is too large, or is not MusicXML.
        Exception: Any error of zipfile and ElementTree for a damaged file.
    """
    if content[:2] == b"PK" or zipfile.is_zipfile(io.BytesIO(content)):
        content = _unpack(content)
    root = _parse(content)
    if root.tag == "score-timewise":
        return _partwise(root)
    if root.tag != "score-partwise":
        raise ValueError(f"its root is <{root.tag}>, not <score-partwise>")
    parts = root.findall("part")
    _check_size(len(parts), max(map(len, parts), default=0))
    return root


def _check_size(n_parts: int, n_measures: int) -> None:
    if n_parts * n_measures > _MOST_ELEMENTS:
        raise ValueError(f"it has {n_parts} parts and {n_measures} measures")


def _unpack(content: bytes) -> bytes:
    """Unpack the document of an archive: the one named by its container, else the only one."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {_normalized(_decoded(info)): info.filename for info in archive.infolist()}
        members |= {name: name for name in archive.namelist()}
        named: list[str] = []
        container = members.get(_normalized(CONTAINER_NAME))
        if container is not None:
            with contextlib.suppress(ElementTree.ParseError):
                named = _named(_parse(read_member(archive, container, MOST_BYTES)))
        for name in named:
            found = members.get(name) or members.get(_normalized(name))
            if found is not None:
                return read_member(archive, found, MOST_BYTES)
        documents = list(filter(_may_be_document, archive.namelist()))
        if len(documents) != 1:
            wanted = f"{named[0]!r}, which its container names," if named else "container"
            raise ValueError(f"it has no {wanted} and {len(documents)} XML files")
        return read_member(archive, documents[0], MOST_BYTES)


def _decoded(info: zipfile.ZipInfo) -> str:
    """Return the name of a file in an archive, which may be UTF-8 without a flag."""
    try:
        return info.filename.encode("cp437").decode("utf-8")
    except UnicodeError:
        return info.filename


def _normalized(name: str) -> str:
    """Normalise separators, escapes, letter case and accents of a name, for comparison."""
    name = unicodedata.normalize("NFC", unquote(name.strip()).replace("\\", "/"))
    return posixpath.normpath(f"/{name}").lstrip("/").casefold()


def _named(container: Element) -> list[str]:
    """List the documents named by a container: MusicXML first, then other candidates."""
    files = [(f.get("media-type", "").lower(), f) for f in container.iter("rootfile")]
    files.sort(key=lambda file: ("musicxml" not in file[0], bool(file[0])))
    return [f.get("full-path", "") for kind, f in files if not kind or "xml" in kind]


def _may_be_document(name: str) -> bool:
    parts = _normalized(name).split("/")
    hidden = parts[0] == "meta-inf" or any(map(is_hidden, parts))
    return parts[-1].endswith((".xml", ".musicxml")) and not hidden


def _parse(content: bytes) -> Element:
    """Parse an XML document; return its root, with all names stripped of namespaces."""
    if len(content) > MOST_BYTES:
        raise ValueError(f"it holds more than {MOST_BYTES} bytes")
    document = _cleaned(_decode(content)).encode()
    if document.count(b"<") + document.count(b"=") > _MOST_ELEMENTS:
        raise ValueError(f"it has more than {_MOST_ELEMENTS} elements and attributes")
    root = ElementTree.fromstring(document)
    if b"xmlns" in document:
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
    return root


def _cleaned(text: str) -> str:
    """Strip a document's declaration, control characters and text around its elements."""
    text = text[max(text.find("<"), 0) : text.rfind(">") + 1] or text
    return _CONTROL.sub("", _DECLARATION.sub("", text))


def _decode(content: bytes) -> str:
    """Decode bytes by their content, as the declared encoding is often wrong."""
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, "replace")
    encoding = _ZEROS.get("".join(str(int(byte > 0)) for byte in content[:4]), "utf-8")
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        declared = _EIGHT_BITS.search(content[:999])
    try:
        return content.decode(declared[1].decode() if declared else "cp1252", "replace")
    except LookupError:
        return content.decode("cp1252", "replace")


def _partwise(timewise: Element) -> Element:
    """Convert a timewise document to a partwise one."""
    measures = timewise.findall("measure")
    names = dict.fromkeys(part.get("id", "") for one in measures for part in one.findall("part"))
    _check_size(len(names), len(measures))
    root = Element("score-partwise")
    root.extend(timewise.findall("part-list"))
    parts = {name: ElementTree.SubElement(root, "part", id=name) for name in names}
    for measure in measures:
        copies = {
            name: ElementTree.SubElement(part, "measure", measure.attrib)
            for name, part in parts.items()
        }
        for part in measure.findall("part"):
            copies[part.get("id", "")].extend(part)
    return root
