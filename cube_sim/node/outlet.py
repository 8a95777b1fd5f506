"""Where the messages of the run go: to ROS, and to the bag that is being recorded."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher

from cube_sim.recording import Recorder
from cube_sim.simulation.simulation import CLOCK, CONTACTS, MARKERS


class NodeOutlet:
    """Publishes the bytes of messages, and records the very same bytes."""

    def __init__(self, *, publish_clock: bool, record_markers: bool) -> None:
        """Start without publishers; the node adds them, before the simulation sends."""
        self.publishers: dict[str, Publisher] = {}
        self.record_markers = record_markers
        self._publish_clock = publish_clock
        self._recorder: Recorder | None = None
        self._recorded_names: dict[str, str] = {}

    @property
    def recorder(self) -> Recorder | None:
        """What records now, if anything does."""
        return self._recorder

    def attach(
        self, recorder: Recorder, names: dict[str, str], time_ns: int, latched: list[Any]
    ) -> None:
        """Record from `time_ns` on, the latched messages first; `names` are the resolved ones."""
        self._recorder = recorder
        self._recorded_names = names
        for topic, message in latched:
            recorder.write(names[topic], time_ns, message)

    def detach(self) -> Recorder | None:
        """Stop to hand messages to the recorder, and return it; it is still to be closed."""
        recorder, self._recorder = self._recorder, None
        return recorder

    def wants(self, topic: str) -> bool:
        """Say whether anyone takes `topic` now."""
        if topic == CLOCK and not self._publish_clock:
            return False
        if self._recorded(topic):
            return True
        return bool(self.publishers[topic].get_subscription_count() > 0)

    def send(self, topic: str, time_ns: int, message: bytes) -> None:
        """Publish a message, and record it."""
        self.publishers[topic].publish(message)
        self.record(topic, time_ns, message)

    def record(self, topic: str, time_ns: int, message: bytes) -> None:
        """Record a message that others have published."""
        if self._recorder is not None and self._recorded(topic):
            self._recorder.write(self._recorded_names[topic], time_ns, message)

    def _recorded(self, topic: str) -> bool:
        """Say whether a bag takes `topic` now: contacts never, markers on wish."""
        if self._recorder is None or topic == CONTACTS:
            return False
        return topic != MARKERS or self.record_markers
