"""What a training is going to do, in a few lines."""

from pathlib import Path

from rich.text import Text

from pix2face.command_line import counted, printable
from pix2face.inference import CHECKPOINT_NAME
from training.data.shard_index import ShardIndex
from training.loop.speed import duration_in_words, seconds_per_image
from training.loop.trainer import Surroundings
from training.recipe.recipe import Recipe
from training.train_config import TrainConfig


def summary(
    config: TrainConfig, recipe: Recipe, shards: ShardIndex, surroundings: Surroundings, out: Path, done: int
) -> Text:
    """Samples, model, plan and time; the time is measured by some steps of a network that is thrown away.

    Args:
        config: The command line.
        recipe: That it stands for.
        shards: The samples.
        surroundings: Where.
        out: What is written to.
        done: Samples seen by what goes on.
    """
    images = recipe.steps * recipe.batch_size - done
    seconds = images * seconds_per_image(recipe, surroundings.device) if images else 0.0
    lines = {
        "samples": shards.description,
        "model": f"{shards.model_name} ({shards.model_sha256[:12]})",
        "terms": shards.licence,
        "scales": f"PNCC {shards.pncc_scale_mm:.0f} mm, offset {shards.offset_scale_mm:.0f} mm",
        "preset": f"{config.preset}: {recipe.architecture}, {recipe.size_px} px, {counted(recipe.filters, 'filter')}, "
        f"{recipe.planes} planes, batches of {recipe.batch_size}, {recipe.precision}",
        "plan": f"{counted(recipe.epochs, 'epoch')} of {counted(recipe.epoch_size, 'picture')}"
        + (f", {done // (recipe.epoch_steps * recipe.batch_size)} done" if done else ""),
        "takes": f"about {duration_in_words(seconds)} on {surroundings.device}, if loading keeps up",
        "writes": str(out / CHECKPOINT_NAME),
    }
    return Text("\n".join(f"{name:<8} {printable(text)}" for name, text in lines.items()))
