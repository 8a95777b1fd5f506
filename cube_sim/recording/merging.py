"""Messages of many chunks in order of time, with few chunks in memory."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

# Chunks whose times overlap are held in memory together up to this sum, B; beyond it, those that
# are not needed for longest are dropped and read again when their turn comes.
MOST_LOADED_BYTES = 1 << 26


class RecordedMessage(NamedTuple):
    """A message as a bag holds it."""

    topic: str
    time_ns: int
    """Log time."""
    data: bytes | memoryview
    """CDR with encapsulation."""


@dataclass(frozen=True)
class Part:
    """A chunk to be merged."""

    order: int
    """Its number in the order of writing."""
    first_ns: int
    last_ns: int
    size: int
    """B in memory."""
    load: Callable[[], list[RecordedMessage]]
    """Reads its messages in order of time, those of equal time in order of writing."""


class _Cursor:
    """A part that is begun: what of it is next, and its messages if they are in memory."""

    def __init__(self, part: Part) -> None:
        self.part = part
        self.messages: list[RecordedMessage] | None = part.load()
        self.at = 0
        self.count = len(self.messages)

    def loaded(self) -> list[RecordedMessage]:
        if self.messages is None:
            self.messages = self.part.load()
        return self.messages


_Entry = tuple[int, int, _Cursor]


def merged(parts: Sequence[Part], most_bytes: int = MOST_LOADED_BYTES) -> Iterator[RecordedMessage]:
    """Yield all messages in order of time, those of equal time in the order of writing."""
    waiting = sorted(parts, key=lambda part: (part.first_ns, part.order), reverse=True)
    open_parts: list[_Entry] = []  # a heap: time and order of what comes next, and from where
    while waiting or open_parts:
        # Whatever may hold a message as early as the next one must be open.
        while waiting and (not open_parts or waiting[-1].first_ns <= open_parts[0][0]):
            part = waiting.pop()
            cursor = _Cursor(part)
            alone = not waiting or part.last_ns < waiting[-1].first_ns
            if alone and not open_parts:
                yield from cursor.loaded()
                continue
            _push(open_parts, cursor)
            _unload(open_parts, most_bytes)
        if open_parts:
            yield from _earliest(open_parts, waiting[-1].first_ns if waiting else None)


def _earliest(open_parts: list[_Entry], before_ns: int | None) -> Iterator[RecordedMessage]:
    """Yield from the part that is next, until another is, or one that starts at `before_ns`."""
    time_ns, order, cursor = heapq.heappop(open_parts)
    messages = cursor.loaded()
    end = cursor.count
    at = cursor.at
    other = open_parts[0] if open_parts else None
    while True:
        yield messages[at]
        at += 1
        if at == end:
            return
        time_ns = messages[at].time_ns
        if other is not None and (time_ns, order) > other[:2]:
            break
        if before_ns is not None and time_ns >= before_ns:
            break
    cursor.at = at
    _push(open_parts, cursor)


def _push(open_parts: list[_Entry], cursor: _Cursor) -> None:
    if cursor.at < cursor.count:
        next_ns = cursor.loaded()[cursor.at].time_ns
        heapq.heappush(open_parts, (next_ns, cursor.part.order, cursor))


def _unload(open_parts: list[_Entry], most_bytes: int) -> None:
    """Drop the memory of those parts that are needed last, if all together are too large."""
    loaded = [entry for entry in open_parts if entry[2].messages is not None]
    excess = sum(entry[2].part.size for entry in loaded) - most_bytes
    if excess <= 0:
        return
    for _, _, cursor in sorted(loaded[1:], key=lambda entry: entry[:2], reverse=True):
        cursor.messages = None
        excess -= cursor.part.size
        if excess <= 0:
            break


def in_order(messages: list[RecordedMessage]) -> list[RecordedMessage]:
    """Return them sorted by time, which they mostly are already."""
    times = [message.time_ns for message in messages]
    if any(later < earlier for earlier, later in itertools.pairwise(times)):
        return sorted(messages, key=lambda message: message.time_ns)
    return messages
