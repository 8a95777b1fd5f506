"""Bags read back: those of this package, and those of others that hold MCAP."""

from __future__ import annotations

import contextlib
import functools
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from cube_sim.recording.bag_directory import (
    METADATA,
    ZSTD_MAGIC,
    BagDescription,
    bad_metadata,
    compression_mode,
    describe,
    not_readable,
    starts_with,
)
from cube_sim.recording.bag_notes import (
    read_drops,
    read_gaps,
    read_qos,
    rosbag2_description,
    texts,
)
from cube_sim.recording.compressed_files import unpack_file, unpack_message
from cube_sim.recording.drops import Gap
from cube_sim.recording.errors import RecordingError
from cube_sim.recording.mcap_records import ChannelRecord, DamageError
from cube_sim.recording.mcap_source import McapSource, Place
from cube_sim.recording.merging import Part, RecordedMessage, in_order, merged

__all__ = ['BagReader', 'Gap', 'RecordedMessage', 'RecordedTopic']


@dataclass(frozen=True)
class RecordedTopic:
    """A topic as a bag describes it."""

    name: str
    type: str
    """Full type name; if its messages are of several types, all of them with ', ' between."""
    definition: str
    """The text of the type and of those it needs; '' if the bag has none."""
    count: int | None
    """Messages of it in the bag."""
    qos: list[dict[str, Any]]
    """The offered profiles in rosbag2's words; [] if unknown."""
    encoding: str = 'cdr'
    """How its messages are serialised: ROS 2 always says cdr, other tools may not."""


class BagReader:
    """Reads a bag: its directory, or one .mcap file alone.

    What is read is checked: a message comes as it was written or not at all, as far as the file
    has checksums (this package's have them over all messages, and rosbag2's by default). A file
    without them is checked for its structure alone. Everything that may go wrong, here and in
    `messages`, is a RecordingError. A reader is a context manager, which `close`s it.

    topics: by name. drops: messages that the recorder dropped; gaps: when, if the bag says so.
    start_ns, end_ns: log times of the first and last message, 0 without any.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the bag at `path` and read its index. Raises RecordingError."""
        self.path = Path(path)
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._closed = False
        description = describe(self.path)
        self.files = description.files
        self._mode = description.mode
        with contextlib.ExitStack() as on_error:
            on_error.callback(self.close)
            self._sources = [self._open(file) for file in self.files]
            with self._recording_errors():
                self.topics = self._find_topics()
                custom_data = self._custom_data(description)
                self.drops, self.gaps = read_drops(custom_data), read_gaps(custom_data)
            filled = [source for source in self._sources if source.messages]
            self.message_count = sum(source.messages for source in filled)
            self.start_ns = min((source.first_ns for source in filled), default=0)
            self.end_ns = max((source.last_ns for source in filled), default=0)
            if description.messages not in (None, self.message_count):
                raise bad_metadata(
                    self.path / METADATA,
                    f'counts {description.messages} messages where the files hold '
                    f'{self.message_count}',
                )
            on_error.pop_all()

    def messages(self, topics: Collection[str] | None = None) -> Iterator[RecordedMessage]:
        """Yield the messages of `topics`, or all, in order of log time.

        Messages of equal time come in the order in which they were written, over all files. In
        memory are the chunks that overlap in time, but never more than some 64 MB of them; those
        that overlap more are read repeatedly. Raises RecordingError, at once for a topic that the
        bag does not have, and while reading for damage.
        """
        if self._closed:
            raise RecordingError(f'{self.path} is closed; open it again to read it.')
        names = self.topics.keys() if topics is None else set(topics)
        for name in names:
            if name not in self.topics:
                known = ', '.join(sorted(self.topics)) or 'none at all'
                raise RecordingError(f'{self.path} has no topic {name}; it has {known}.')
        return self._read(frozenset(names))

    def close(self) -> None:
        """Give back what reading took; may be repeated."""
        self._closed = True
        if self._temporary is not None:
            self._temporary.cleanup()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _open(self, file: Path) -> McapSource:
        with self._recording_errors(file):
            if self._mode == 'file' or starts_with(file, ZSTD_MAGIC):
                if self._temporary is None:
                    self._temporary = tempfile.TemporaryDirectory(prefix='cube_sim_bag_')
                file = unpack_file(file, Path(self._temporary.name))
            return McapSource(file)

    def _custom_data(self, description: BagDescription) -> dict[str, str]:
        """Return what the recorder noted of the bag: in its last file, and all of it.

        It is in three places, and only the checksums of a few recorders cover them, so they must
        agree. For a single file, learn from the same notes whether its messages are compressed.
        """
        notes = self._sources[-1].notes if self._sources else {}
        if description.messages is not None:  # there is a metadata.yaml
            told = description.custom_data
        else:
            inside = rosbag2_description(notes)
            told = texts(inside.get('custom_data'))
            if compression_mode(inside, self.path) == 'message':
                self._mode = 'message'
        own = notes.get('cube_sim', {})
        if any(told.get(key) != value for key, value in own.items()):
            raise DamageError('what it notes of its own drops differs from place to place')
        return {**told, **own}

    def _find_topics(self) -> dict[str, RecordedTopic]:
        found: dict[str, list[tuple[McapSource, ChannelRecord]]] = {}
        for source in self._sources:
            for channel in source.channels.values():
                found.setdefault(channel.topic, []).append((source, channel))
        return {name: _describe_topic(name, found[name]) for name in sorted(found)}

    def _read(self, names: frozenset[str]) -> Iterator[RecordedMessage]:
        parts = []
        order = 0
        for source in self._sources:
            wanted = {
                channel.id: channel.topic
                for channel in source.channels.values()
                if channel.topic in names
            }
            for place in source.places:
                order += 1
                if place.channels and place.channels.isdisjoint(wanted):
                    continue
                load = functools.partial(self._load, source, place, wanted)
                parts.append(Part(order, place.first_ns, place.last_ns, place.size, load))
        counts: Counter[str] = Counter()
        with self._recording_errors():
            for message in merged(parts):
                counts[message.topic] += 1
                yield message
            for name in names:
                if counts[name] != self.topics[name].count:
                    raise DamageError(
                        f'it holds {counts[name]} messages of {name}, '
                        f'and its index says {self.topics[name].count}'
                    )

    def _load(
        self, source: McapSource, place: Place, wanted: dict[int, str]
    ) -> list[RecordedMessage]:
        try:
            data, found = source.load(place)
        except DamageError as error:
            raise DamageError(f'in {source.path.name}, {error}') from None
        if self._mode == 'message':
            messages = [
                RecordedMessage(wanted[channel], time_ns, unpack_message(data[start:end]))
                for channel, time_ns, start, end in found
                if channel in wanted
            ]
        else:
            messages = [
                RecordedMessage(wanted[channel], time_ns, data[start:end])
                for channel, time_ns, start, end in found
                if channel in wanted
            ]
        return in_order(messages)

    @contextlib.contextmanager
    def _recording_errors(self, file: Path | None = None) -> Iterator[None]:
        """Turn what goes wrong inside into RecordingError."""
        try:
            yield
        except DamageError as error:
            raise RecordingError(
                f'{file or self.path} is damaged: {error}; '
                f'`cube_bag recover {self.path}` makes a bag of what is sound.'
            ) from None
        except OSError as error:
            raise not_readable(file or self.path, error) from error
        except MemoryError:
            raise RecordingError(
                f'{file or self.path} has a chunk that does not fit into memory; write it anew '
                'with smaller chunks, or read it on a larger machine.'
            ) from None


def _describe_topic(name: str, channels: list[tuple[McapSource, ChannelRecord]]) -> RecordedTopic:
    """Return the topic that these channels are together, of one file or several."""
    types: dict[str, str] = {}
    encodings: dict[str, None] = {}
    qos: list[dict[str, Any]] = []
    count = 0
    for source, channel in channels:
        schema = source.schemas.get(channel.schema_id)
        if schema is not None:
            types.setdefault(schema.name, schema.data.decode(errors='replace'))
        encodings.setdefault(channel.encoding)
        profiles = read_qos(channel.metadata.get('offered_qos_profiles', ''))
        qos += [profile for profile in profiles if profile not in qos]
        count += source.counts[channel.id]
    definition = next(iter(types.values()), '')
    return RecordedTopic(name, ', '.join(types), definition, count, qos, ', '.join(encodings))
