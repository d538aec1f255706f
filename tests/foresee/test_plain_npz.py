"""NumPy archives: what they say of themselves is checked before it is read."""

import io
import zipfile

import numpy as np
import pytest

from foresee.infra.part_file import read_part, write_arrays
from foresee.infra.plain_npz import NpzError, PlainNpz, read_npz
from foresee.infra.resumable import ResumableFolder


def member(head, data=b""):
    """The content of an array's file: a header of NumPy's format 1.0, and data."""
    head = head.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


def head(shape, kind="'<f8'"):
    return f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}}}"


def archive(path, members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as packed:
        for name, content in members.items():
            packed.writestr(name, content)
    return path


def test_arrays_come_back_as_they_were_written(tmp_path):
    arrays = {
        "a/b": np.arange(6.0).reshape(2, 3),
        "columns": np.asfortranarray(np.arange(6, dtype=np.int8).reshape(2, 3)),
        "scalar": np.array(3),
        "empty": np.empty((0, 2), np.float32),
        "words": np.array(["x", "yz"]),
        "flags": np.array([True, False]),
    }
    for compress in (False, True):
        write_arrays(tmp_path / "a.npz", arrays, compress)
        read = read_npz(tmp_path / "a.npz")
        assert read.keys() == arrays.keys()
        for name, values in arrays.items():
            assert read[name].dtype == values.dtype
            assert np.array_equal(read[name], values)
            assert read[name].flags.writeable


LIES = {
    "more than there is": member(head((10**12,)), b"8 bytes."),
    "less than there is": member(head((1,)), bytes(80)),
    "an overflow": member(head((2**40, 2**40)), b""),
    "a negative size": member(head((-1, -1)), b"8 bytes."),
    "objects": member(head((1,), "'|O'"), b"8 bytes."),
    "objects in fields": member(head((1,), "[('a', '|O')]"), b"8 bytes."),
    "nothing many times": member(head((10**15,), "'|S0'")),
    "an unknown type": member(head((1,), "'<q9'"), b"8 bytes."),
    "an open bracket": member("{'descr': ("),
    "a deep nesting": member("[" * 100),
    "no header": b"",
    "another format": b"PK\x03\x04",
    "a pickle": b"\x80\x04K\x01.",
}


@pytest.mark.parametrize("lie", LIES)
def test_a_header_that_contradicts_the_data_is_refused(tmp_path, lie):
    path = archive(tmp_path / "a.npz", {"x.npy": LIES[lie]})
    with pytest.raises(NpzError, match="'x' is"):
        read_npz(path)
    with PlainNpz(path) as file, pytest.raises(NpzError):
        file.head("x")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_only_the_compression_of_numpy_is_unpacked(tmp_path, method):
    out = io.BytesIO()
    np.save(out, np.zeros(3))
    path = archive(tmp_path / "a.npz", {"x.npy": out.getvalue()}, method)
    with pytest.raises(NpzError, match="not supported"):
        read_npz(path)


def test_large_arrays_are_refused_before_any_is_unpacked(tmp_path, monkeypatch):
    write_arrays(tmp_path / "a.npz", {name: np.zeros(1000) for name in "abc"})

    def unpacked(*_, **__):
        raise AssertionError("an array was opened")

    monkeypatch.setattr(zipfile.ZipFile, "open", unpacked)
    with pytest.raises(NpzError, match="over 20000 bytes"):
        read_npz(tmp_path / "a.npz", 20_000)
    with pytest.raises(NpzError, match="over 20000 bytes"):
        read_part(tmp_path / "a.npz", most=20_000)
    with PlainNpz(tmp_path / "a.npz") as file, pytest.raises(NpzError, match="larger than"):
        file.read("a", 5000)


def test_what_is_no_archive_of_arrays_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(3))
    archive(tmp_path / "b.npz", {"x.txt": b"text"})
    (tmp_path / "c.npz").write_bytes(b"")
    for name in ("a.npy", "b.npz", "c.npz"):
        with pytest.raises(NpzError):
            PlainNpz(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        PlainNpz(tmp_path / "d.npz")
    write_arrays(tmp_path / "e.npz", {"x": np.zeros(3)})
    with PlainNpz(tmp_path / "e.npz") as file, pytest.raises(NpzError, match="no 'y'"):
        file.read("y")


@pytest.mark.parametrize("lie", ["more than there is", "objects", "an open bracket"])
def test_a_part_that_lies_is_set_aside(tmp_path, lie):
    folder = ResumableFolder(tmp_path / "run")
    path = archive(tmp_path / "run" / "1.npz", {"x.npy": LIES[lie]})
    data = path.read_bytes()
    assert folder.read("1.npz") is None
    assert (tmp_path / "run" / "1.npz.damaged").read_bytes() == data
    assert len(folder.notes) == 1
