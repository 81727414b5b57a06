"""Files that are none: only regular files of a fitting size are read."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from pix2face.errors import InputFileError
from pix2face.face_files.annotations import read_dlib_xml
from pix2face.face_files.box_files import read_box_file
from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.files.images import read_photograph, read_size_px
from pix2face.files.opening import LARGEST_LINE_BYTES, check_regular, is_folder, is_regular, read_text_file, text_lines
from pix2face.geometry.landmarks import read_pts
from pix2face.inference.centre_files import load_detector
from pix2face.inference.onnx_files import load_onnx, open_network
from pix2face.model_formats import read_model
from pix2face.tracking.video import open_frames


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_giant(path: Path) -> None:
    path.touch()
    os.truncate(path, 1 << 33)


def make_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(path))


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (make_socket, "found a device, pipe or socket; name a file"),
        (make_pipe, "found a device, pipe or socket; name a file"),
        (lambda path: path.symlink_to("/dev/zero"), "found a device, pipe or socket; name a file"),
        (lambda path: path.symlink_to("/dev/null"), "found a device, pipe or socket; name a file"),
        (Path.mkdir, "found a folder; name a file in it"),
        (make_giant, "found 8192 MB, where at most 1 MB are read"),
        (lambda path: None, "found no such file"),
        (lambda path: path.symlink_to(path), "cannot read it"),
    ],
)
def test_what_is_no_file_of_a_fitting_size_is_said(tmp_path: Path, make: Callable[[Path], None], found: str) -> None:
    path = tmp_path / "faces.txt"
    make(path)
    with pytest.raises(InputFileError, match=rf"faces\.txt: expected a list, {found}"):
        check_regular(path, "a list", 1 << 20)


@pytest.mark.parametrize("name", ["x" * 300, "nul\0character", "x/" * 3000])
def test_names_that_no_file_can_have_are_of_none(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    assert not is_regular(path)
    assert not is_folder(path)
    with pytest.raises(InputFileError, match="expected a list, "):
        check_regular(path, "a list", 1)


def test_no_file_stays_open(tmp_path: Path) -> None:
    make_pipe(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"ab")
    before = len(list(Path("/proc/self/fd").iterdir()))
    for name, largest in (("pipe", 1), ("file", 1), ("", 1)):
        with pytest.raises(InputFileError):
            check_regular(tmp_path / name, "a list", largest)
    check_regular(tmp_path / "file", "a list", 2)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_lines_come_one_by_one_and_none_without_end(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("\ufeffä,b\r\nc\n".encode())
    assert list(text_lines(path, "a list", 100)) == ["ä,b\r\n", "c\n"]
    path.write_bytes(b"a\n" + b"x" * LARGEST_LINE_BYTES)
    with pytest.raises(InputFileError, match="found a line of 1048576 bytes"):
        list(text_lines(path, "a list", 1 << 30))
    path.write_bytes(b"\xff\xfe")
    for read in (lambda: list(text_lines(path, "a list", 9)), lambda: read_text_file(path, "a list", 9)):
        with pytest.raises(InputFileError, match="expected a list, found binary data"):
            read()


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * b"0" + b"\nsize 241016421\n"
PAGE = b"\n<!DOCTYPE html><html><head><title>Sign in</title></head></html>"
READERS: dict[str, Callable[[Path], object]] = {
    "model.mat": read_model,
    "network.safetensors": open_network,
    "detector.safetensors": load_detector,
    "network.onnx": load_onnx,
    "face.jpg": read_photograph,
    "size.jpg": read_size_px,
    "face.mat": read_coefficient_file,
    "face.pts": read_pts,
    "faces.xml": read_dlib_xml,
    "boxes.csv": read_box_file,
    "clip.mp4": open_frames,
}


@pytest.mark.parametrize("name", READERS)
def test_what_a_download_left_is_named_by_every_reader(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    for content, found in ((POINTER, "found a pointer of Git LFS, .*git lfs pull"), (PAGE, "found an HTML page")):
        path.write_bytes(content)
        with pytest.raises(InputFileError, match=rf"{name}: expected .*, {found}"):
            READERS[name](path)
