"""Records in the background, so that a slow disk never holds up the caller."""

from __future__ import annotations

import builtins
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from cube_sim.recording.bag import BagWriter
from cube_sim.recording.errors import RecordingError
from cube_sim.recording.mcap_file import Compression
from cube_sim.recording.topic import Topic

QUEUE_BYTES = 64 * 1024 * 1024
# What a queued message costs beside its data, so that many small ones are bounded too.
_MESSAGE_COST_BYTES = 256


class Recorder:
    """Writes a bag from a thread of its own, behind a queue that is bounded in bytes.

    The order of the messages is that of the `write` calls. Where chunks end depends on the time
    of writing too (flush_period); with `flush_period=math.inf` the same calls make the same bytes.
    """

    def __init__(
        self,
        directory: Path,
        topics: Sequence[Topic],
        *,
        on_error: Callable[[str], None],
        queue_bytes: int = QUEUE_BYTES,
        flush_period: float = 0.5,
        compression: Compression = 'none',
    ) -> None:
        """Create the bag `directory` and start.

        on_error: is given one message, from the recorder's thread, if recording has to stop.
        queue_bytes: B of messages that may wait; a message above it is dropped.
        flush_period: s of wall time, the most that a killed process loses.
        Raises RecordingError as BagWriter does.
        """
        self._bag = BagWriter(directory, topics, compression=compression)
        self._on_error = on_error
        self._queue_bytes = queue_bytes
        self._flush_period = flush_period
        self._wake = threading.Condition()
        # Guarded by _wake:
        self._queue: deque[tuple[str, int, builtins.bytes]] = deque()
        self._queued_bytes = 0
        self._refused = 0
        self._closing = False
        self._error: str | None = None
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The bag's directory."""
        return self._bag.path

    @property
    def messages(self) -> int:
        """Messages in the bag so far."""
        return self._bag.messages

    @property
    def bytes(self) -> int:
        """Sum of the sizes of these messages, B."""
        return self._bag.bytes

    @property
    def drops(self) -> int:
        """Messages given to `write` that are not, and will not be, in the bag."""
        return self._refused + self._bag.lost

    @property
    def error(self) -> str | None:
        """Why recording stopped; None as long as it runs."""
        return self._error

    def write(self, topic_name: str, log_time_ns: int, data: builtins.bytes) -> bool:
        """Queue one serialised message without waiting; False if it had to be dropped.

        Raises RecordingError if the bag has no such topic or the time (ns) is out of range.
        """
        self._bag.check(topic_name, log_time_ns)
        cost = len(data) + _MESSAGE_COST_BYTES
        with self._wake:
            full = self._queued_bytes + cost > self._queue_bytes
            if full or self._closing or self._error is not None:
                self._refused += 1
                return False
            self._queue.append((topic_name, log_time_ns, data))
            self._queued_bytes += cost
            self._wake.notify()
        return True

    def close(self, timeout: float | None = None) -> Path:
        """Write what is queued, finish the bag and return its path. May be repeated.

        timeout: s to wait for that; None waits as long as it takes.
        Raises RecordingError if it takes longer; the thread goes on, and so may a further call.
        """
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(timeout)
        if self._thread.is_alive():
            raise RecordingError(
                f'{self.path} was not finished within {timeout} s; wait longer, or choose a '
                'faster disk. What was flushed is there for cube_bag recover.'
            )
        return self.path

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._record()
        except Exception as error:
            # Whatever it is, the simulation goes on and hears of it once.
            self._fail(error)
        with self._wake:
            self._wake.wait_for(lambda: self._closing)
            refused = self._refused
        try:
            self._bag.close(refused)
        except Exception as error:
            self._fail(error)
        else:
            if self._bag.error is not None:
                self._fail(RecordingError(self._bag.error))

    def _record(self) -> None:
        """Write what comes, until closed and empty. Raises what BagWriter raises."""
        flush_at = None  # when what is unflushed must be flushed; None if nothing is
        while True:
            with self._wake:
                if not self._queue and not self._closing:
                    self._wake.wait(_seconds_until(flush_at))
                message = self._queue.popleft() if self._queue else None
                if message is None and self._closing:
                    return
            if message is not None:
                self._bag.write(*message)
                with self._wake:
                    # Only now: until it is written, its memory is still taken.
                    self._queued_bytes -= len(message[2]) + _MESSAGE_COST_BYTES
                if flush_at is None:
                    flush_at = time.monotonic() + self._flush_period
            if flush_at is not None and time.monotonic() >= flush_at:
                self._bag.flush()
                flush_at = None

    def _fail(self, error: Exception) -> None:
        text = str(error)
        if not isinstance(error, RecordingError):
            text = (
                f'Recording to {self.path} stopped ({error!r}); the bag ends with what was '
                'flushed before. Please report this.'
            )
        with self._wake:
            first = self._error is None
            self._error = self._error or text
            self._refused += len(self._queue)
            self._queue.clear()
        if first:
            # A logger that is already shut down must not keep the bag from being finished.
            with contextlib.suppress(Exception):
                self._on_error(text)


def _seconds_until(moment: float | None) -> float | None:
    if moment is None:
        return None
    return min(max(moment - time.monotonic(), 0.0), threading.TIMEOUT_MAX)
