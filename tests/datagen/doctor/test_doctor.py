"""The doctor: each way in which OpenGL fails, simulated, gets its remedy."""

import json
from dataclasses import replace

import pytest

from datagen.doctor.doctor import NVIDIA_VENDOR_CONTENT, Diagnosis, diagnose
from datagen.doctor.gl_probe import BackendProbe, RenderCheck
from datagen.doctor.gl_surroundings import DeviceFile, Surroundings
from datagen.opengl.egl_devices import EGLDevice
from datagen.opengl.gl_context import GLSettings

GOOD = RenderCheck("compute", "", 10_000, 2, 1, 0.001, 5.0)
EGL = BackendProbe("egl", "", "llvmpipe (LLVM 15)", "4.5 Mesa", 450, (GOOD,))
OSMESA = replace(EGL, backend="osmesa")
GPU = replace(EGL, renderer="NVIDIA GeForce")
PROCESSOR = BackendProbe("processor", checks=(replace(GOOD, rasteriser="processor"),))
NO_EGL = BackendProbe("egl", "expected OpenGL 3.3 without a display, found none (egl: libEGL.so.1: no such file)")
NO_OSMESA = BackendProbe("osmesa", "expected OpenGL 3.3 without a display, found none (osmesa: libOSMesa.so.8: none)")
SOFTWARE = EGLDevice(0, "Mesa Project (EGL 1.5)", ("EGL_MESA_device_software",), None)
CARD = EGLDevice(0, "NVIDIA (EGL 1.5)", ("EGL_NV_device_cuda",), "/dev/dri/renderD128")
OTHER_CARD = EGLDevice(1, "Mesa Project (EGL 1.5)", (), "/dev/dri/renderD129")
MESA = Surroundings(
    complaints={"libEGL.so.1": "", "libGL.so.1": "", "libEGL_nvidia.so.0": "not there", "libOSMesa": ""},
    devices=(SOFTWARE,),
    vendor_files=("/usr/share/glvnd/egl_vendor.d/50_mesa.json",),
)


def lacking(surroundings: Surroundings, **complaints: str) -> Surroundings:
    names = {"egl": "libEGL.so.1", "gl": "libGL.so.1", "nvidia": "libEGL_nvidia.so.0", "osmesa": "libOSMesa"}
    found = {names[name]: complaint for name, complaint in complaints.items()}
    return replace(surroundings, complaints={**surroundings.complaints, **found})


def findings(diagnosis: Diagnosis, level: str) -> str:
    return "\n".join(f"{found.what} -> {found.remedy}" for found in diagnosis.findings if found.level == level)


def test_a_machine_in_order_is_healthy() -> None:
    found = diagnose(MESA, [GPU, OSMESA, PROCESSOR], GLSettings())
    assert found.is_healthy
    assert (found.backend, found.rasteriser, found.reason) == ("egl", "compute", "OpenGL 4.5 has compute shaders")
    found = diagnose(MESA, [EGL, OSMESA, PROCESSOR], GLSettings())
    assert found.is_healthy
    assert (found.backend, found.rasteriser) == ("egl", "processor")
    assert found.reason == "OpenGL would draw on the processor as well"
    assert [finding.level for finding in found.findings] == ["note"]
    assert "no render node (/dev/dri/renderD*)" in findings(found, "note")


def test_one_backend_is_enough() -> None:
    found = diagnose(lacking(MESA, osmesa="none"), [EGL, NO_OSMESA], GLSettings())
    assert found.is_healthy
    assert "apt-get install libosmesa6" in findings(found, "note")
    found = diagnose(lacking(MESA, egl="none"), [NO_EGL, OSMESA], GLSettings())
    assert (found.is_healthy, found.backend) == (True, "osmesa")
    assert "no libEGL (none): apt-get install libegl1 libgl1 libgl1-mesa-dri" in findings(found, "note")


LACKS = [
    (lacking(MESA, egl="none"), "no libEGL (none): apt-get install libegl1"),
    (lacking(MESA, gl="none"), "no libGL (none): apt-get install libgl1"),
    (replace(MESA, vendor_files=(), devices=()), "no driver behind it: apt-get install libegl-mesa0 libgl1-mesa-dri"),
    (replace(MESA, missing_vendor_files=("/x.json",)), "/x.json is not there: unset __EGL_VENDOR_LIBRARY_FILENAMES"),
    (replace(MESA, devices=(replace(SOFTWARE, vendor=""),)), "none of the drivers starts"),
    (MESA, "or draw on the processor with LIBGL_ALWAYS_SOFTWARE=1"),
]


@pytest.mark.parametrize(("surroundings", "remedy"), LACKS)
def test_without_any_context_the_remedy_is_for_what_lacks(surroundings: Surroundings, remedy: str) -> None:
    found = diagnose(surroundings, [NO_EGL, NO_OSMESA, PROCESSOR], GLSettings())
    assert not found.is_healthy
    assert (found.backend, found.rasteriser, found.reason) == ("", "processor", "no OpenGL")
    assert remedy in findings(found, "error")
    assert "pictures of faces that have no photograph cannot be drawn (maps can)" in findings(found, "error")
    maps_alone = diagnose(surroundings, [NO_EGL, NO_OSMESA, PROCESSOR], GLSettings(rasteriser="processor"))
    assert maps_alone.is_healthy
    assert remedy in findings(maps_alone, "warning")
    assert "libOSMesa is there but makes no context" in findings(found, "error")


def test_a_forced_backend_that_fails_is_an_error_though_another_works() -> None:
    forced = replace(MESA, environment={"PIX2FACE_GL": "egl"})
    found = diagnose(lacking(forced, egl="none"), [NO_EGL, OSMESA], GLSettings("egl"))
    assert not found.is_healthy
    assert "or unset PIX2FACE_GL, which allows egl alone" in findings(found, "error")


def test_a_device_that_is_not_there_is_an_error() -> None:
    refused = BackendProbe("egl", "device: expected one of the 1 that EGL lists (0: ...), found 3")
    found = diagnose(MESA, [refused, OSMESA], GLSettings(device=3))
    assert not found.is_healthy
    assert "choose one of the devices that are listed, or none (--device, PIX2FACE_GL_DEVICE)" in findings(
        found, "error"
    )


def test_old_opengl_means_the_processor() -> None:
    old = replace(GPU, version_code=330, checks=())
    found = diagnose(MESA, [old, OSMESA, PROCESSOR], GLSettings())
    assert (found.is_healthy, found.rasteriser) == (True, "processor")
    assert found.reason == "OpenGL 3.3 has no compute shaders"
    assert "has no OpenGL 4.3: no compute shaders" in findings(found, "note")
    found = diagnose(MESA, [old, OSMESA], GLSettings(rasteriser="compute"))
    assert not found.is_healthy
    assert "expected OpenGL 4.3 for the rasteriser compute, found 3.3" in findings(found, "error")
    assert diagnose(MESA, [EGL], GLSettings(rasteriser="processor")).reason == "asked for"


WRONG = [
    replace(GOOD, mask_differs_px=500),
    replace(GOOD, off_px=500),
    replace(GOOD, typical_worst_mm=1.0),
    replace(GOOD, mask_px=0),
    RenderCheck("compute", "GL_OUT_OF_MEMORY"),
]


@pytest.mark.parametrize("wrong", WRONG)
def test_a_driver_that_draws_something_else_is_an_error_where_it_is_used(wrong: RenderCheck) -> None:
    probes = [replace(GPU, checks=(wrong,)), OSMESA, PROCESSOR]
    found = diagnose(MESA, probes, GLSettings())
    assert not found.is_healthy
    assert "PIX2FACE_RASTERISER=processor), and report this" in findings(found, "error")
    found = diagnose(MESA, probes, GLSettings(rasteriser="processor"))
    assert found.is_healthy
    assert "egl, compute (NVIDIA" in findings(found, "warning")
    found = diagnose(MESA, [EGL, replace(PROCESSOR, checks=(replace(wrong, rasteriser="processor"),))], GLSettings())
    assert "PIX2FACE_RASTERISER=compute), and report this" in findings(found, "error")


def test_a_faster_rasteriser_is_recommended() -> None:
    slow = replace(GPU, checks=(replace(GOOD, milliseconds=30.0),))
    fast = replace(PROCESSOR, checks=(replace(PROCESSOR.checks[0], milliseconds=10.0),))
    found = findings(diagnose(MESA, [slow, fast], GLSettings()), "note")
    assert "the rasteriser processor is faster here: 10.0 ms a picture, compute 30.0 ms" in found
    assert "PIX2FACE_RASTERISER=processor" in found
    assert "faster" not in findings(diagnose(MESA, [slow, fast], GLSettings(rasteriser="compute")), "note")
    wrong = replace(fast, checks=(replace(fast.checks[0], off_px=5000),))
    assert "faster" not in findings(diagnose(MESA, [slow, wrong], GLSettings()), "note")


def test_nvidias_missing_vendor_file_is_written_out() -> None:
    found = diagnose(lacking(MESA, nvidia=""), [EGL, OSMESA], GLSettings())
    assert found.is_healthy
    assert f"write {NVIDIA_VENDOR_CONTENT} to /usr/share/glvnd/egl_vendor.d/10_nvidia.json" in findings(
        found, "warning"
    )
    assert json.loads(NVIDIA_VENDOR_CONTENT)["ICD"]["library_path"] == "libEGL_nvidia.so.0"
    present = replace(MESA, vendor_files=("/usr/share/glvnd/egl_vendor.d/10_nvidia.json",))
    assert "vendor file" not in findings(diagnose(lacking(present, nvidia=""), [EGL], GLSettings()), "warning")


def test_a_container_without_drivers_is_started_with_them() -> None:
    card = DeviceFile("/dev/nvidia0", "root", True)
    inside = replace(MESA, nvidia_nodes=(card,), is_container=True)
    assert "NVIDIA_DRIVER_CAPABILITIES=all" in findings(diagnose(inside, [EGL], GLSettings()), "warning")
    outside = replace(inside, is_container=False)
    assert "libnvidia-gl-VERSION" in findings(diagnose(outside, [EGL], GLSettings()), "warning")
    empty = replace(MESA, is_container=True)
    assert "--device /dev/dri (NVIDIA: --gpus all)" in findings(diagnose(empty, [EGL], GLSettings()), "note")


def test_a_render_node_without_permission_names_its_group() -> None:
    closed = replace(MESA, render_nodes=(DeviceFile("/dev/dri/renderD128", "render", False),))
    found = findings(diagnose(closed, [EGL], GLSettings()), "warning")
    assert "/dev/dri/renderD128: no permission" in found
    assert "usermod -aG render $USER" in found
    inside = replace(closed, is_container=True)
    assert "--group-add render" in findings(diagnose(inside, [EGL], GLSettings()), "warning")
    assert "no render node" not in findings(diagnose(closed, [EGL], GLSettings()), "note")


def test_several_gpus_are_listed_and_one_that_idles_is_noticed() -> None:
    two = replace(MESA, devices=(CARD, OTHER_CARD, replace(SOFTWARE, index=2)))
    fast = replace(EGL, renderer="NVIDIA GeForce")
    found = diagnose(two, [fast], GLSettings())
    assert "several GPUs (0: NVIDIA" in findings(found, "note")
    assert "--device N" in findings(found, "note")
    assert "several" not in findings(diagnose(two, [fast], GLSettings(device=1)), "note")
    assert "done on the processor, though there is a GPU" not in findings(found, "warning")
    assert "done on the processor, though there is a GPU" in findings(diagnose(two, [EGL], GLSettings()), "warning")


def test_devices_that_egl_does_not_list_are_noticed() -> None:
    found = diagnose(replace(MESA, devices_error="eglQueryDevicesEXT failed"), [EGL], GLSettings())
    assert "EGL does not list its devices (eglQueryDevicesEXT failed)" in findings(found, "warning")
