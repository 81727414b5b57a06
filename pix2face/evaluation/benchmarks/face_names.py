"""Which face of a benchmark a name in somebody's file means: its full name, or as much of it as tells it apart."""

from collections.abc import Sequence
from pathlib import PurePosixPath

from pix2face.errors import UsageError

N_NAMES_SHOWN = 3


def match_names(given: Sequence[str], known: Sequence[str], whose: str) -> dict[str, int]:
    """For each known name that is given the place at which it is.

    A name may be given in full ("ibug/image_003_1.jpg"), without its folder, without its ending, or without both.

    Args:
        given: Names in a file, all different.
        known: Full names of the benchmark's faces.
        whose: The benchmark, for messages.

    Raises:
        UsageError: A name belongs to no face, to several, or two belong to the same.
    """
    full_names = _by_alias(known)
    unknown = [name for name in given if name not in full_names]
    if unknown:
        shown = ", ".join(repr(name) for name in unknown[:N_NAMES_SHOWN])
        raise UsageError(
            f"expected names of {whose} such as {known[0]!r} or {PurePosixPath(known[0]).stem!r}, found {shown}"
            + (f" and {len(unknown) - N_NAMES_SHOWN} more" if len(unknown) > N_NAMES_SHOWN else "")
        )
    places: dict[str, int] = {}
    for place, name in enumerate(given):
        meant = full_names[name]
        if len(meant) > 1:
            raise UsageError(
                f"expected names that tell the faces of {whose} apart, found {name!r}, which may be {meant[0]!r} or "
                f"{meant[1]!r}; give it in full"
            )
        if meant[0] in places:
            raise UsageError(
                f"expected each face of {whose} once, found {meant[0]!r} as {given[places[meant[0]]]!r} and as {name!r}"
            )
        places[meant[0]] = place
    return places


def _by_alias(known: Sequence[str]) -> dict[str, list[str]]:
    full_names: dict[str, list[str]] = {name: [name] for name in known}
    for name in known:
        path = PurePosixPath(name)
        for alias in {path.name, path.stem, str(path.with_suffix(""))} - set(known):
            full_names.setdefault(alias, []).append(name)
    return full_names
