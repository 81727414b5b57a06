"""The command ``datagen doctor``: which OpenGL a machine has, whether it draws correctly, and what to do if not."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace

from rich.console import Console
from rich.table import Table

from datagen.datagen_config import DoctorConfig
from datagen.doctor.doctor import Diagnosis, diagnose
from datagen.doctor.gl_probe import PROCESSOR, BackendProbe, devices_apart, probe_backend_apart
from datagen.doctor.gl_surroundings import Surroundings, survey, versions
from datagen.opengl.gl_context import BACKENDS, GLSettings
from pix2face.command_line import EXIT_ERROR, progress_bar, say

console = Console(stderr=True)


def doctor(config: DoctorConfig) -> int:
    """Runs ``datagen doctor``."""
    settings = GLSettings(config.gl, config.device, config.rasteriser).resolved()
    with progress_bar(console, "probing", 2 + len(BACKENDS)) as advance:
        surroundings = survey(devices_apart())
        advance()
        probes = []
        for backend in (*BACKENDS, PROCESSOR):
            device = settings.device if backend == "egl" else None
            probes.append(probe_backend_apart(replace(settings, backend=backend, device=device, rasteriser="auto")))
            advance()
    diagnosis = diagnose(surroundings, probes, settings)
    if config.json:
        found = {
            "healthy": diagnosis.is_healthy,
            "settings": asdict(settings),
            "diagnosis": asdict(diagnosis),
            "backends": [asdict(probe) for probe in probes],
            "surroundings": asdict(surroundings),
            "versions": versions(),
        }
        print(json.dumps(found, indent=2))
    else:
        _show(Console(), surroundings, probes, diagnosis)
    return 0 if diagnosis.is_healthy else EXIT_ERROR


def _show(out: Console, surroundings: Surroundings, probes: Sequence[BackendProbe], diagnosis: Diagnosis) -> None:
    say(out, "versions: " + ", ".join(f"{name} {number}" for name, number in versions().items()))
    for device in surroundings.devices:
        say(out, f"EGL device {device.index}: {device.description}")
    for name, value in surroundings.environment.items():
        say(out, f"{name}={value}")
    table = Table(
        "drawn by", "rasteriser", "mask px", "differ", "> 0.02 mm", "99.9 %, mm", "ms", title="against the oracle"
    )
    for probe in probes:
        if probe.renderer:
            say(out, f"{probe.backend}: {probe.renderer}, OpenGL {probe.gl_version}")
        for check in probe.checks:
            pixels = [str(number) for number in (check.mask_px, check.mask_differs_px, check.off_px)]
            shown = [*pixels, f"{check.typical_worst_mm:.2g}", f"{check.milliseconds:.1f}"]
            table.add_row(probe.backend, check.rasteriser, *(["draws nothing"] if check.error else shown))
    if table.row_count:
        out.print(table)
    for finding in diagnosis.findings:
        say(out, f"{finding.level}: {finding.what}")
        if finding.remedy:
            say(out, f"  remedy: {finding.remedy}")
    if diagnosis.rasteriser:
        say(out, f"draws maps with the rasteriser {diagnosis.rasteriser} ({diagnosis.reason})")
    say(out, f"draws pictures with OpenGL by {diagnosis.backend}" if diagnosis.backend else "cannot draw pictures")
    say(out, "healthy" if diagnosis.is_healthy else "not healthy: see the errors above")
