"""`cube_bag compare`: where two runs part, by value."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cube_sim.analysis.comparison import Comparison, compare
from cube_sim.bag.progress import progress_bar
from cube_sim.recording.reader import BagReader

SUMMARY = 'say where two runs part, by value, and how far they are apart after it'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument('first', help='a bag: its directory, or one .mcap')
    parser.add_argument('second', help='the bag to hold beside it')
    parser.add_argument('--topic', help='the topic of poses in both, if there are several')
    parser.add_argument(
        '--figure', type=Path, help='draw heights and distance side by side into this PNG or SVG'
    )


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Compare the bags; 0 when they are equal to the bit."""
    topics = (arguments.topic, arguments.topic)
    with (
        BagReader(arguments.first) as first,
        BagReader(arguments.second) as second,
        progress_bar('comparing', shown=not arguments.json) as progress,
    ):
        result = compare(first, second, topics, progress)
        if arguments.figure is not None:
            from cube_sim.bag.comparison_figure import draw_comparison

            draw_comparison(arguments.figure, (first, second), topics, result)
    if arguments.json:
        console.print_json(json.dumps(_as_json(result)))
    else:
        _print(result, arguments, console)
    return 0 if result.same else 1


def _print(result: Comparison, arguments: argparse.Namespace, console: Console) -> None:
    console.print(
        f'{result.common:,} times in both, {result.equal:,} of them equal to the bit; '
        f'{result.only_first:,} only in the first, {result.only_second:,} only in the second'
    )
    if result.same:
        console.print('[green]the same run[/green]')
        return
    parting = result.parting
    if parting is not None:
        console.print(
            f'they part at {parting.time_ns / 1e9:.9f} s, cube {parting.cube}, {parting.field}: '
            f'{parting.first!r} and {parting.second!r}'
        )
    if result.other_counts_ns is not None:
        console.print(
            f'from {result.other_counts_ns / 1e9:.3f} s on they have different numbers of cubes'
        )
    if result.milestones:
        table = Table('farther apart than', 'first at', 'cube')
        for distance, (time_ns, cube) in result.milestones.items():
            table.add_row(f'{distance:g} m', f'{time_ns / 1e9:.3f} s', str(cube))
        console.print(table)
    if result.largest:
        console.print(
            f'at the end the farthest are {result.largest[-1]:.6g} m apart, '
            f'the mean is {result.mean[-1]:.6g} m'
        )
    if arguments.figure is not None:
        console.print(f'figure: {arguments.figure}')


def _as_json(result: Comparison) -> dict[str, Any]:
    parting = result.parting
    return {
        'same': result.same,
        'common_messages': result.common,
        'equal_messages': result.equal,
        'only_in_first': result.only_first,
        'only_in_second': result.only_second,
        'first_difference': parting
        and {
            'time_s': parting.time_ns / 1e9,
            'cube': parting.cube,
            'field': parting.field,
            'first': parting.first,
            'second': parting.second,
        },
        'different_numbers_of_cubes_from_s': (
            None if result.other_counts_ns is None else result.other_counts_ns / 1e9
        ),
        'farther_apart_than_m': {
            f'{distance:g}': {'time_s': time_ns / 1e9, 'cube': cube}
            for distance, (time_ns, cube) in result.milestones.items()
        },
        'largest_distance_at_end_m': result.largest[-1] if result.largest else None,
        'mean_distance_at_end_m': result.mean[-1] if result.mean else None,
    }
