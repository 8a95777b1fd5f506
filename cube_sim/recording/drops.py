"""What a recording lacks: how many messages, of which topics, and when."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

# Drops closer to each other than this are one gap, ns of simulation time.
_JOINED_NS = 1_000_000_000
# A bag names no more gaps than this; those that are nearest to each other become one.
_MOST_GAPS = 100


@dataclass(frozen=True)
class Gap:
    """A span of log time in which messages were dropped; others in it may have been kept."""

    start_ns: int
    """Log time of the earliest message that is missing."""
    end_ns: int
    """Log time of the latest one."""
    messages: int
    """How many are missing."""


class DropLog:
    """The messages that are not in a bag. Any thread may add to it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._gaps: list[Gap] = []
        self._counts: Counter[str] = Counter()
        self._total = 0

    @property
    def total(self) -> int:
        """How many there are."""
        return self._total

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """When they were due, in order of time."""
        with self._lock:
            return tuple(self._gaps)

    def add(self, first_ns: int, last_ns: int, counts: Mapping[str, int]) -> bool:
        """Note messages (topic: number) of these log times; True if a new gap begins with them."""
        messages = sum(counts.values())
        if not messages:
            return False
        with self._lock:
            self._counts.update(counts)
            self._total += messages
            last = self._gaps[-1] if self._gaps else None
            if last and last.start_ns <= first_ns <= last.end_ns + _JOINED_NS:
                # By far the most frequent case, and it comes between two steps of the simulation.
                self._gaps[-1] = _union(last, Gap(first_ns, last_ns, messages))
                return False
            before = len(self._gaps)
            self._gaps = _joined([*self._gaps, Gap(first_ns, last_ns, messages)])
            return len(self._gaps) > before

    def add_undated(self, messages: int) -> None:
        """Note messages of which nothing but their number is known."""
        with self._lock:
            self._total += messages

    def notes(self) -> dict[str, str]:
        """Return the entries for a bag's metadata.

        drops: how many messages are missing. Only if any are, and as JSON: gaps, a list of [first
        ns, last ns, messages]; drops_by_topic, an object of topic and messages.
        """
        with self._lock:
            notes = {'drops': str(self._total)}
            if self._gaps:
                rows = [[gap.start_ns, gap.end_ns, gap.messages] for gap in self._gaps]
                notes['gaps'] = json.dumps(rows)
                notes['drops_by_topic'] = json.dumps(dict(sorted(self._counts.items())))
        return notes


def _joined(gaps: list[Gap]) -> list[Gap]:
    """Return the gaps in order of time, those that belong together as one."""
    found: list[Gap] = []
    for gap in sorted(gaps, key=lambda gap: gap.start_ns):
        if found and gap.start_ns - found[-1].end_ns <= _JOINED_NS:
            found[-1] = _union(found[-1], gap)
        else:
            found.append(gap)
    while len(found) > _MOST_GAPS:
        nearest = min(range(1, len(found)), key=lambda i: found[i].start_ns - found[i - 1].end_ns)
        found[nearest - 1 : nearest + 1] = [_union(found[nearest - 1], found[nearest])]
    return found


def _union(one: Gap, two: Gap) -> Gap:
    return Gap(
        min(one.start_ns, two.start_ns),
        max(one.end_ns, two.end_ns),
        one.messages + two.messages,
    )
