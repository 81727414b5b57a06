"""Commands that cannot write to their folder say so in one line, before they do anything else.

The folder is mounted read-only, since modes do not bind the superuser. All commands run in one process, which the test
starts: `python -m tests.test_read_only_folder OUT GIVEN`.
"""

import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import datagen.cli
import pix2face.commands.cli
import pix2face.evaluation.cli
from datagen.sampling.faces import sample_faces
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models.morphable_model import builtin_model
from tests.mounts import with_mount
from tests.pix2face.benchmark_files import write_photograph, write_pts

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "datagen render --coeffs {given}/faces.h5 --out {out}/shards": datagen.cli.main,
    "datagen sample --n 1 --out {out}/faces.h5": datagen.cli.main,
    "pix2face fit {given}/photograph.jpg --out {out}/fits": pix2face.commands.cli.main,
    "pix2face predict {given}/photograph.jpg --out {out}/maps": pix2face.commands.cli.main,
    "pix2face export --out {out}/network.onnx": pix2face.commands.cli.main,
    "evaluate --split ibug --data {given} --out {out}/report --allow-missing": pix2face.evaluation.cli.main,
}


def test_a_folder_that_cannot_be_written_to_is_one_line(tmp_path: Path) -> None:
    out = tmp_path / "read only"
    out.mkdir()
    save_coefficients(sample_faces(builtin_model(), 1, 0, 32), tmp_path / "faces.h5")
    write_photograph(tmp_path / "photograph.jpg")
    write_photograph(tmp_path / "ibug" / "image_003_1.jpg")
    write_pts(tmp_path / "ibug" / "image_003_1.pts", np.arange(136.0).reshape(68, 2))
    command = [sys.executable, "-m", "tests.test_read_only_folder", str(out), str(tmp_path)]
    mount = with_mount(f"mount -t tmpfs -o ro none '{out}'")
    done = subprocess.run([*mount, *command], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    for call, (status, said) in json.loads(done.stdout).items():
        line = said.splitlines()[-1]
        assert status == 2, call
        assert line.startswith(f"{call.split()[0]}: error: {out}"), call
        assert ": expected a folder that can be written to, found" in line, call
        assert "Traceback" not in said, call


def run_commands(out: str, given: str) -> None:
    """Prints for each of the commands its exit status and what it says."""
    found = {}
    for call, main in COMMANDS.items():
        words = [word.format(out=out, given=given) for word in call.split()]
        with contextlib.redirect_stderr(io.StringIO()) as said:
            status = main(words[1:])
        found[call] = status, said.getvalue()
    print(json.dumps(found))  # noqa: T201


if __name__ == "__main__":
    run_commands(*sys.argv[1:])
