"""The exceptions that the project raises on purpose.

The command lines turn each of them into one line and an exit status. A message says what was expected, what was found,
where, and what to do.
"""

import errno

# Numbers of the OSError of a write that the disk or a limit does not allow.
WRITE_ERRORS = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO, errno.EROFS)
# A message may quote a file, whose names and numbers may be of any length.
LONGEST_MESSAGE = 2000


class Pix2FaceError(Exception):
    """Base class of all errors that are caused by input or environment, not by the code."""

    def __str__(self) -> str:
        text = super().__str__()
        return text if len(text) <= LONGEST_MESSAGE else f"{text[: LONGEST_MESSAGE - 500]} ... {text[-500:]}"


class InputFileError(Pix2FaceError):
    """A file is missing, truncated, foreign, or of a schema that this version does not know."""


class DegenerateGeometryError(Pix2FaceError):
    """Too few points, or points in a configuration that does not determine the answer."""


class ModelMismatchError(Pix2FaceError):
    """Shards, coefficients or a checkpoint belong to another morphable model than the one in use."""


class GLUnavailableError(Pix2FaceError):
    """No OpenGL context could be made."""


class UsageError(Pix2FaceError):
    """Something is wrong with the call as a whole."""


class SampleRejectedError(Pix2FaceError):
    """One sample cannot be used. It is listed with its reason, and the job continues."""
