"""Tables as files: rows in, CSV or Parquet out, a few thousand rows in memory at a time."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

from cube_sim.bag.columns import Column
from cube_sim.recording import RecordingError

FORMATS = ('csv', 'parquet')

# Rows of a Parquet row group.
GROUP = 65_536

# Rows by columns: each a list as long as the others; None is an empty cell.
Rows = Sequence[Sequence[Any]]


class TableFile(Protocol):
    """A table that is being written."""

    def write(self, columns: Rows) -> None:
        """Add rows."""


@contextlib.contextmanager
def table_file(
    path: Path, kind: str, columns: Sequence[Column], notes: dict[str, str], *, replace: bool
) -> Iterator[TableFile]:
    """
    Give a table to write; it is at `path`, whole, when the context ends without an error.

    `notes` go into the metadata of a Parquet file. RecordingError when it cannot be written, or
    exists and is not to be replaced.
    """
    if path.exists() and not replace:
        raise RecordingError(f'{path} exists already, not overwriting (--overwrite does).')
    part = path.with_name(path.name + '.part')
    open_table = {'csv': _csv, 'parquet': _parquet}[kind]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open_table(part, columns, notes) as table:
            yield table
        part.replace(path)
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror or error}.') from None
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


class _Csv:
    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write

    def write(self, columns: Rows) -> None:
        # repr of a float is the shortest text that reads back to the same bits.
        self._write(''.join(','.join(map(_cell, row)) + '\n' for row in zip(*columns, strict=True)))


def _cell(value: Any) -> str:
    if value is None or value != value:
        return ''
    return value if isinstance(value, str) else repr(value)


@contextlib.contextmanager
def _csv(path: Path, columns: Sequence[Column], notes: dict[str, str]) -> Iterator[TableFile]:
    with path.open('w', encoding='utf-8', newline='') as file:
        file.write(','.join(column.name for column in columns) + '\n')
        yield _Csv(file.write)


class _Parquet:
    """Gathers rows to groups."""

    def __init__(self, arrow: Any, schema: Any, writer: Any) -> None:
        self._arrow = arrow
        self._schema = schema
        self._writer = writer
        self._batches: list[Any] = []
        self._rows = 0

    def write(self, columns: Rows) -> None:
        # from_pandas: nan is an empty cell.
        arrays = [
            self._arrow.array(values, type=field.type, from_pandas=True)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._batches.append(self._arrow.record_batch(arrays, schema=self._schema))
        self._rows += len(columns[0])
        if self._rows >= GROUP:
            self.flush()

    def flush(self) -> None:
        table = self._arrow.Table.from_batches(self._batches, schema=self._schema)
        if self._rows:
            self._writer.write_table(table, row_group_size=GROUP)
        self._batches, self._rows = [], 0


@contextlib.contextmanager
def _parquet(path: Path, columns: Sequence[Column], notes: dict[str, str]) -> Iterator[TableFile]:
    try:
        # By name: pyarrow is optional, also for those who check types.
        pyarrow: Any = importlib.import_module('pyarrow')
        parquet: Any = importlib.import_module('pyarrow.parquet')
    except ImportError:
        raise RecordingError(
            'Parquet needs pyarrow: install it with pip install pyarrow, or choose --format csv.'
        ) from None
    types = {
        'number': pyarrow.float64(),
        'integer': pyarrow.int64(),
        'flag': pyarrow.bool_(),
        'text': pyarrow.string(),
    }
    schema = pyarrow.schema(
        [
            pyarrow.field(
                column.name,
                types[column.kind],
                metadata={'unit': column.unit, 'description': column.meaning},
            )
            for column in columns
        ],
        metadata=notes,
    )
    with parquet.ParquetWriter(path, schema, compression='zstd') as writer:
        table = _Parquet(pyarrow, schema, writer)
        yield table
        table.flush()
