"""Iterators that compute in threads, so that the next frames are decoded while others are processed."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

# Faces in one batch of the network. Larger batches are hardly faster.
FACES_AT_A_TIME = 4


def ahead(items: Iterable[Item], count: int) -> Iterator[Item]:
    """Yields the same items in the same order. A thread computes up to ``count`` of them in advance.

    An exception of the iterable is raised where its item would be. The thread ends with the iterator.
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
    """Yields the function's results in the order of the items. Two threads compute a few of them in advance.

    An exception of the function or of the iterable is raised where its result would be.
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
    """Yields lists of ``FACES_AT_A_TIME`` items; the last may be shorter."""
    iterator = iter(items)
    while chunk := list(islice(iterator, FACES_AT_A_TIME)):
        yield chunk
