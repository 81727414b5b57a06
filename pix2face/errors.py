"""The exceptions that the project raises on purpose.

The command lines turn each of them into one line and an exit status. A message says what was expected, what was found,
where, and what to do.
"""


class Pix2FaceError(Exception):
    """Base of everything that is the fault of input or surroundings, not of the code."""


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
    """One sample cannot be used. It is listed with its reason; the job goes on."""
