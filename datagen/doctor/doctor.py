"""Judges what was found out about OpenGL on a machine: what is wrong, and what to do about it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, final

from datagen.doctor.gl_probe import LIMIT_MM, PROCESSOR, BackendProbe, RenderCheck
from datagen.doctor.gl_surroundings import GL_LIBRARY, NVIDIA_LIBRARY, OSMESA, VENDOR_VARIABLE, Surroundings
from datagen.opengl.egl_devices import EGL_LIBRARY
from datagen.opengl.gl_context import (
    COMPUTE_VERSION,
    DEVICE_VARIABLE,
    ENVIRONMENT_VARIABLE,
    RASTERISER_VARIABLE,
    GLSettings,
    is_software_renderer,
)
from datagen.opengl.rasteriser_choice import choose_rasteriser
from pix2face.errors import GLUnavailableError

Level = Literal["error", "warning", "note"]

# Times of small pictures vary on a busy machine: a smaller ratio than this is no difference.
MUCH_FASTER = 1.5
NVIDIA_VENDOR_FILE = "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"
NVIDIA_VENDOR_CONTENT = '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}'


@final
@dataclass(frozen=True)
class Finding:
    """One thing that was noticed."""

    level: Level  # an error: these settings render nothing or something wrong; a warning: to be mended
    what: str  # what was found
    remedy: str = ""  # what to do; empty where nothing needs to be done


@final
@dataclass(frozen=True)
class Diagnosis:
    """What the settings come to on this machine."""

    backend: str  # of the OpenGL that draws pictures; empty where none does
    rasteriser: str  # that draws maps; empty where none does
    reason: str  # for this rasteriser
    findings: tuple[Finding, ...]  # the worst first

    @property
    def is_healthy(self) -> bool:
        """Whether renders with these settings can be trusted."""
        return all(finding.level != "error" for finding in self.findings)


def diagnose(surroundings: Surroundings, probes: Sequence[BackendProbe], settings: GLSettings) -> Diagnosis:
    """Judges what was found out.

    The probes are in the order of preference and include backends that the settings exclude; the settings are what is
    going to be used, resolved with the environment.
    """
    allowed = settings.allowed_backends
    chosen = next((probe for probe in probes if probe.backend in allowed and not probe.error), None)
    rasteriser, reason, findings = "", "", list[Finding]()
    try:
        version, is_software = (chosen.version_code, is_software_renderer(chosen.renderer)) if chosen else (0, False)
        rasteriser = choose_rasteriser(settings.rasteriser, version, is_software=is_software)
    except GLUnavailableError as error:
        findings.append(Finding("error", str(error), f"unset {RASTERISER_VARIABLE}, or choose auto or processor"))
    else:
        reason = _reason(chosen) if settings.rasteriser == "auto" else "asked for"
    if settings.rasteriser == "auto":
        findings += _of_choice(probes, chosen, rasteriser)
    for probe in probes:
        if probe.error:
            findings.append(_of_failure(probe, chosen, surroundings, settings))
        findings += _of_checks(probe, rasteriser if probe is chosen or probe.backend == PROCESSOR else "")
    findings += _of_surroundings(surroundings, chosen, settings)
    findings.sort(key=lambda finding: ("error", "warning", "note").index(finding.level))
    return Diagnosis(chosen.backend if chosen else "", rasteriser, reason, tuple(findings))


def _reason(chosen: BackendProbe | None) -> str:
    if chosen is None:
        return "no OpenGL"
    if is_software_renderer(chosen.renderer):
        return "OpenGL would draw on the processor as well"
    has = "has" if chosen.version_code >= COMPUTE_VERSION else "has no"
    return f"OpenGL {chosen.version_code // 100}.{chosen.version_code // 10 % 10} {has} compute shaders"


def _of_failure(
    probe: BackendProbe, chosen: BackendProbe | None, surroundings: Surroundings, settings: GLSettings
) -> Finding:
    """A backend that makes no context. Only pictures need one, unless it was asked for."""
    if probe.backend == PROCESSOR:
        return Finding(
            "error", f"{probe.backend}: {probe.error}", "report this with the output of `datagen doctor --json`"
        )
    level: Level = "error"
    if chosen or probe.backend not in settings.allowed_backends:
        level = "note"
    elif settings.rasteriser == "processor":
        level = "warning"
    needed = "" if chosen else "; without it, pictures of faces that have no photograph cannot be drawn (maps can)"
    return Finding(level, f"{probe.backend}: {probe.error}{needed}", _remedy(probe, surroundings))


def _of_choice(probes: Sequence[BackendProbe], chosen: BackendProbe | None, rasteriser: str) -> Iterator[Finding]:
    """Whether ``auto`` is the best choice: it knows what the driver can do, not how fast it is."""
    if chosen is not None and chosen.version_code < COMPUTE_VERSION:
        remedy = "none is needed: the processor draws the maps"
        yield Finding("note", f"{chosen.renderer} has no OpenGL 4.3: no compute shaders", remedy)
    usable = [probe for probe in probes if probe is chosen or probe.backend == PROCESSOR]
    right = {check.rasteriser: check.milliseconds for probe in usable for check in probe.checks if check.is_right}
    for other, milliseconds in right.items():
        if rasteriser in right and milliseconds * MUCH_FASTER < right[rasteriser]:
            times = f"{milliseconds:.1f} ms a picture, {rasteriser} {right[rasteriser]:.1f} ms"
            remedy = f"{RASTERISER_VARIABLE}={other}, or --rasteriser {other}"
            yield Finding("note", f"the rasteriser {other} is faster here: {times}", remedy)


def _of_checks(probe: BackendProbe, chosen_rasteriser: str) -> Iterator[Finding]:
    way = f"{RASTERISER_VARIABLE}={'compute' if probe.backend == PROCESSOR else 'processor'}"
    remedy = f"use another way to draw ({way}), and report this with the output of `datagen doctor --json`"
    for check in probe.checks:
        if not check.is_right:
            level: Level = "error" if check.rasteriser == chosen_rasteriser else "warning"
            where = f"{probe.backend}, {check.rasteriser} ({probe.renderer})" if probe.renderer else check.rasteriser
            yield Finding(level, f"{where}: {_deviation(check)}", remedy)


def _deviation(check: RenderCheck) -> str:
    if check.error:
        return f"draws nothing ({check.error})"
    return (
        f"expected the oracle's maps, found {check.mask_differs_px} of {check.mask_px} pixels of the mask different, "
        f"{check.off_px} more than {LIMIT_MM} mm off, 99.9 % up to {check.typical_worst_mm:.3g} mm"
    )


def _remedy(probe: BackendProbe, surroundings: Surroundings) -> str:
    """What to do where a backend makes no context."""
    if probe.error.startswith("device: "):
        remedy = f"choose one of the devices that are listed, or none (--device, {DEVICE_VARIABLE})"
    else:
        remedy = _lack_of_egl(surroundings) if probe.backend == "egl" else _lack_of_osmesa(surroundings)
    if surroundings.environment.get(ENVIRONMENT_VARIABLE) == probe.backend:
        remedy += f"; or unset {ENVIRONMENT_VARIABLE}, which allows {probe.backend} alone"
    return remedy


def _lack_of_osmesa(surroundings: Surroundings) -> str:
    if surroundings.complaints[OSMESA]:
        return "apt-get install libosmesa6 (Mesa 25.1 and newer have none: use EGL)"
    return "libOSMesa is there but makes no context of OpenGL 3.3: install a newer Mesa, or use EGL"


def _lack_of_egl(surroundings: Surroundings) -> str:
    """The most basic lack first."""
    if surroundings.complaints[EGL_LIBRARY]:
        return f"no libEGL ({surroundings.complaints[EGL_LIBRARY]}): apt-get install libegl1 libgl1 libgl1-mesa-dri"
    if surroundings.complaints[GL_LIBRARY]:
        return f"no libGL ({surroundings.complaints[GL_LIBRARY]}): apt-get install libgl1"
    if surroundings.missing_vendor_files:
        return f"{', '.join(surroundings.missing_vendor_files)} is not there: unset {VENDOR_VARIABLE} or correct it"
    if not surroundings.vendor_files:
        return "libEGL is there but no driver behind it: apt-get install libegl-mesa0 libgl1-mesa-dri"
    if surroundings.devices and not any(device.vendor for device in surroundings.devices):
        reinstall = "apt-get install --reinstall libegl-mesa0 libgl1-mesa-dri"
        return f"none of the drivers starts: {reinstall}; see the notes below"
    return (
        "reinstall the drivers (apt-get install --reinstall libegl1 libegl-mesa0 libgl1-mesa-dri), "
        "or draw on the processor with LIBGL_ALWAYS_SOFTWARE=1"
    )


def _of_surroundings(
    surroundings: Surroundings, chosen: BackendProbe | None, settings: GLSettings
) -> Iterator[Finding]:
    """What is installed but not used, and the other way round."""
    yield from _of_nvidia(surroundings)
    nodes, is_container = (*surroundings.render_nodes, *surroundings.nvidia_nodes), surroundings.is_container
    for node in nodes:
        if not node.is_open:
            remedy = f"add yourself to its group and log in again: sudo usermod -aG {node.group} $USER"
            if is_container:
                remedy = f"start the container with --group-add {node.group}, or as root"
            yield Finding("warning", f"{node.path}: no permission to use this GPU", remedy)
    if not nodes:
        remedy = "if the machine has a GPU, install its kernel driver"
        if is_container:
            remedy = "if the machine has a GPU, hand it to the container: --device /dev/dri (NVIDIA: --gpus all)"
        yield Finding("note", "no render node (/dev/dri/renderD*): everything is drawn on the processor", remedy)
    if surroundings.devices_error and not surroundings.complaints[EGL_LIBRARY]:
        what = f"EGL does not list its devices ({surroundings.devices_error})"
        yield Finding("warning", what, "install a newer libEGL")
    cards = [device for device in surroundings.devices if not device.is_software]
    listed = "; ".join(f"{device.index}: {device.description}" for device in cards)
    choose = f"with --device N or {DEVICE_VARIABLE}=N"
    if len(cards) > 1 and settings.device is None:
        yield Finding("note", f"several GPUs ({listed})", f"choose one {choose}")
    if cards and chosen and is_software_renderer(chosen.renderer):
        what = f"drawing is done on the processor, though there is a GPU ({listed})"
        remedy = f"choose it {choose}, or unset LIBGL_ALWAYS_SOFTWARE; the other findings may say why it is not used"
        yield Finding("warning", what, remedy)


def _of_nvidia(surroundings: Surroundings) -> Iterator[Finding]:
    has_library = not surroundings.complaints[NVIDIA_LIBRARY]
    if has_library and not any("nvidia" in path.lower() for path in surroundings.vendor_files):
        yield Finding(
            "warning",
            f"{NVIDIA_LIBRARY} is there, but no vendor file tells EGL of it: the GPU is not used",
            f"write {NVIDIA_VENDOR_CONTENT} to {NVIDIA_VENDOR_FILE}; if you may not, write it to a file of yours and "
            f"set {VENDOR_VARIABLE} to its path",
        )
    if surroundings.nvidia_nodes and not has_library:
        found = ", ".join(node.path for node in surroundings.nvidia_nodes)
        yield Finding(
            "warning",
            f"an NVIDIA GPU ({found}) without its OpenGL library {NVIDIA_LIBRARY}",
            "start the container with NVIDIA's runtime and NVIDIA_DRIVER_CAPABILITIES=all (or at least "
            "graphics,compute,utility); without graphics it gets CUDA but no OpenGL"
            if surroundings.is_container
            else "install the driver's OpenGL part (package libnvidia-gl-VERSION, VERSION that of the kernel module)",
        )
