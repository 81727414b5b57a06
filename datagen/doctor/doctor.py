"""From what was probed of OpenGL to what is wrong and how to remedy it: facts in, findings out, nothing is touched."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, final

from datagen.doctor.gl_probe import LIMIT_MM, BackendProbe, RenderCheck
from datagen.doctor.gl_surroundings import GL_LIBRARY, NVIDIA_LIBRARY, OSMESA, VENDOR_VARIABLE, Surroundings
from datagen.opengl.egl_devices import EGL_LIBRARY
from datagen.opengl.gl_context import (
    BACKENDS,
    COMPUTE_VERSION,
    DEVICE_VARIABLE,
    ENVIRONMENT_VARIABLE,
    FOREIGN_DEVICE_VARIABLE,
    RASTERISER_VARIABLE,
    GLSettings,
    choose_rasteriser,
)
from pix2face.errors import GLUnavailableError

Level = Literal["error", "warning", "note"]

# Times of small pictures on a busy machine vary: less than this is no difference.
MUCH_FASTER = 1.5
NVIDIA_VENDOR_FILE = "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"
NVIDIA_VENDOR_CONTENT = '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}'


@final
@dataclass(frozen=True)
class Finding:
    """One thing that was noticed.

    Attributes:
        level: ``error``: nothing right can be rendered with these settings. ``warning``: something is not as it should
            be. ``note``: good to know.
        what: What was found.
        remedy: What to do; "" where nothing need be done.
    """

    level: Level
    what: str
    remedy: str = ""


@final
@dataclass(frozen=True)
class Diagnosis:
    """The whole of it.

    Attributes:
        backend: What these settings draw with; "" where nothing draws.
        rasteriser: By which path; "" where none.
        reason: Why that path.
        findings: The worst first.
    """

    backend: str
    rasteriser: str
    reason: str
    findings: tuple[Finding, ...]

    @property
    def is_healthy(self) -> bool:
        """Whether renders of these settings can be trusted."""
        return all(finding.level != "error" for finding in self.findings)


def diagnose(surroundings: Surroundings, probes: Sequence[BackendProbe], settings: GLSettings) -> Diagnosis:
    """Judges what was probed.

    Args:
        surroundings: What is installed.
        probes: What each backend does, in the order of preference; those that the settings exclude may be among them.
        settings: What is going to be used, resolved with the environment.
    """
    allowed = [settings.backend] if settings.backend else list(BACKENDS if settings.device is None else BACKENDS[:1])
    chosen = next((probe for probe in probes if probe.backend in allowed and not probe.error), None)
    rasteriser, reason, findings = "", "", []
    if chosen is not None:
        try:
            rasteriser = choose_rasteriser(settings.rasteriser, chosen.version_code)
            reason = _reason(settings, chosen.version_code)
        except GLUnavailableError as error:
            findings.append(Finding("error", str(error), f"unset {RASTERISER_VARIABLE}, or choose auto or fragment"))
        if settings.rasteriser == "auto" and rasteriser == "fragment":
            remedy = "none is needed: this is right, only slower; a newer driver has it (Mesa's on the processor: 20.2)"
            findings.append(Finding("note", f"{chosen.renderer} has no OpenGL 4.3: no compute shaders", remedy))
    for probe in probes:
        if probe.error:
            level: Level = "note" if chosen or probe.backend not in allowed else "error"
            findings.append(Finding(level, f"{probe.backend}: {probe.error}", _remedy(probe, surroundings)))
        findings += _of_checks(probe, rasteriser if probe is chosen else "")
    findings += _of_speed(chosen, rasteriser) if settings.rasteriser == "auto" else []
    findings += [*_of_nvidia(surroundings), *_of_device_files(surroundings)]
    findings += [*_of_devices(surroundings, chosen, settings), *_of_environment(surroundings)]
    findings.sort(key=lambda finding: ("error", "warning", "note").index(finding.level))
    return Diagnosis(chosen.backend if chosen else "", rasteriser, reason, tuple(findings))


def _reason(settings: GLSettings, version_code: int) -> str:
    if settings.rasteriser != "auto":
        return "asked for"
    has = "has" if version_code >= COMPUTE_VERSION else "has no"
    return f"OpenGL {version_code // 100}.{version_code // 10 % 10} {has} compute shaders"


def _of_checks(probe: BackendProbe, chosen_rasteriser: str) -> Iterator[Finding]:
    for check in probe.checks:
        if not check.is_right:
            level: Level = "error" if check.rasteriser == chosen_rasteriser else "warning"
            yield Finding(level, _deviation(probe, check), _way_round(probe, check))


def _of_speed(chosen: BackendProbe | None, rasteriser: str) -> Iterator[Finding]:
    """Which path is faster depends on the driver: ``auto`` knows what there is, not what it costs."""
    right = {check.rasteriser: check.milliseconds for check in chosen.checks if check.is_right} if chosen else {}
    for other, milliseconds in right.items():
        if rasteriser in right and milliseconds * MUCH_FASTER < right[rasteriser]:
            yield Finding(
                "note",
                f"the rasteriser {other} is faster here: {milliseconds:.1f} ms a picture, {rasteriser} "
                f"{right[rasteriser]:.1f} ms",
                f"{RASTERISER_VARIABLE}={other}, or --rasteriser {other}",
            )


def _remedy(probe: BackendProbe, surroundings: Surroundings) -> str:
    """What to do where a backend makes no context; the most basic lack first."""
    remedy = _lack(probe, surroundings)
    if surroundings.environment.get(ENVIRONMENT_VARIABLE) == probe.backend:
        remedy += f"; or unset {ENVIRONMENT_VARIABLE}, which allows {probe.backend} alone"
    return remedy


def _lack(probe: BackendProbe, surroundings: Surroundings) -> str:
    if probe.error.startswith("device: "):
        return f"choose one of the devices that are listed, or none (--device, {DEVICE_VARIABLE})"
    if probe.backend == "osmesa":
        if surroundings.complaints[OSMESA]:
            return "apt-get install libosmesa6 (Mesa 25.1 and newer have none: use EGL)"
        return "libOSMesa is there but makes no context of OpenGL 3.3: install a newer Mesa, or use EGL"
    if surroundings.complaints[EGL_LIBRARY]:
        return f"no libEGL ({surroundings.complaints[EGL_LIBRARY]}): apt-get install libegl1 libgl1 libgl1-mesa-dri"
    if surroundings.complaints[GL_LIBRARY]:
        return f"no libGL ({surroundings.complaints[GL_LIBRARY]}): apt-get install libgl1"
    if surroundings.missing_vendor_files:
        return f"{', '.join(surroundings.missing_vendor_files)} is not there: unset {VENDOR_VARIABLE} or correct it"
    if not surroundings.vendor_files:
        return "libEGL is there but no driver behind it: apt-get install libegl-mesa0 libgl1-mesa-dri"
    if surroundings.devices and all(not device.vendor for device in surroundings.devices):
        return (
            "none of the drivers starts: apt-get install --reinstall libegl-mesa0 libgl1-mesa-dri; see the notes below"
        )
    return (
        "reinstall the drivers (apt-get install --reinstall libegl1 libegl-mesa0 libgl1-mesa-dri), "
        "or draw on the processor with LIBGL_ALWAYS_SOFTWARE=1"
    )


def _deviation(probe: BackendProbe, check: RenderCheck) -> str:
    where = f"{probe.backend}, {check.rasteriser} ({probe.renderer})"
    if check.error:
        return f"{where}: draws nothing ({check.error})"
    return (
        f"{where}: expected the oracle's maps, found {check.mask_differs_px} of {check.mask_px} pixels of the mask "
        f"different, {check.off_px} more than {LIMIT_MM} mm off, 99.9 % up to {check.typical_worst_mm:.3g} mm"
    )


def _way_round(probe: BackendProbe, check: RenderCheck) -> str:
    right = [other.rasteriser for other in probe.checks if other.is_right]
    other = f"{ENVIRONMENT_VARIABLE}={'osmesa' if probe.backend == 'egl' else 'egl'}"
    way = f"{RASTERISER_VARIABLE}={right[0]}" if right else other
    return f"use another way to draw ({way}), and report this with the output of `datagen doctor --json`"


def _of_nvidia(surroundings: Surroundings) -> Iterator[Finding]:
    has_library = not surroundings.complaints[NVIDIA_LIBRARY]
    names_nvidia = any("nvidia" in path.lower() for path in surroundings.vendor_files)
    if has_library and not names_nvidia:
        yield Finding(
            "warning",
            f"{NVIDIA_LIBRARY} is there, but no vendor file tells EGL of it: the GPU is not used",
            f"write {NVIDIA_VENDOR_CONTENT} to {NVIDIA_VENDOR_FILE}; without the right to, to a file of yours and set "
            f"{VENDOR_VARIABLE} to its path",
        )
    if surroundings.nvidia_nodes and not has_library:
        remedy = "install the driver's OpenGL part (package libnvidia-gl-VERSION, VERSION that of the kernel module)"
        if surroundings.is_container:
            remedy = (
                "start the container with NVIDIA's runtime and NVIDIA_DRIVER_CAPABILITIES=all (or at least "
                "graphics,compute,utility); without graphics it gets CUDA but no OpenGL"
            )
        found = ", ".join(node.path for node in surroundings.nvidia_nodes)
        yield Finding("warning", f"an NVIDIA GPU ({found}) without its OpenGL library {NVIDIA_LIBRARY}", remedy)


def _of_device_files(surroundings: Surroundings) -> Iterator[Finding]:
    for node in (*surroundings.render_nodes, *surroundings.nvidia_nodes):
        if not node.is_open:
            remedy = f"add yourself to its group and log in again: sudo usermod -aG {node.group} $USER"
            if surroundings.is_container:
                remedy = f"start the container with --group-add {node.group}, or as root"
            yield Finding("warning", f"{node.path}: no permission to use this GPU", remedy)
    if not surroundings.render_nodes and not surroundings.nvidia_nodes:
        remedy = "has it a GPU, then install its kernel driver"
        if surroundings.is_container:
            remedy = "has the machine a GPU, then hand it to the container: --device /dev/dri (NVIDIA: --gpus all)"
        yield Finding("note", "no render node (/dev/dri/renderD*): everything is drawn on the processor", remedy)


def _of_devices(surroundings: Surroundings, chosen: BackendProbe | None, settings: GLSettings) -> Iterator[Finding]:
    hardware = [device for device in surroundings.devices if not device.is_software]
    listed = "; ".join(f"{device.index}: {device.description}" for device in hardware)
    if surroundings.devices_error and not surroundings.complaints[EGL_LIBRARY]:
        yield Finding(
            "warning", f"EGL does not list its devices ({surroundings.devices_error})", "install a newer libEGL"
        )
    if len(hardware) > 1 and settings.device is None:
        yield Finding("note", f"several GPUs ({listed})", f"choose one with --device N or {DEVICE_VARIABLE}=N")
    draws_in_software = chosen is not None and any(
        word in chosen.renderer.lower() for word in ("llvmpipe", "softpipe", "swrast")
    )
    if hardware and draws_in_software:
        remedy = f"choose it with --device N or {DEVICE_VARIABLE}=N; the notes on drivers may say why it was not taken"
        yield Finding("warning", f"drawing is done on the processor, though there is a GPU ({listed})", remedy)


def _of_environment(surroundings: Surroundings) -> Iterator[Finding]:
    if surroundings.missing_vendor_files:
        missing = ", ".join(surroundings.missing_vendor_files)
        yield Finding("warning", f"an environment variable sends EGL to {missing}, which is not there", "unset it")
    if FOREIGN_DEVICE_VARIABLE in surroundings.environment:
        value = surroundings.environment[FOREIGN_DEVICE_VARIABLE]
        yield Finding("note", f"{FOREIGN_DEVICE_VARIABLE}={value} is set", f"use {DEVICE_VARIABLE} instead")
    if surroundings.environment.get("LIBGL_ALWAYS_SOFTWARE", "").lower() in ("1", "true", "yes", "y"):
        yield Finding("note", "LIBGL_ALWAYS_SOFTWARE is set: Mesa draws on the processor", "unset it to use a GPU")
