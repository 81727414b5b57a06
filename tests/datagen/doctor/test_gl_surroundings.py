"""What of OpenGL is installed: libraries, device files, vendor files, variables, on machines of all kinds."""

import os
from pathlib import Path

import pytest

from datagen.doctor.gl_probe import devices_apart
from datagen.doctor.gl_surroundings import survey
from datagen.opengl.egl_devices import EGLDevice, count_egl_devices, egl_devices

CARD = EGLDevice(0, "NVIDIA (EGL 1.5)", ("EGL_NV_device_cuda",), "/dev/dri/renderD128")


def machine(root: Path) -> Path:
    (root / "usr/share/glvnd/egl_vendor.d").mkdir(parents=True)
    (root / "usr/share/glvnd/egl_vendor.d/50_mesa.json").write_text("{}")
    (root / "dev/dri").mkdir(parents=True)
    return root


def no_library(name: str) -> object:
    raise OSError(f"{name}: cannot open shared object file")


def test_a_machine_is_surveyed(tmp_path: Path) -> None:
    root = machine(tmp_path)
    for name in ("dri/renderD128", "dri/card0", "nvidia0", "nvidiactl"):
        (root / "dev" / name).write_bytes(b"")
    (root / ".dockerenv").write_bytes(b"")
    environment = {"PIX2FACE_GL": "egl", "SECRET": "kept"}
    found = survey(((CARD,), ""), root, environment, lambda name: object())
    assert set(found.complaints.values()) == {""}
    assert [Path(node.path).name for node in found.render_nodes] == ["renderD128"]
    assert [Path(node.path).name for node in found.nvidia_nodes] == ["nvidia0"]
    assert found.render_nodes[0].is_open
    assert [Path(name).name for name in found.vendor_files] == ["50_mesa.json"]
    assert found.is_container
    assert found.environment == {"PIX2FACE_GL": "egl"}
    assert found.devices == (CARD,)


def test_an_empty_machine_is_surveyed(tmp_path: Path) -> None:
    found = survey(((), "no library"), tmp_path, {}, no_library)
    assert found.complaints["libEGL.so.1"] == "libEGL.so.1: cannot open shared object file"
    assert found.complaints["libOSMesa"].startswith("libOSMesa.so.8")
    assert (found.render_nodes, found.vendor_files, found.is_container) == ((), (), False)


def test_a_closed_render_node_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (machine(tmp_path) / "dev/dri/renderD128").write_bytes(b"")
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may open everything
    assert not survey(((), ""), tmp_path, {}, no_library).render_nodes[0].is_open


@pytest.mark.parametrize("library", ["libNoEGL.so.9", "libm.so.6"])
def test_without_egl_its_devices_cannot_be_listed(library: str) -> None:
    for ask in (egl_devices, count_egl_devices):
        with pytest.raises(OSError, match=library):
            ask(library)


@pytest.mark.gl
def test_as_many_devices_are_counted_as_listed() -> None:
    if survey(((), "")).complaints["libEGL.so.1"]:
        pytest.skip("no libEGL")
    listed, error = devices_apart()
    assert error == ""
    assert [device.index for device in listed] == list(range(count_egl_devices()))


def test_variables_replace_the_vendor_folders(tmp_path: Path) -> None:
    root = machine(tmp_path)
    mine = root / "mine.json"
    mine.write_text("{}")
    named = survey(((), ""), root, {"__EGL_VENDOR_LIBRARY_FILENAMES": f"{mine}:{root}/no.json"}, no_library)
    assert (named.vendor_files, named.missing_vendor_files) == ((str(mine),), (f"{root}/no.json",))
    folder = survey(((), ""), root, {"__EGL_VENDOR_LIBRARY_DIRS": f"{root}:{root}/nowhere"}, no_library)
    assert (folder.vendor_files, folder.missing_vendor_files) == ((str(mine),), (f"{root}/nowhere",))


@pytest.mark.parametrize(("text", "expected"), [("0::/kubepods/x", True), ("0::/init.scope", False)])
def test_containers_are_told_by_their_groups(text: str, expected: bool, tmp_path: Path) -> None:
    (tmp_path / "proc/1").mkdir(parents=True)
    (tmp_path / "proc/1/cgroup").write_text(text)
    assert survey(((), ""), tmp_path, {}, no_library).is_container == expected
