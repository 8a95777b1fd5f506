"""`cube_bag export`: the motion and the bounces of a recording as tables."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from cube_sim.analysis.findings import REPLAY, Findings
from cube_sim.analysis.rows import SOURCES, States, states
from cube_sim.bag.columns import BOUNCES, STATES
from cube_sim.bag.description import bounce_row
from cube_sim.bag.progress import progress_bar
from cube_sim.bag.report import add_source_arguments, look_into
from cube_sim.bag.table_files import FORMATS, table_file
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

SUMMARY = 'write poses, velocities and bounces as CSV or Parquet tables'

# Bounces that are turned into rows at a time.
_AT_ONCE = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument('bag', help='a bag: its directory, or one .mcap')
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='FILE',
        help='the table of poses (default: NAME.csv here); bounces go to FILE_bounces beside it',
    )
    parser.add_argument(
        '--format', choices=FORMATS, help="default: by the file name's ending, else csv"
    )
    parser.add_argument('--overwrite', action='store_true', help='replace files that exist already')
    add_source_arguments(parser)


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Export the bag; 0 when the tables are written."""
    bag = Path(arguments.bag)
    output, kind = _target(bag, arguments.output, arguments.format)
    bounces = output.with_name(f'{output.stem}_bounces{output.suffix}')
    for path in (output, bounces):
        if path.exists() and not arguments.overwrite:
            raise RecordingError(f'{path} exists already, not overwriting (--overwrite does).')
    found = look_into(bag, arguments)
    notes = {
        'source': bag.resolve().name,
        'method': found.method,
        'documentation': 'docs/cube_bag.md of cube_sim',
    }
    rows = _write_states(bag, output, kind, found, notes, arguments)
    _write_bounces(bounces, kind, found, notes, arguments.overwrite)
    if arguments.json:
        content = {
            'method': found.method,
            'notes': found.notes,
            'states': {'path': str(output), 'rows': rows},
            'bounces': {'path': str(bounces), 'rows': len(found.bounces)},
        }
        console.print_json(json.dumps(content))
        return 0
    for note in found.notes:
        console.print(note, style='yellow', markup=False)
    how = 'exact' if found.method == REPLAY else 'estimated from poses'
    console.print(f'{rows:,} states, velocities {how}: {output}', markup=False)
    console.print(f'{len(found.bounces):,} bounces: {bounces}', markup=False)
    return 0


def _target(bag: Path, output: Path | None, kind: str | None) -> tuple[Path, str]:
    if output is None:
        kind = kind or 'csv'
        return Path(f'{bag.resolve().stem}.{kind}'), kind
    if kind is None:
        kind = output.suffix.lower().removeprefix('.')
        if kind not in FORMATS:
            raise RecordingError(
                f'{output} does not end in .csv or .parquet; choose with --format.'
            )
    return output, kind


def _write_states(
    bag: Path,
    output: Path,
    kind: str,
    found: Findings,
    notes: dict[str, str],
    arguments: argparse.Namespace,
) -> int:
    rows = 0
    with (
        BagReader(bag) as reader,
        table_file(output, kind, STATES, notes, replace=arguments.overwrite) as table,
        progress_bar('writing', shown=not arguments.json) as progress,
    ):
        stream = states(reader, found, topic=arguments.topic, noise=arguments.noise)
        for number, moment in enumerate(stream):
            if number % 64 == 0:
                progress(number, found.messages)
            if len(moment.poses):
                table.write(_columns(moment))
                rows += len(moment.poses)
    return rows


def _columns(moment: States) -> list[list[Any]]:
    count = len(moment.poses)
    values = np.concatenate([moment.poses, moment.velocities], axis=1)
    return [
        [moment.time_ns / 1e9] * count,
        [moment.generation] * count,
        list(range(count)),
        *values.T.tolist(),
        [SOURCES[code] for code in moment.source.tolist()],
    ]


def _write_bounces(
    path: Path, kind: str, found: Findings, notes: dict[str, str], overwrite: bool
) -> None:
    measures = found.measures()
    records = found.bounces.records
    with table_file(path, kind, BOUNCES, notes, replace=overwrite) as table:
        for start in range(0, len(records), _AT_ONCE):
            rows = [
                bounce_row(records[index], found, index, measures)
                for index in range(start, min(start + _AT_ONCE, len(records)))
            ]
            table.write([[row[column.name] for row in rows] for column in BOUNCES])
