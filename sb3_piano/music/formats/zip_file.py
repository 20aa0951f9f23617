"""Reading from zip files that a user names, which may unpack to a thousand times their size."""

from __future__ import annotations

import zipfile


def read_member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return a file of an archive, of which no more is unpacked than may be.

    Args:
        archive: The archive.
        name: The file's name in it.
        most: The largest size that the file may have, bytes.

    Raises:
        ValueError: If the file is larger.
        Exception: Whatever zipfile raises at a damaged or missing one.
    """
    with archive.open(name) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f"its {name} holds more than {most} bytes")
    return content
