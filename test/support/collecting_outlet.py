"""An outlet that keeps what it is sent, and lets a test wait for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

Message = tuple[str, int, bytes]


class CollectingOutlet:
    """Keeps (topic, time_ns, bytes) of every message; `unwanted` topics are not asked for."""

    def __init__(self, unwanted: Iterable[str] = ()) -> None:
        self.messages: list[Message] = []
        self.unwanted = set(unwanted)
        self.on_send: Callable[[str, int], None] = lambda topic, time_ns: None
        self._changed = threading.Condition()

    def wants(self, topic: str) -> bool:
        return topic not in self.unwanted

    def send(self, topic: str, time_ns: int, message: bytes) -> None:
        self.on_send(topic, time_ns)
        with self._changed:
            self.messages.append((topic, time_ns, message))
            self._changed.notify_all()

    def of(self, topic: str) -> list[tuple[int, bytes]]:
        """Stamp and bytes of every message of `topic`."""
        return [(time_ns, message) for name, time_ns, message in self.messages if name == topic]

    def wait_for(self, topic: str, count: int) -> None:
        """Wait until there are that many messages of `topic`."""
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.of(topic)) >= count, 20.0), (
                f'{len(self.of(topic))} of {count} messages of {topic} came in 20 s'
            )
