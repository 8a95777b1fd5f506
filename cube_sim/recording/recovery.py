"""A whole bag out of one that is truncated, damaged, or was never finished."""

from __future__ import annotations

import contextlib
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from cube_sim import __version__
from cube_sim.recording.bag_directory import (
    METADATA,
    ZSTD_MAGIC,
    bag_files,
    check_kind,
    not_readable,
    starts_with,
)
from cube_sim.recording.bag_notes import read_qos, rosbag2_description, texts
from cube_sim.recording.compressed_files import unpack_front, unpack_message
from cube_sim.recording.definitions import Definition
from cube_sim.recording.directory import make_directory, write_metadata
from cube_sim.recording.errors import RecordingError, reason
from cube_sim.recording.mcap_records import ChannelRecord, DamageError, SchemaRecord
from cube_sim.recording.mcap_source import McapSource
from cube_sim.recording.metadata import FileInfo, bag_information
from cube_sim.recording.salvage import Salvage, SavedMessage
from cube_sim.recording.topic import Topic, to_yaml

_COMPRESSIONS = {
    '': CompressionType.NONE,
    'lz4': CompressionType.LZ4,
    'zstd': CompressionType.ZSTD,
}
_UNTOLD = {'drops': '0'}

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Recovery:
    """What came of a bag."""

    path: Path
    """The new bag, or the old one that is whole again."""
    messages: int
    lost_bytes: int
    """Of the old files, what was left out or made no sense."""
    chunks: int
    """Sound ones."""
    damaged: list[str]
    """What was wrong, and where; empty if nothing was."""
    start_ns: int
    end_ns: int


@dataclass(frozen=True)
class _SavedTopic(Topic):
    """A topic of any bag, which need not be one that this package would write."""

    profiles: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Take every name and type."""

    def qos_profiles(self) -> list[dict[str, Any]]:
        return self.profiles


@dataclass
class _State:
    """What has been found in all files so far."""

    topics: dict[str, tuple[Topic, Definition]] = field(default_factory=dict)
    # By topic, of the first channel: rosbags wants one quality of service for all of them.
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    files: list[FileInfo] = field(default_factory=list)
    notes: dict[str, dict[str, str]] = field(default_factory=dict)
    chunks: int = 0
    lost_bytes: int = 0
    damaged: list[str] = field(default_factory=list)

    def learn(self, channel: ChannelRecord, schema: SchemaRecord | None) -> None:
        """Keep a topic for metadata.yaml."""
        if channel.topic in self.topics:
            return
        self.metadata[channel.topic] = channel.metadata
        name = schema.name if schema else ''
        profiles = read_qos(channel.metadata.get('offered_qos_profiles', ''))
        topic = _SavedTopic(channel.topic, name, profiles=profiles)
        text = schema.data.decode(errors='replace') if schema else ''
        type_hash = channel.metadata.get('topic_type_hash', '')
        self.topics[channel.topic] = (topic, Definition(name, text, type_hash))

    def custom_data(self, source: Path) -> dict[str, str]:
        """Return what the recorder noted, and what became of the bag."""
        inside = texts(rosbag2_description(self.notes).get('custom_data'))
        own = self.notes.get('cube_sim', _UNTOLD)
        return {**inside, **own, 'recovered_from': source.name, 'lost_bytes': str(self.lost_bytes)}

    def result(self, path: Path) -> Recovery:
        filled = [file for file in self.files if file.messages]
        return Recovery(
            path,
            sum(file.messages for file in filled),
            self.lost_bytes,
            self.chunks,
            self.damaged,
            min((file.first_ns for file in filled), default=0),
            max((file.last_ns for file in filled), default=0),
        )


def recover(
    source: str | Path,
    target: Path | None = None,
    progress: Progress | None = None,
    *,
    in_place: bool = False,
) -> Recovery:
    """Make a whole bag of all that can be had from `source`, a bag directory or one file.

    It becomes the new directory `target` (NAME_recovered beside the source, if None), with one
    file for each of the source's and a metadata.yaml. `source` stays as it is, sound or not. What
    is kept and what is left out is decided in `salvage`: no message whose checksum does not fit.
    If nothing of the source was lost but metadata.yaml, `in_place=True` writes that alone, into
    the source itself; it has none then, and all of its files are sound, or nothing is changed.

    progress: is called with the bytes read so far and all there are.
    Raises RecordingError if nothing can be had, or the new bag cannot be written.
    """
    source = Path(source)
    try:
        files = _files(source)
        sizes = [file.stat().st_size for file in files]
    except FileNotFoundError:
        raise RecordingError(f'{source} does not exist; name a bag to recover.') from None
    except (OSError, ValueError) as error:
        raise not_readable(source, error) from error
    steps = _Steps(progress, sizes)
    if in_place:
        return _describe_in_place(source, target, files, steps)
    if target is None:
        absolute = source.absolute()
        target = absolute.with_name(absolute.name.partition('.mcap')[0] + '_recovered')
    state = _State()
    make_directory(target)
    made: list[Path] = []
    try:
        _write(source, files, target, state, steps, made)
    except BaseException:
        with contextlib.suppress(OSError):
            for path in made:
                path.unlink(missing_ok=True)
            target.rmdir()
        raise
    return state.result(target)


class _Steps:
    """Turns the progress in one file into that in all."""

    def __init__(self, progress: Progress | None, sizes: list[int]) -> None:
        self._progress = progress
        self._sizes = sizes
        self._total = sum(sizes)

    def of_file(self, number: int, size: int) -> Callable[[int], None]:
        """Return what is to be called with the bytes read of a file that has `size` of them."""
        before = sum(self._sizes[:number])
        share = self._sizes[number] / size if size else 0.0
        return lambda done: self._tell(before + round(done * share))

    def end(self) -> None:
        self._tell(self._total)

    def _tell(self, done: int) -> None:
        if self._progress is not None:
            self._progress(done, self._total)


def _files(source: Path) -> list[Path]:
    """Return the files to be read. Raises OSError, and RecordingError if there are none."""
    if not source.is_dir():
        check_kind(source)
        return [source]
    files = bag_files(source)
    for file in files:
        if file.stat().st_size:
            check_kind(file)
    if not any(file.stat().st_size for file in files):
        other = next(iter(sorted(source.glob('*.db3'))), None)
        if other is not None:
            check_kind(other)
        raise RecordingError(
            f'{source} has no .mcap files with anything in them; name another directory.'
        )
    return files


def _write(
    source: Path, files: list[Path], target: Path, state: _State, steps: _Steps, made: list[Path]
) -> None:
    """Write a new file for each old one, and then metadata.yaml."""
    with tempfile.TemporaryDirectory(prefix='cube_sim_bag_') as temporary:
        for number, file in enumerate(files):
            new = target / f'{target.name}_{number}.mcap'
            made.append(new)
            with _naming(file, new):
                if starts_with(file, ZSTD_MAGIC):
                    unpacked = Path(temporary) / file.name.removesuffix('.zstd')
                    if not unpack_front(file, unpacked):
                        state.damaged.append(f'{file.name}, its compressed data end too early')
                    salvage = Salvage(unpacked, steps.of_file(number, unpacked.stat().st_size))
                else:
                    salvage = Salvage(file, steps.of_file(number, file.stat().st_size))
                finish = (lambda: _notes(source, state)) if number == len(files) - 1 else dict
                _write_file(salvage, new, state, finish)
    if not state.topics:
        raise RecordingError(
            f'Nothing can be recovered from {source}: no topic and no message is left in it '
            f'({"; ".join(state.damaged) or "it is empty"}).'
        )
    made.append(target / METADATA)
    with _naming(source, target):
        information = bag_information(
            list(state.topics.values()), state.files, state.custom_data(source)
        )
        write_metadata(target, information)
    steps.end()


def _write_file(
    salvage: Salvage,
    path: Path,
    state: _State,
    notes: Callable[[], dict[str, dict[str, str]]],
) -> None:
    """Write what `salvage` finds as the file `path`, with notes that are asked for at its end."""
    stream = salvage.messages()
    first = next(stream, None)  # before the writer: it brings the compression with it
    messages = _with_first(first, stream)
    counts: Counter[str] = Counter()
    times = [] if first is None else [first.time_ns] * 2
    payload = 0
    with path.open('xb') as out:
        writer = Writer(out, compression=_COMPRESSIONS[salvage.compression], enable_data_crcs=True)
        writer.start('ros2', f'cube_sim {__version__}')
        channels = _Channels(writer, salvage, state)
        for message in messages:
            channel = message.channel
            data: bytes | memoryview = message.data
            if channel.encoding == 'cdr' and data[: len(ZSTD_MAGIC)] == ZSTD_MAGIC:
                # CDR starts with a zero: this one was compressed by rosbag2, message by message.
                try:
                    data = unpack_message(message.data)
                except DamageError:
                    salvage.damaged.append(f'{path.name}, a compressed message is broken')
                    salvage.lost_bytes += len(data)
                    continue
            writer.add_message(
                channels.number(channel),
                message.time_ns,
                bytes(data),
                message.publish_ns,
                message.sequence,
            )
            counts[channel.topic] += 1
            payload += len(data)
            times = [min(times[0], message.time_ns), max(times[1], message.time_ns)]
        for channel in salvage.channels.values():
            channels.number(channel)
        state.files.append(
            FileInfo(path.name, times[0], times[1], dict(counts), payload)
            if counts
            else FileInfo(path.name)
        )
        state.notes.update(salvage.notes)
        state.chunks += salvage.chunks
        state.lost_bytes += salvage.lost_bytes
        state.damaged += salvage.damaged
        for name, pairs in notes().items():
            writer.add_metadata(name, pairs)
        writer.finish()


def _with_first(first: SavedMessage | None, rest: Iterator[SavedMessage]) -> Iterator[SavedMessage]:
    if first is not None:
        yield first
    yield from rest


class _Channels:
    """The new file's numbers of channels: one for each topic and type."""

    def __init__(self, writer: Writer, salvage: Salvage, state: _State) -> None:
        self._writer = writer
        self._salvage = salvage
        self._state = state
        self._schemas: dict[str, int] = {}
        self._numbers: dict[tuple[str, str, str], int] = {}

    def number(self, channel: ChannelRecord) -> int:
        """Return the new number of an old channel; tell the writer of it if it is the first."""
        schema = self._salvage.schemas.get(channel.schema_id)
        name = schema.name if schema else ''
        key = channel.topic, name, channel.encoding
        if key not in self._numbers:
            self._state.learn(channel, schema)
            if schema is not None and name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(
                    name, schema.encoding, schema.data
                )
            metadata = self._state.metadata[channel.topic]
            schema_id = self._schemas[name] if schema else 0
            self._numbers[key] = self._writer.register_channel(
                channel.topic, channel.encoding, schema_id, metadata
            )
        return self._numbers[key]


def _notes(source: Path, state: _State) -> dict[str, dict[str, str]]:
    custom_data = state.custom_data(source)
    information = bag_information(list(state.topics.values()), state.files, custom_data)
    return {
        'rosbag2': {'serialized_metadata': to_yaml(information)},
        'cube_sim': custom_data,
    }


def _describe_in_place(
    source: Path, target: Path | None, files: list[Path], steps: _Steps
) -> Recovery:
    """Write the metadata.yaml that a bag of sound files lacks."""
    if target is not None or not source.is_dir():
        raise RecordingError(
            'In place means the directory of a bag and no other target; leave one of them out.'
        )
    if (source / METADATA).exists():
        raise RecordingError(f'{source / METADATA} exists already, not overwriting.')
    state = _State()
    for number, file in enumerate(files):
        try:
            with _naming(file, source):
                _check_file(file, state, steps.of_file(number, file.stat().st_size))
        except DamageError as error:
            raise RecordingError(
                f'{file} is damaged: {error}; recover it into a new bag, not in place.'
            ) from None
    with _naming(source, source):
        custom_data = {**_UNTOLD, **state.notes.get('cube_sim', {})}
        information = bag_information(list(state.topics.values()), state.files, custom_data)
        write_metadata(source, information)
    steps.end()
    return state.result(source)


def _check_file(file: Path, state: _State, progress: Callable[[int], None]) -> None:
    """Read all of a sound file. Raises OSError and DamageError."""
    found = McapSource(file)
    if rosbag2_description(found.notes).get('compression_mode'):
        raise DamageError('its messages are compressed, which only a new bag can undo')
    counts: Counter[str] = Counter()
    payload = 0
    for place in found.places:
        _, messages = found.load(place)
        counts.update(found.channels[channel].topic for channel, _, _, _ in messages)
        payload += sum(end - start for _, _, start, end in messages)
        progress(place.offset + place.length)
        state.chunks += not place.bare
    for channel in found.channels.values():
        state.learn(channel, found.schemas.get(channel.schema_id))
    state.notes.update(found.notes)
    state.files.append(
        FileInfo(file.name, found.first_ns, found.last_ns, dict(counts), payload)
        if counts
        else FileInfo(file.name)
    )


@contextlib.contextmanager
def _naming(source: Path, target: Path) -> Iterator[None]:
    """Turn what the operating system refuses into RecordingError."""
    try:
        yield
    except OSError as error:
        raise RecordingError(
            f'{source} could not be recovered to {target} ({reason(error)}); '
            'make room, or choose another target on a disk with room.'
        ) from error
    except MemoryError:
        raise RecordingError(
            f'{source} has a record that does not fit into memory; try a larger machine.'
        ) from None
