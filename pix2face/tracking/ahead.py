"""Work of the passes over a clip that goes on at the same time: frames are decoded while others are looked at."""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")

# Faces that are in the network at a time. The network is hardly faster with more.
FACES_AT_A_TIME = 4


def ahead(items: Iterable[Item], count: int) -> Iterator[Item]:
    """The same items in the same order, each made by a thread of its own before it is asked for.

    At most ``count`` items wait at a time. An exception of the items comes in its turn. The thread ends with the
    iterator.
    """
    iterator, end = iter(items), object()
    with ThreadPoolExecutor(1) as thread:
        waiting = deque(thread.submit(next, iterator, end) for _ in range(count))
        try:
            while (item := waiting.popleft().result()) is not end:
                waiting.append(thread.submit(next, iterator, end))
                yield item  # type: ignore[misc]
        finally:
            for own in waiting:
                own.cancel()


def in_chunks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Lists of as many items as are looked at together."""
    iterator = iter(items)
    while chunk := list(islice(iterator, FACES_AT_A_TIME)):
        yield chunk
