"""The compressed form of MusicXML: a zip file with the document in it."""

from __future__ import annotations

import io
import zipfile
from typing import Any

from sb3_piano.music.zip_file import read_member

MOST_BYTES = 64 * 2**20
"""A larger document is taken for damage; the longest piano works take a fifth of it."""

_CONTAINER_NAME = "META-INF/container.xml"

_CONTAINER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<container><rootfiles>'
    '<rootfile full-path="score.musicxml" media-type="application/vnd.recordare.musicxml+xml"/>'
    "</rootfiles></container>\n"
)


def document_in(content: bytes) -> bytes:
    """Return the document in the bytes of a file, unpacked if it is compressed.

    Raises:
        ValueError: If it is too large.
        Exception: Whatever zipfile and lxml raise at a damaged container.
    """
    from lxml import etree

    if content[:4] == b"PK\x03\x04":
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            root = etree.fromstring(read_member(archive, _CONTAINER_NAME, MOST_BYTES), xml_parser())
            name = root.find(".//{*}rootfile").get("full-path")
            content = read_member(archive, name, MOST_BYTES)
    if len(content) > MOST_BYTES:
        raise ValueError(f"it holds more than {MOST_BYTES} bytes")
    return content


def packed(document: bytes) -> bytes:
    """Return the document in its compressed form; the same document gives the same bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (
            (_CONTAINER_NAME, _CONTAINER.encode()),
            ("score.musicxml", document),
        ):
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def xml_parser() -> Any:
    """Return a parser of lxml that opens no other files."""
    from lxml import etree

    return etree.XMLParser(
        resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True
    )
