"""Work of the passes over a clip that goes on at the same time: frames are decoded while others are looked at."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

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


def mapped(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """The results of a function in the order of its items, computed by two threads for a few items at a time.

    An exception of the function or of the items comes in its turn.
    """
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(2) as threads:
        try:
            for item in items:
                waiting.append(threads.submit(function, item))
                if len(waiting) > FACES_AT_A_TIME:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for own in waiting:
                own.cancel()


def in_chunks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Lists of as many items as are looked at together."""
    iterator = iter(items)
    while chunk := list(islice(iterator, FACES_AT_A_TIME)):
        yield chunk
