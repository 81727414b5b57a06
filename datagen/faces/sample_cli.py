"""The commands ``datagen sample``, a table of plausible faces, and ``datagen appearance``, how they are drawn."""

from rich.console import Console

from datagen.appearance.appearance_config import load_configuration, to_toml
from datagen.datagen_config import SampleConfig, ShowConfig
from datagen.sampling.faces import sample_faces
from pix2face.command_line import check_output_file, counted, say
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models.morphable_model import open_model

console = Console(stderr=True)


def sample(config: SampleConfig) -> int:
    """Runs ``datagen sample``."""
    check_output_file(config.out, (".h5",))
    geometry = load_configuration(config.appearance).geometry
    table = sample_faces(open_model(config.model), config.n, config.seed, config.size, geometry)
    save_coefficients(table, config.out)
    say(console, f"{counted(len(table), 'face')} of {table.model_name} -> {config.out}")
    say(console, f"next: datagen render --coeffs {config.out} --out shards/")
    return 0


def appearance(config: ShowConfig) -> int:
    """Runs ``datagen appearance``."""
    print(to_toml(load_configuration(config.appearance)), end="")
    return 0
