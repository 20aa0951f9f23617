"""A file is whole or not there, also after a loss of power."""

from __future__ import annotations

import errno
import os

import pytest

from sb3_piano.exceptions import RunError
from sb3_piano.files import disk_refusal, write_atomically, write_text


@pytest.fixture
def to_disk(monkeypatch):
    """What is told to the disk, in order: names of files that are synced or renamed."""
    told = []

    def listened(name, described):
        real = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *args: (told.append(described(*args)), real(*args))[1])

    listened("fsync", lambda descriptor: f"sync {os.path.basename(name_of(descriptor))}")
    listened("replace", lambda old, new: f"name {new.name}")
    return told


def name_of(descriptor):
    return os.readlink(f"/proc/self/fd/{descriptor}")


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="names are read from /proc")
def test_the_content_reaches_the_disk_before_the_name_and_the_name_before_it_returns(
    tmp_path, to_disk
):
    folder = tmp_path / "folder"
    folder.mkdir()
    write_text(folder / "file", "whole")
    assert to_disk == ["sync file.partial", "name file", "sync folder"]


def test_a_file_that_could_not_be_written_leaves_the_former_one(tmp_path):
    write_text(tmp_path / "file", "former")

    def half(file):
        file.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_atomically(tmp_path / "file", half)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "former"


def test_the_refusal_of_a_disk_is_found_behind_the_error_of_a_library():
    refused = OSError(errno.ENOSPC, "No space left on device", "file")
    hidden = RuntimeError("file write failed")
    hidden.__context__ = refused
    assert disk_refusal(hidden) == disk_refusal(refused) == "No space left on device ('file')"
    told = RunError("said already")
    told.__cause__ = refused
    for other in (told, FileNotFoundError(errno.ENOENT, "x"), BrokenPipeError(errno.EPIPE, "x")):
        assert disk_refusal(other) is None
