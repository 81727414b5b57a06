"""Headers of the files from which trainings go on, where they are not what the project writes."""

from pathlib import Path
from typing import Any

import pytest

from pix2face.errors import InputFileError
from pix2face.inference.torch_networks import write_tensors
from training.loop.resume import METADATA_KEY, SCHEMA_VERSION, steps_done

HEADER = {"schema_version": SCHEMA_VERSION, "configuration": "{}", "step": 3, "best": None}


def written(folder: Path, **changes: Any) -> Path:
    write_tensors(folder / "state", METADATA_KEY, HEADER | changes, {})
    return folder / "state"


def test_a_sound_header_is_read(tmp_path: Path) -> None:
    assert steps_done(written(tmp_path), '{"norm_batches": 0}') == 3


@pytest.mark.parametrize(
    "changes",
    [
        {"configuration": "no JSON"},
        {"configuration": "[1]"},
        {"configuration": '{"a":' * 900 + "1" + "}" * 900},
        {"configuration": None},
        {"step": "3"},
        {"step": -1},
        {"step": 1.5},
        {"best": []},
        {"best": "low"},
    ],
)
def test_headers_of_other_types_are_refused_in_one_line(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(InputFileError, match=r"^.*state: expected the state of this training.*--restart starts anew$"):
        steps_done(written(tmp_path, **changes), "{}")
