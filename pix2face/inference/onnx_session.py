"""Opens networks in the format ONNX with onnxruntime, on the CPU."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import final

import onnxruntime
from jaxtyping import Float32
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.opening import is_regular, read_regular

LARGEST_FILE_BYTES = 1 << 30  # larger weights lie in a file of their own, which is not read
ERRORS_ONLY = 3
# Threads of a network. As for other libraries, OMP_NUM_THREADS sets them. onnxruntime's own choice, 0, would bind
# threads to cores, which fails with a message where a container has only some of them.
_given = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()  # a list has one for each nested level
_threads = (int(_given) if _given.isdecimal() else 0) or len(os.sched_getaffinity(0))


@final
class OnnxSession:
    """A network that is ready to run.

    Args:
        content: An ONNX file.

    Raises:
        ValueError: It is none.
    """

    def __init__(self, content: bytes) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = _threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads leave the cores alone
        options.log_severity_level = ERRORS_ONLY
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # the runtime's errors have no base of their own
            raise ValueError(str(error)) from error
        self._outputs = [output.name for output in self._session.get_outputs()]

    @property
    def metadata(self) -> Mapping[str, str]:
        """What the file says of itself."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    @property
    def shapes(self) -> dict[str, list[int | str]]:
        """The shapes of inputs and outputs by name, without the size of the batch."""
        return {own.name: own.shape[1:] for own in (*self._session.get_inputs(), *self._session.get_outputs())}

    def run(self, inputs: Mapping[str, Float32[ndarray, "..."]]) -> dict[str, Float32[ndarray, "..."]]:
        """Returns all outputs by name, from all inputs by name."""
        return dict(zip(self._outputs, self._session.run(self._outputs, dict(inputs)), strict=True))


def open_onnx(path: Path) -> OnnxSession:
    """Opens an ONNX file.

    Raises:
        InputFileError: It is missing, or no ONNX file.
    """
    if not is_regular(path):
        raise InputFileError(f"{path}: no such file; `pix2face export` writes ONNX files")
    try:
        return OnnxSession(read_regular(path, "an ONNX file", LARGEST_FILE_BYTES))
    except ValueError as error:
        raise InputFileError(f"{path}: expected an ONNX file, found one that cannot be read ({error})") from error


def keep_networks_in_one_thread() -> None:
    """Lets networks that are opened from now on use the calling thread alone: other threads use the cores."""
    global _threads  # noqa: PLW0603 (a setting of the process, as the number of its cores is)
    _threads = 1
