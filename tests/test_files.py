"""A file is whole or not there, also after a loss of power."""

import errno
import io
import json
import os
import re
import struct
import threading
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from sb3_piano.array_files import in_order, read_arrays, read_shapes
from sb3_piano.exceptions import RunError
from sb3_piano.files import (
    check_writable,
    disk_refusal,
    read_file,
    read_member,
    write_atomically,
    write_text,
)
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.unfinished import own


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
    first, *others = to_disk
    assert re.fullmatch(r"sync file\.[0-9a-f]+\.partial", first)
    assert others == ["name file", "sync folder"]


def test_a_file_that_could_not_be_written_leaves_the_former_one(tmp_path):
    write_text(tmp_path / "file", "former")

    def half(file):
        file.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_atomically(tmp_path / "file", half)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "former"


def test_of_two_that_write_a_file_at_once_each_writes_a_whole_one(tmp_path):
    file = tmp_path / "file"

    def slow(opened):
        opened.write(b"slow ")
        write_text(file, "fast")
        assert file.read_text() == "fast"
        opened.write(b"and whole")

    write_atomically(file, slow)
    assert file.read_text() == "slow and whole"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_what_killed_processes_left_goes_with_the_next_write_and_what_has_an_owner_stays(tmp_path):
    dead, owned = (tmp_path / f"file.{digit * 16}.partial" for digit in "ab")
    others = [tmp_path / name for name in ("film.mp4.partial", "linked.cccccccccccccccc.partial")]
    for file in (dead, owned, others[0]):
        file.write_bytes(b"half")
    others[1].symlink_to(others[0])
    with owned.open("ab") as file:
        own(file.fileno())
        write_text(tmp_path / "new", "whole")
    assert {path.name for path in tmp_path.iterdir()} == {
        "new",
        owned.name,
        *(path.name for path in others),
    }


@pytest.mark.parametrize("name", ["x" * 255, "\U0001d11e" * 63 + "abc"], ids=["ascii", "not ascii"])
def test_the_longest_names_that_a_disk_takes_can_be_written(tmp_path, name):
    check_writable(tmp_path / name)
    write_text(tmp_path / name, "whole")
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_link_goes_on_leading_to_the_file_that_is_written(tmp_path):
    (tmp_path / "folder").mkdir()
    file, link = tmp_path / "folder" / "file", tmp_path / "link"
    file.write_text("former")
    link.symlink_to(file)
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert [path.name for path in file.parent.iterdir()] == ["file"]


def test_a_pipe_and_what_a_process_has_open_are_written_to_and_not_replaced(tmp_path):
    log, pipe, read = tmp_path / "log", tmp_path / "pipe", []
    log.write_text("before\n")
    with log.open("a") as file:
        write_text(Path(f"/dev/fd/{file.fileno()}"), "after\n")
    assert log.read_text() == "before\nafter\n"
    assert [path.name for path in tmp_path.iterdir()] == ["log"]
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()), daemon=True)
    reader.start()
    check_writable(pipe)
    write_text(pipe, "what is told")
    reader.join(30)
    assert (read, pipe.is_fifo()) == (["what is told"], True)


def test_a_file_that_cannot_be_written_is_found_without_writing_it(tmp_path):
    (tmp_path / "file").write_text("former")
    for good in ("file", "new"):
        check_writable(tmp_path / good)
    for bad in ("", "none/file", "file/new", "x" * 256):
        with pytest.raises(OSError, match="directory|too long"):
            check_writable(tmp_path / bad)
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


@pytest.mark.parametrize(
    "method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
)
def test_a_member_of_an_archive_is_unpacked_to_its_limit(method, tmp_path):
    content, bomb = os.urandom(50_000), bytes(12 * 10**6)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", method) as archive:
        archive.writestr("whole", content)
        archive.writestr("bomb", bomb)
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert read_member(archive, "whole", 50_000) == content
        for declared in (len(bomb), 10):
            archive.getinfo("bomb").file_size = declared
            tracemalloc.start()
            with pytest.raises(ValueError, match="its bomb holds more than 1000 bytes"):
                read_member(archive, "bomb", 1000)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < 10**7  # of LZMA the dictionary
        archive.getinfo("whole").CRC += 1
        with pytest.raises(zipfile.BadZipFile, match="its whole is damaged"):
            read_member(archive, "whole", 50_000)


def test_nothing_is_written_through_a_link_that_leads_out_of_a_folder(tmp_path):
    outside, above = tmp_path / "outside", tmp_path / "above"
    (outside / "run").mkdir(parents=True)
    (outside / "file").write_text("former")
    above.symlink_to(outside)  # the user's own
    run = above / "run"
    keep_inside(run)
    (run / "file").symlink_to(outside / "file")
    (run / "folder").symlink_to(outside)
    (run / "none").symlink_to(outside / "new")
    for path in (run / "file", run / "folder" / "file", run / "folder" / "new", run / "none"):
        for write in (lambda path: write_text(path, "new"), check_writable, make_folder):
            with pytest.raises(RunError, match="leads out of .* by a link"):
                write(path)
    assert (outside / "file").read_text() == "former"
    assert sorted(path.name for path in outside.iterdir()) == ["file", "run"]
    (run / "near").symlink_to("real")
    for path in (run / "near", above / "file", outside / "other"):
        write_text(path, "new")
        assert path.read_text() == "new"


def test_only_regular_files_of_a_size_are_read(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"1234")
    assert read_file(file, 4) == b"1234"
    with pytest.raises(OSError, match="more than 3 bytes"):
        read_file(file, 3)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    for path in (Path("/dev/zero"), tmp_path / "pipe", tmp_path / "loop", tmp_path):
        with pytest.raises(OSError, match="no file|Too many levels|directory"):
            read_file(path)


# Arrays: what a header claims, or a member unpacks to, is bounded before it is made.


ARRAYS = {
    "numbers": np.arange(6.0).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6, dtype=np.int8).reshape(2, 3)),
    "empty": np.zeros((0, 4), np.float32),
    "text": np.array("a title"),
}


def npy(shape, content=b"", descr="|u1"):
    """Return the bytes of an array, or of what claims to be one."""
    stream = io.BytesIO()
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + content


def write_zip(file, method=zipfile.ZIP_DEFLATED, **members):
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return file


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_numpy_writes_is_read(tmp_path, save):
    save(tmp_path / "file.npz", **ARRAYS)
    found = read_arrays(tmp_path / "file.npz")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
    assert list(read_arrays(tmp_path / "file.npz", ["text"])) == ["text"]


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_no_more_is_unpacked_than_there_may_be(tmp_path, method):
    file = write_zip(tmp_path / "file.npz", method, a=npy((10**7,), bytes(10**7)))
    tracemalloc.start()
    with pytest.raises(ValueError, match="more than 1048576 bytes"):
        read_arrays(file, most=2**20)
    assert tracemalloc.get_traced_memory()[1] < 2**23
    tracemalloc.stop()
    two = write_zip(tmp_path / "two.npz", method, a=npy((9000,), bytes(9000)), b=npy((9000,)))
    with pytest.raises(ValueError, match="more than"):
        read_arrays(two, most=9200)


def test_a_header_that_claims_what_is_not_there_is_refused(tmp_path):
    for content in (
        *(npy((10**12,), b"few"), npy((10**12, 0), b""), npy((-1, -3), b"few")),
        npy((1,), b"\x80\x04N.    ", "|O"),
        npy((3,), b"few").replace(b"'|u1'", b"'|q9'"),
        npy((3,), b"few").replace(b"(3,)", b"((("),
        *(b"", b"no array"),
    ):
        with pytest.raises(ValueError, match="."):
            read_arrays(write_zip(tmp_path / "file.npz", a=content))


def test_an_archive_that_claims_to_go_on_is_told(tmp_path):
    file = write_zip(tmp_path / "file.npz", zipfile.ZIP_STORED, a=npy((3,), b"few"))
    content = bytearray(file.read_bytes())
    struct.pack_into("<II", content, content.rindex(b"PK\x01\x02") + 20, 9999, 9999)
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"it ends within its a\.npy"):
        read_arrays(file)


def test_shapes_are_those_of_a_safetensors_header_of_some_size(tmp_path):
    tensors = {"a": {"dtype": "F32", "shape": [2, 3], "data_offsets": [0, 24]}, "__metadata__": {}}
    text = json.dumps(tensors).encode()
    file = tmp_path / "file.safetensors"
    file.write_bytes(struct.pack("<Q", len(text)) + text + bytes(24))
    assert read_shapes(file) == {"a": (2, 3)}
    for content in (struct.pack("<Q", 2**40) + text, struct.pack("<Q", 5) + b"[[[[[", b""):
        file.write_bytes(content)
        with pytest.raises(ValueError, match="header"):
            read_shapes(file)


def test_equal_tensors_and_facts_are_equal_bytes():
    tensors, facts = (
        {"b": np.ones(3, np.float32), "a": np.zeros(1)},
        {f"k{i}": "é" for i in range(9)},
    )
    packed = {in_order(safetensors.numpy.save(tensors, facts)) for _ in range(9)}
    assert len(packed) == 1
    found = safetensors.numpy.load(packed.pop())
    assert {n: t.tolist() for n, t in found.items()} == {"b": [1, 1, 1], "a": [0]}
