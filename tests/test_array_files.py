"""Arrays in files: what a header claims, or a member unpacks to, is bounded before it is made."""

import io
import json
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
import safetensors.numpy

from sb3_piano.array_files import in_order, read_arrays, read_shapes

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
    file = write_zip(tmp_path / "file.npz", method, a=npy((2**25,), bytes(2**25)))
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
