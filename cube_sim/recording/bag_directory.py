"""What a path is as a bag: the files it consists of, and what its `metadata.yaml` says."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from cube_sim.recording.errors import RecordingError, reason
from cube_sim.recording.mcap_records import MAGIC

METADATA = 'metadata.yaml'
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_SQLITE_MAGIC = b'SQLite format 3\0'
_ROS1_MAGIC = b'#ROSBAG V'
_MOST_METADATA_BYTES = 1 << 26

Mode = Literal['', 'message', 'file']
"""What rosbag2 compressed: nothing but chunks, each message, or each file."""


@dataclass(frozen=True)
class BagDescription:
    """A bag as its directory describes it, before any file is opened."""

    path: Path
    files: list[Path]
    mode: Mode = ''
    messages: int | None = None
    """As metadata.yaml counts them; None without one."""
    custom_data: dict[str, str] = field(default_factory=dict)


def describe(path: Path) -> BagDescription:
    """Return what the bag at `path` consists of. Raises RecordingError if it is no bag."""
    try:
        if path.is_dir():
            return _describe_directory(path)
        check_kind(path)
    except FileNotFoundError:
        raise RecordingError(
            f'{path} does not exist; name a bag: its directory, or one .mcap file.'
        ) from None
    except (OSError, ValueError) as error:
        raise not_readable(path, error) from error
    return BagDescription(path, [path], 'file' if starts_with(path, ZSTD_MAGIC) else '')


def check_kind(path: Path) -> None:
    """Raise RecordingError if the file `path` is not one of a bag, and OSError."""
    if not path.is_file():
        if not path.exists():
            raise FileNotFoundError(path)
        raise RecordingError(f'{path} is neither a file nor a directory; name a bag.')
    front = read_front(path)
    if not front:
        raise RecordingError(
            f'{path} is empty, as when its process was killed at once or the disk was full; '
            'there is nothing in it to be read or recovered, so delete it.'
        )
    if front.startswith(_SQLITE_MAGIC) or path.suffix == '.db3':
        raise RecordingError(_to_convert(path, 'an SQLite bag'))
    if front.startswith(_ROS1_MAGIC):
        raise RecordingError(_to_convert(path, 'a bag of ROS 1'))
    if not front.startswith((MAGIC, ZSTD_MAGIC)) and path.suffix not in ('.mcap', '.zstd'):
        raise RecordingError(f'{path} is not an MCAP file; name a bag directory or a .mcap file.')


def starts_with(path: Path, magic: bytes) -> bool:
    """Say whether the file starts so. Raises OSError."""
    return read_front(path).startswith(magic)


def read_front(path: Path) -> bytes:
    """Return the first bytes of a file. Raises OSError."""
    with path.open('rb') as stream:
        return stream.read(16)


def not_readable(path: Path, error: Exception) -> RecordingError:
    """Return the error for a file that the operating system does not let us read."""
    return RecordingError(
        f'{path} cannot be read ({reason(error)}); check its name, its permissions and the disk.'
    )


def bag_files(directory: Path) -> list[Path]:
    """Return the MCAP files in a directory in the order in which a recorder splits them.

    Raises OSError, and RecordingError if they belong to several bags.
    """
    found = [
        entry
        for entry in directory.iterdir()
        if entry.name.endswith(('.mcap', '.mcap.zstd')) and entry.is_file()
    ]
    stems = sorted({_split_name(file)[0] for file in found})
    if len(stems) > 1:
        raise RecordingError(
            f'{directory} holds files of several bags ({_listed(stems)}); name one file.'
        )
    return sorted(found, key=_split_name)


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the body of a metadata.yaml. Raises OSError, and RecordingError if it has none."""
    with path.open('rb') as stream:
        content = stream.read(_MOST_METADATA_BYTES)
    try:
        body = load_yaml(content.decode())['rosbag2_bagfile_information']
    except (ValueError, TypeError, LookupError):
        body = None
    if not isinstance(body, dict):
        raise bad_metadata(path, 'is not the description of a bag')
    return body


def load_yaml(text: str) -> Any:
    """Return what `text` says. Raises ValueError, and nothing else, if it is no YAML."""
    # Imported here: it is a third of this package's import time, and needed only for a bag.
    import yaml  # type: ignore[import-untyped,unused-ignore]

    try:
        return yaml.load(text, Loader=getattr(yaml, 'CSafeLoader', yaml.SafeLoader))
    except (yaml.YAMLError, RecursionError, ArithmeticError, LookupError, TypeError) as error:
        raise ValueError('no YAML') from error


def bad_metadata(path: Path, what: str) -> RecordingError:
    """Return the error that says `what` is wrong with a metadata.yaml."""
    return RecordingError(
        f'{path} {what}; `cube_bag recover {path.parent}` makes a bag with a new one.'
    )


def _describe_directory(path: Path) -> BagDescription:
    metadata = path / METADATA
    if not metadata.exists():
        raise _no_metadata(path)
    body = read_yaml(metadata)
    storage = body.get('storage_identifier')
    if storage == 'sqlite3':
        raise RecordingError(_to_convert(path, 'an SQLite bag'))
    if storage != 'mcap':
        raise bad_metadata(metadata, f'names the storage {storage!r}, and only mcap can be read')
    names = body.get('relative_file_paths')
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise bad_metadata(metadata, 'does not list the files of its bag')
    files = [_file(path, name) for name in names]
    missing = [file.name for file in files if not file.is_file()]
    if missing or len(set(files)) < len(files):
        what = f'names the missing {_listed(missing)}' if missing else 'names a file twice'
        raise bad_metadata(metadata, what)
    for file in files:
        check_kind(file)
    messages = body.get('message_count')
    if type(messages) is not int:
        raise bad_metadata(metadata, 'does not count the messages')
    custom = body.get('custom_data') or {}
    if not isinstance(custom, dict):
        raise bad_metadata(metadata, 'has custom_data that are not pairs')
    texts = {str(key): str(value) for key, value in custom.items()}
    return BagDescription(path, files, compression_mode(body, metadata), messages, texts)


def compression_mode(body: dict[str, Any], path: Path) -> Mode:
    """Return what rosbag2 compressed. Raises RecordingError in the name of the file `path`."""
    mode = str(body.get('compression_mode', '')).lower()
    form = body.get('compression_format') or ''
    if mode in ('', 'none'):
        return ''
    if mode not in ('message', 'file') or form != 'zstd':
        raise bad_metadata(
            path, f'names the compression {form!r} of each {mode}, and only zstd is known'
        )
    return 'message' if mode == 'message' else 'file'


def _no_metadata(path: Path) -> RecordingError:
    if bag_files(path):
        return RecordingError(
            f'{path} has no {METADATA}, as when its recording still runs or was killed; '
            f'`cube_bag recover {path}` makes a whole bag of it.'
        )
    if any(path.glob('*.db3')):
        return RecordingError(_to_convert(path, 'an SQLite bag'))
    bags = sorted(entry.name for entry in path.iterdir() if (entry / METADATA).exists())
    if bags:
        return RecordingError(f'{path} is no bag but holds {_listed(bags)}; name one of them.')
    return RecordingError(
        f'{path} is no bag: it has neither {METADATA} nor .mcap files; name another directory.'
    )


def _file(directory: Path, name: str) -> Path:
    """Return the file that metadata.yaml means; before version 4 it named the directory too."""
    relative = PurePosixPath(name)
    inside = directory / relative
    if '..' not in relative.parts and not relative.is_absolute() and inside.is_file():
        return inside
    return directory / relative.name


def _split_name(file: Path) -> tuple[str, int]:
    """Return the bag's name and the number of the file in it: of NAME_12.mcap, NAME and 12."""
    name = file.name.partition('.mcap')[0]
    stem, _, number = name.rpartition('_')
    return (stem, int(number)) if stem and number.isdecimal() else (name, 0)


def _listed(names: list[str], most: int = 5) -> str:
    return ', '.join(names[:most]) + (' …' if len(names) > most else '')


def _to_convert(path: Path, kind: str) -> str:
    return (
        f'{path} is {kind}, and only MCAP can be read; convert it first, for instance with '
        f'`rosbags-convert --src {path} --dst {path.with_suffix("")}_mcap --dst-storage mcap`.'
    )
