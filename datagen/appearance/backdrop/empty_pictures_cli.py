"""The command ``datagen empty``, which draws pictures without people."""

from rich.console import Console

from datagen.appearance.backdrop.empty_pictures import draw_empty_picture
from datagen.datagen_config import EmptyConfig
from datagen.random_streams import generator_for
from pix2face.command_line import counted, prepare_output_folder, progress_bar, say
from pix2face.errors import UsageError
from pix2face.files.images import encode_photograph
from pix2face.files.writing import written_in_one_step

console = Console(stderr=True)


def empty(config: EmptyConfig) -> int:
    """Runs ``datagen empty``."""
    if config.n < 1 or config.size < 1 or config.seed < 0:
        raise UsageError(f"expected --n and --size of at least 1 and --seed of at least 0, found {config}")
    prepare_output_folder(config.out)
    with progress_bar(console, "drawing", config.n) as advance:
        for number in range(config.n):
            rng = generator_for(config.seed, f"empty/{number}")
            picture = draw_empty_picture(rng, config.size, held_out=config.held_out)
            with written_in_one_step(config.out / f"{number:06d}.jpg") as path:
                path.write_bytes(encode_photograph(picture))
            advance(1)
    say(console, f"{counted(config.n, 'picture')} -> {config.out}")
    return 0
