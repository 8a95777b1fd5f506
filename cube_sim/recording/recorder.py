"""Records in the background, so that a slow disk never holds up the caller."""

from __future__ import annotations

import builtins
import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from cube_sim.recording.bag import CHUNK_SIZE, BagWriter
from cube_sim.recording.compression import Compression
from cube_sim.recording.errors import RecordingError
from cube_sim.recording.topic import Topic

QUEUE_BYTES = 256 * 1024 * 1024
FLUSH_PERIOD = 0.2
RETRY_PERIOD = 1.0
# What a queued message costs beside its data, so that many small ones are bounded too.
_MESSAGE_COST_BYTES = 256
# Part of the queue that only latched topics may use. They are few and small, and a bag without
# one of them (a throw, a setting) cannot be simulated again.
_LATCHED_SHARE = 1 / 8
# How often a recording that is being closed may still stop and go on.
_CLOSING_TRIES = 10


class Recorder:
    """Writes a bag from a thread of its own, behind a queue that is bounded in bytes.

    The order of the messages is that of the `write` calls. Where chunks end depends on the time
    of writing too (flush_period); with `flush_period=math.inf` the same calls make the same bytes.

    If the disk is full or gone, messages wait in the queue, and are dropped only once that is
    full; recording goes on in a new file of the bag as soon as it can. The bag notes how many
    messages it lacks, and when (see BagWriter).
    """

    def __init__(
        self,
        directory: Path,
        topics: Sequence[Topic],
        *,
        on_error: Callable[[str], None],
        on_notice: Callable[[str], None] = lambda sentence: None,
        queue_bytes: int = QUEUE_BYTES,
        flush_period: float = FLUSH_PERIOD,
        retry_period: float = RETRY_PERIOD,
        compression: Compression = 'none',
        max_bytes: int = 0,
        max_duration_ns: int = 0,
    ) -> None:
        """Create the bag `directory` and start.

        on_error: is given a sentence, from the recorder's thread, each time recording has to stop.
        on_notice: the same, when recording goes on, and when the queue begins to drop messages.
        queue_bytes: B of messages that may wait; a message above it is dropped.
        flush_period: s of wall time, about the most that a killed process loses.
        retry_period: s of wall time between attempts to go on after an error.
        max_bytes, max_duration_ns: limits of a file, as BagWriter has them.
        Raises RecordingError as BagWriter does.
        """
        self._bag = BagWriter(
            directory,
            topics,
            compression=compression,
            max_bytes=max_bytes,
            max_duration_ns=max_duration_ns,
        )
        self._latched = {topic.name for topic in topics if topic.durability == 'transient_local'}
        self._on_error = on_error
        self._on_notice = on_notice
        self._queue_bytes = queue_bytes
        self._worth_bytes = min(CHUNK_SIZE, queue_bytes // 2)  # worth a write before it is time
        self._flush_period = flush_period
        self._retry_period = retry_period
        self._closing_tries = _CLOSING_TRIES
        self._wake = threading.Condition()
        # Guarded by _wake:
        self._queue: deque[tuple[str, int, builtins.bytes]] = deque()
        self._queued_bytes = 0
        self._closing = False
        self._broken = False  # for good: nothing is queued any more
        self._error: str | None = None
        self._drops_from: int | None = None  # log time of a gap that is still to be told
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
    def files(self) -> int:
        """Files of the bag so far."""
        return self._bag.files

    @property
    def resumed(self) -> int:
        """How often recording went on in a new file after an error."""
        return self._bag.resumed

    @property
    def waiting_bytes(self) -> int:
        """Size of the queue, B."""
        return self._queued_bytes

    @property
    def drops(self) -> int:
        """Messages given to `write` that are not, and will not be, in the bag."""
        return self._bag.drops.total

    @property
    def error(self) -> str | None:
        """Why recording stands still; None as long as it runs, and when it has gone on."""
        return self._error

    def write(self, topic_name: str, log_time_ns: int, data: builtins.bytes) -> bool:
        """Queue one serialised message without waiting; False if it had to be dropped.

        Raises RecordingError if the bag has no such topic or the time (ns) is out of range.
        """
        self._bag.check(topic_name, log_time_ns)
        cost = len(data) + _MESSAGE_COST_BYTES
        share = 1.0 if topic_name in self._latched else 1.0 - _LATCHED_SHARE
        with self._wake:
            full = self._queued_bytes + cost > share * self._queue_bytes
            if full or self._closing or self._broken:
                new = self._bag.drops.add(log_time_ns, log_time_ns, {topic_name: 1})
                if new and self._error is None and self._drops_from is None:
                    self._drops_from = log_time_ns
                return False
            self._queue.append((topic_name, log_time_ns, data))
            self._queued_bytes += cost
            # The thread sleeps until there is something, then until it is worth a write.
            if len(self._queue) == 1 or self._queued_bytes >= self._worth_bytes:
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
            self._drop_queue()
        try:
            self._bag.close()
        except Exception as error:
            self._fail(error)
        else:
            if self._bag.error is not None:
                self._fail(RecordingError(self._bag.error))

    def _record(self) -> None:
        """Write what comes, until closed; go on after each error of the disk, if it is mended."""
        while True:
            try:
                self._write_queue()
            except RecordingError as error:
                self._stop(str(error))
                if not self._go_on():
                    return
            else:
                return

    def _write_queue(self) -> None:
        """Write what comes, until closed and empty. Raises what BagWriter raises."""
        # The first message is flushed at once, so that even a short recording holds something.
        flush_at = -math.inf if self._flush_period < math.inf else math.inf
        flushed = True
        while self._wait(flush_at, flushed):
            # Not until it is empty: one that is filled as fast is flushed as often.
            for _ in range(len(self._queue)):
                self._write_one()
                flushed = False
            if not flushed and time.monotonic() >= flush_at:
                flush_at = time.monotonic() + self._flush_period
                self._bag.flush()
                flushed = True
        self._bag.flush()

    def _wait(self, flush_at: float, flushed: bool) -> bool:
        """Wait until it is time to flush or there is a chunk to write; False when all is done."""
        with self._wake:
            if flushed:
                self._wake.wait_for(lambda: self._queue or self._closing)
            self._wake.wait_for(
                lambda: self._queued_bytes >= self._worth_bytes or self._closing,
                _seconds_until(flush_at),
            )
            drops_from, self._drops_from = self._drops_from, None
            more = bool(self._queue) or not self._closing
        if drops_from is not None:
            self._tell(
                self._on_notice,
                f'The disk is too slow for {self.path}: messages from {drops_from / 1e9:.3f} s '
                'of simulation time on are being dropped. Their number will stand in the bag.',
            )
        return more

    def _write_one(self) -> None:
        """Write the next message; there is one. Raises what BagWriter raises."""
        with self._wake:
            message = self._queue.popleft()
        try:
            self._bag.write(*message)
        finally:
            with self._wake:
                # Only now: until it is written, its memory is still taken.
                self._queued_bytes -= len(message[2]) + _MESSAGE_COST_BYTES

    def _stop(self, error: str) -> None:
        with self._wake:
            self._error = error
        self._tell(self._on_error, error)

    def _go_on(self) -> bool:
        """Try until writing goes on, or once if the recording is being closed; say whether."""
        since, drops = time.monotonic(), self.drops
        while True:
            with self._wake:
                closing = self._wake.wait_for(lambda: self._closing, self._retry_period)
            if closing:
                self._closing_tries -= 1
            try:
                self._bag.resume()
            except RecordingError:
                if closing:
                    return False
                continue
            if closing and self._closing_tries < 0:
                return False
            with self._wake:
                self._error = None
            self._tell(
                self._on_notice,
                f'Recording goes on in {self._bag.file_path} after '
                f'{time.monotonic() - since:.1f} s; {self.drops - drops} messages are lost.',
            )
            return True

    def _fail(self, error: Exception) -> None:
        """Stop for good."""
        text = str(error)
        if not isinstance(error, RecordingError):
            text = (
                f'Recording to {self.path} stopped ({error!r}); the bag ends with what was '
                'flushed before. Please report this.'
            )
        with self._wake:
            first = self._error is None
            self._error = self._error or text
            self._broken = True
            self._drop_queue()
        if first:
            self._tell(self._on_error, text)

    def _drop_queue(self) -> None:
        """Count what is queued as dropped; _wake is held."""
        for name, log_time_ns, data in self._queue:
            self._bag.drops.add(log_time_ns, log_time_ns, {name: 1})
            self._queued_bytes -= len(data) + _MESSAGE_COST_BYTES
        self._queue.clear()

    def _tell(self, listener: Callable[[str], None], sentence: str) -> None:
        # A logger that is already shut down must not keep the bag from being finished.
        with contextlib.suppress(Exception):
            listener(sentence)


def _seconds_until(moment: float) -> float:
    return min(max(moment - time.monotonic(), 0.0), threading.TIMEOUT_MAX)
