"""The XML document in the bytes of a MusicXML file, however it is packed, encoded and ordered."""

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
"""A larger document is taken for damage; the longest piano works take a fifth of it."""

_MOST_ELEMENTS = 3_000_000
"""More elements and attributes would fill the memory; the longest works have a sixth of them."""

CONTAINER_NAME = "META-INF/container.xml"

_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",  # begins as UTF-16's does
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_ZEROS = {"0001": "utf-32-be", "1000": "utf-32-le", "0101": "utf-16-be", "1010": "utf-16-le"}
"""Encodings by which of the first four bytes, that are of ASCII characters, are not 0."""

_DECLARATION = re.compile(r"<\?xml\s[^<>]{0,999}>", re.IGNORECASE)
_EIGHT_BITS = re.compile(
    rb"encoding\s*=\s*.((?:iso|latin|windows|cp|mac|koi8|shift|euc|big5|gb)[\w-]*)", re.IGNORECASE
)
_CONTROL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]+")


def read_document(content: bytes) -> Element:
    """Return the root of the partwise MusicXML document in the bytes of a file.

    Raises:
        ValueError: If it is too large, or no MusicXML.
        Exception: Whatever zipfile and ElementTree raise at a damaged file.
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
    """Return the document in an archive: the one that its container names, else the only one."""
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
    """Return the name of a file of an archive, which may be UTF-8 without saying so."""
    try:
        return info.filename.encode("cp437").decode("utf-8")
    except UnicodeError:
        return info.filename


def _normalized(name: str) -> str:
    """Return a name for comparing: separators, escapes, letter case and accents differ."""
    name = unicodedata.normalize("NFC", unquote(name.strip()).replace("\\", "/"))
    return posixpath.normpath(f"/{name}").lstrip("/").casefold()


def _named(container: Element) -> list[str]:
    """Return the names of documents in a container: first of MusicXML, then what may be that."""
    files = [(f.get("media-type", "").lower(), f) for f in container.iter("rootfile")]
    files.sort(key=lambda file: ("musicxml" not in file[0], bool(file[0])))
    return [f.get("full-path", "") for kind, f in files if not kind or "xml" in kind]


def _may_be_document(name: str) -> bool:
    parts = _normalized(name).split("/")
    hidden = parts[0] == "meta-inf" or any(map(is_hidden, parts))
    return parts[-1].endswith((".xml", ".musicxml")) and not hidden


def _parse(content: bytes) -> Element:
    """Return the root of an XML document, all names without a namespace."""
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
    """Return a document without what stands around its elements, and its declaration."""
    text = text[max(text.find("<"), 0) : text.rfind(">") + 1] or text
    return _CONTROL.sub("", _DECLARATION.sub("", text))


def _decode(content: bytes) -> str:
    """Return the text of bytes by what they are: what they declare is often something else."""
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
    """Return a document by parts of one by measures, of which each part has all."""
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
