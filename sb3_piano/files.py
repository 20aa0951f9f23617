"""Atomic writing of files, reading with limits, and the package's own tables."""

from __future__ import annotations

import bz2
import contextlib
import copy
import csv
import errno
import io
import json
import lzma
import os
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BufferedWriter
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from sb3_piano.exceptions import RunError, SB3PianoError
from sb3_piano.links import check_inside
from sb3_piano.unfinished import partial_file

T = TypeVar("T")

_LZMA_MEMORY = 2**28
"""Most memory for the dictionary of an archive that is compressed by LZMA, bytes."""


class FileIn:
    """Descriptor for a file or folder with a fixed name inside ``self.path``."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, owner: Any, kind: object = None) -> Path:
        return owner.path / self._name


_REFUSALS = tuple(
    getattr(errno, name)
    for name in ("EACCES", "EDQUOT", "EFBIG", "EIO", "ENOSPC", "EROFS")
    if hasattr(errno, name)  # not every system has all of them
)


def disk_refusal(error: BaseException | None) -> str | None:
    """Return the system's message if an error comes from a full or unwritable disk, else None.

    Libraries hide the cause: torch raises a ``RuntimeError`` in its place. Errors that this package
    raises on purpose are left alone, as their own message suffices.
    """
    refused = _refused(error)
    return None if refused is None or _is_of_reading(refused) else _said(refused)


def reading_refusal(error: BaseException | None) -> str | None:
    """Return the system's message if an error comes from an unreadable path, else None."""
    refused = _refused(error)
    return _said(refused) if refused is not None and _is_of_reading(refused) else None


def _refused(error: BaseException | None) -> OSError | None:
    while error is not None and not isinstance(error, SB3PianoError):
        if isinstance(error, OSError) and error.errno in _REFUSALS:
            return error
        error = error.__cause__ or error.__context__
    return None


def _said(error: OSError) -> str:
    file = "" if error.filename is None else f" ('{error.filename}')"
    return f"{error.strerror}{file}"


def _is_of_reading(error: OSError) -> bool:
    if error.errno != errno.EACCES or error.filename is None:
        return False
    path = os.path.abspath(os.fsdecode(error.filename))
    effective = os.access in os.supports_effective_ids
    may_enter = os.access(os.path.dirname(path), os.X_OK, effective_ids=effective)
    may_read = os.access(path, os.R_OK, effective_ids=effective)
    return not may_enter or (os.path.lexists(path) and not may_read)


MOST_BYTES = 2**26
"""Default limit of bytes of a file that is read as a whole."""


def check_file(path: str | os.PathLike[str]) -> None:
    """Refuse a path that is not a regular file: a device or a pipe may never end.

    Raises:
        OSError: If it is not a regular file, or does not exist; ``strerror`` says why.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        reason = "it is a device, a pipe or a socket and no file"
        raise OSError(errno.EINVAL, reason, str(path))


def read_file(path: str | os.PathLike[str], most: int = MOST_BYTES) -> bytes:
    """Read a regular file of at most ``most`` bytes.

    Raises:
        OSError: If it is not regular, is larger or cannot be read; ``strerror`` says why.
    """
    check_file(path)
    with open(path, "rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EINVAL, f"it has more than {most} bytes", str(path))
    return content


def write_atomically(path: Path, write: Callable[[BufferedWriter], object]) -> None:
    """Write a file so that its name always refers to a complete file.

    ``write`` gets a temporary file in the same folder. It is flushed to the disk, then renamed, and
    the rename is flushed before this returns. If that fails, the temporary file is deleted. The
    next process that writes there deletes the temporary files of killed processes.

    Through a link, the file it leads to is replaced. A device or a pipe cannot be replaced, and is
    written to directly.

    Raises:
        RunError: As of :func:`check_inside`.
    """
    check_inside(path)
    if _takes_bytes(path):
        with path.open("ab") as stream:
            write(stream)
        return
    path = Path(os.path.realpath(path))
    with partial_file(path) as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())
        if os.name == "nt":
            file.close()  # Windows renames no open files
        os.replace(file.name, path)
    sync_folder(path.parent)


def check_writable(path: Path) -> None:
    """Check that :func:`write_atomically` can write a file, without changing it.

    Raises:
        RunError: As of :func:`check_inside`.
        OSError: If it cannot.
    """
    check_inside(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if _takes_bytes(path):
        if not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return
    path = Path(os.path.realpath(path))
    with contextlib.suppress(FileNotFoundError):
        path.stat()  # refuses a name that is too long
    with partial_file(path):
        pass


def _takes_bytes(path: Path) -> bool:
    """Return whether a path is neither a file nor a folder, such as a device.

    A file that a process has open counts as well: ``/dev/stdout >> log``.
    """
    place = os.path.realpath(path.parent)
    is_open = place == "/dev" or place.startswith("/proc/")
    return path.exists() and not path.is_dir() and (is_open or not path.is_file())


def sync_folder(folder: Path) -> None:
    """Flush the names of a folder's files to the disk, where the system supports it."""
    with contextlib.suppress(OSError):  # Windows opens no folders
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def load_yaml(text: str) -> Any:
    """Parse YAML."""
    # libyaml, where available, takes a tenth of the time, and every import parses YAML.
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def dump_yaml(content: Any, **style: Any) -> str:
    """Serialise to YAML, with keys in their order."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(content, Dumper=dumper, sort_keys=False, **style))


def read_table(path: Path) -> Any:
    """Read a YAML file of the package."""
    return load_yaml(path.read_text("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes with :func:`write_atomically`."""
    write_atomically(path, lambda file: file.write(content))


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text with :func:`write_atomically`; characters it cannot encode are escaped."""
    write_bytes(path, text.encode(errors="backslashreplace"))


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    """Write YAML with :func:`write_atomically`."""
    write_text(path, dump_yaml(content))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write indented JSON with :func:`write_atomically`."""
    write_text(path, json.dumps(content, indent=2) + "\n")


def read_json(path: Path, kind: type[T], expected: str) -> T | None:
    """Read a dataclass from a file of :func:`write_json`; ``None`` if there is no file.

    Raises:
        RunError: If the file is damaged.
    """
    try:
        return TypeAdapter(kind).validate_json(read_file(path))
    except FileNotFoundError:
        return None
    except ValidationError as error:
        raise RunError(f"'{path}' cannot be read ({first_fault(error)}): {expected}") from error
    except OSError as error:
        raise RunError(f"'{path}' cannot be read ({error.strerror}): {expected}") from error


def first_fault(error: ValidationError) -> str:
    """Return the location and message of the first validation error."""
    first = error.errors(include_url=False)[0]
    return "".join(f"{part}: " for part in first["loc"]) + first["msg"]


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a CSV file with a header line by :func:`write_atomically`.

    Missing and ``None`` values of a row are left empty.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def read_member(archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
    """Read a file of a zip archive; unpack at most ``limit`` bytes.

    Raises:
        ValueError: If the file is larger, by the archive's directory or in fact.
        KeyError: If the archive has no file of that name.
        zipfile.BadZipFile: If it is damaged.
        Exception: Any error of the decompressors for a damaged archive.
    """
    member = archive.getinfo(name)
    # zipfile limits the read of stored bytes, but not of bzip2 and lzma: read them as stored.
    packed = copy.copy(member)
    packed.compress_type, packed.file_size = zipfile.ZIP_STORED, member.compress_size
    del packed.CRC
    if member.file_size <= limit:
        try:
            with archive.open(packed) as file:
                # Compressing random data makes it slightly longer.
                part = file.read(limit + limit // 8 + 999)
        except EOFError as error:  # its message is empty
            raise zipfile.BadZipFile(f"it ends within its {name}") from error
        content = _unpack(part, member.compress_type, limit + 1)
    if member.file_size > limit or len(content) > limit:
        raise ValueError(f"its {name} holds more than {limit} bytes")
    if len(content) != member.file_size or zlib.crc32(content) != member.CRC:
        raise zipfile.BadZipFile(f"its {name} is damaged: length or checksum differ")
    return content


def _unpack(packed: bytes, method: int, most: int) -> bytes:
    """Decompress at most ``most`` bytes of a member's packed bytes."""
    if method == zipfile.ZIP_STORED:
        return packed
    if method == zipfile.ZIP_DEFLATED:
        return zlib.decompressobj(-zlib.MAX_WBITS).decompress(packed, most)
    if method == zipfile.ZIP_BZIP2:
        return bz2.BZ2Decompressor().decompress(packed, most)
    if method == zipfile.ZIP_LZMA:
        # Replace the member's header by that of an .lzma file of unknown length.
        packed = packed[4:9] + b"\xff" * 8 + packed[9:]
        unpacker = lzma.LZMADecompressor(lzma.FORMAT_ALONE, memlimit=_LZMA_MEMORY)
        return unpacker.decompress(packed, most)
    raise ValueError(f"it is compressed by method {method}: expected Deflate")
