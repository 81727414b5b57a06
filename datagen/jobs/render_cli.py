"""The command ``datagen render``."""

from dataclasses import replace
from pathlib import Path

from rich.console import Console

from datagen.appearance.appearance_config import DEFAULT, PLAIN, PRESETS, AppearanceConfig, load_configuration
from datagen.appearance.backdrop.picture_folder import list_pictures
from datagen.datagen_config import RenderConfig
from datagen.jobs.executors import DaskCluster, ProcessPool, WorkPlace
from datagen.jobs.folder_lock import UNFINISHED_SHARDS
from datagen.jobs.pipeline import JobSummary, Listener, OpenedJob, open_job, reopened, run_job
from datagen.jobs.render_job import RenderJob
from datagen.models.model_cli import describe
from datagen.opengl.gl_context import GLSettings
from datagen.opengl.rasteriser_choice import has_gpu_files
from datagen.rendering.processor.processor_maps import prepare
from datagen.samples.baked_jitter import JitterBake, ViewMaker
from pix2face.command_line import (
    EXIT_REJECTED,
    REJECTED_FILE,
    check_max_rejected,
    counted,
    prepare_output_folder,
    progress_bar,
    say,
)
from pix2face.errors import UsageError
from pix2face.geometry.jitter import JitterRange
from pix2face.models import BUILTIN_MODEL
from pix2face.shards.layers import ALL_LAYERS, DEFAULT_LAYERS, SCENE_LAYERS, SEEN, order_layers, parse_layers
from pix2face.stop_signals import StoppedBySignal, stopping_on_signals

console = Console(stderr=True)


def render(config: RenderConfig) -> int:
    """Runs ``datagen render``."""
    with stopping_on_signals():
        try:
            return _render(config)
        except StoppedBySignal as stop:
            n_kept, n_left = (len(list(config.out.glob(pattern))) for pattern in ("shard-*.h5", UNFINISHED_SHARDS))
            left = f"{counted(n_left, 'unfinished file')} (.part)" if n_left else "nothing unfinished"
            say(
                console,
                f"stopped by {stop}: {counted(n_kept, 'finished shard')} kept in {config.out}, left behind: {left}; "
                "run the same command again to go on",
            )
            return stop.exit_status


def _render(config: RenderConfig) -> int:
    check_max_rejected(config.max_rejected)
    if config.workers < 1 or config.shard_size < 1 or config.seed < 0:
        raise UsageError(
            "expected --workers and --shard-size of at least 1 and --seed of at least 0, "
            f"found {config.workers}, {config.shard_size} and {config.seed}"
        )
    gl = GLSettings(config.gl, config.device, config.rasteriser)
    rasteriser = gl.resolved().rasteriser  # contradictions are found here, not by every worker
    place: WorkPlace = ProcessPool(config.workers) if config.scheduler is None else DaskCluster(config.scheduler)
    jitter = JitterBake(config.jitter, config.jitter_size, JitterRange(mirror=config.jitter_mirror))
    jitter.check()
    opened = _open(config, jitter)
    ViewMaker(opened.model, jitter, config.seed)  # what the model does not allow is found here, not by every worker
    _introduce(config, opened)
    prepare_output_folder(config.out)
    if config.scheduler is None and (rasteriser == "processor" or (rasteriser == "auto" and not has_gpu_files())):
        message = "compiling the rasteriser for this processor, which takes some seconds at the first start"
        prepare(opened.model, opened.job.layers, lambda: say(console, message))
    with progress_bar(console, "rendering", len(opened.source.sample_ids)) as advance:
        listener = Listener(
            on_kept=lambda n: advance(n, already_done=True),
            on_progress=advance,
            on_notice=lambda text: say(console, text),
        )
        summary = run_job(opened, config.out, place, gl, listener)
    return _report(summary, config)


def _open(config: RenderConfig, jitter: JitterBake) -> OpenedJob:
    """Opens a job; what it draws where nothing is said depends on model and faces."""
    given = None if config.appearance is None else load_configuration(config.appearance)
    # A layer that there is not is found before long files are read.
    parse_layers(ALL_LAYERS if config.layers is None else config.layers)
    job = RenderJob(config.coeffs, config.model, config.seed, config.shard_size, (), jitter, is_plain=config.plain)
    opened = open_job(job)
    has_photographs = opened.source.has_photographs
    if has_photographs and given is not None:
        raise UsageError(f"--appearance: expected faces without photographs, found photographs in {config.coeffs}")
    appearance = given or PRESETS[PLAIN if has_photographs or config.model != BUILTIN_MODEL else DEFAULT]
    appearance = _with_backgrounds(appearance, config.backgrounds)
    layers = _layers(config.layers, has_scene=not appearance.is_plain)
    return reopened(opened, appearance, layers)


def _with_backgrounds(appearance: AppearanceConfig, folder: Path | None) -> AppearanceConfig:
    if folder is None:
        return appearance
    if appearance.is_plain:
        raise UsageError(f"--backgrounds: expected synthetic photographs, found the appearance {PLAIN}")
    list_pictures(str(folder))  # what is no picture is found before anything is drawn
    return replace(appearance, backdrop=replace(appearance.backdrop, folder=str(folder)))


def _layers(text: str | None, *, has_scene: bool) -> tuple[str, ...]:
    if text is None:
        return order_layers((*DEFAULT_LAYERS, SEEN) if has_scene else DEFAULT_LAYERS)
    layers = parse_layers(text)
    if text.strip() == ALL_LAYERS and not has_scene:
        return tuple(name for name in layers if name not in SCENE_LAYERS)
    return layers


def _introduce(config: RenderConfig, opened: OpenedJob) -> None:
    n_faces = counted(len(opened.source.sample_ids), "face")
    say(console, f"{n_faces} in {config.coeffs}; model: {describe(opened.model)}")
    if config.coeffs.is_dir() and config.model == BUILTIN_MODEL:
        say(
            console,
            "the coefficients are BFM's: the built-in model is fitted to the landmarks of the files instead "
            "(have BFM 2009? datagen model import, then --model)",
        )


def _report(summary: JobSummary, config: RenderConfig) -> int:
    kept = f" ({summary.n_shards_kept} there already)" if summary.n_shards_kept else ""
    made = f"{counted(summary.n_triplets, 'triplet')} in {counted(summary.n_shards, 'shard')}"
    say(console, f"{made}{kept} -> {config.out}")
    if summary.rejected:
        say(
            console,
            f"{counted(len(summary.rejected), 'sample')} rejected, listed in {config.out / REJECTED_FILE}; the first:",
        )
        say(console, f"  {summary.rejected[0][1]}")
    say(console, f"next: datagen preview {config.out}; train --shards {config.out}")
    return EXIT_REJECTED if len(summary.rejected) > config.max_rejected else 0
