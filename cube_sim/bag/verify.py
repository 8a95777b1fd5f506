"""`cube_bag verify`: is the recording what the simulator computes, to the bit?"""

from __future__ import annotations

import argparse
import dataclasses
import json
from typing import Any

from rich.console import Console

from cube_sim.analysis.verification import Verification, verify
from cube_sim.bag.progress import progress_bar
from cube_sim.recording.reader import BagReader

SUMMARY = 'simulate a bag again and compare every pose bit by bit'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument('bag', help='a bag that sim_node recorded: its directory, or one .mcap')


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Verify the bag; 0 when nothing differs."""
    with (
        BagReader(arguments.bag) as reader,
        progress_bar('simulating again', shown=not arguments.json) as progress,
    ):
        result = verify(reader, progress)
    if arguments.json:
        console.print_json(json.dumps(_as_json(result)))
    else:
        for line in _lines(result):
            console.print(line)
    return 0 if result.verified else 1


def _lines(result: Verification) -> list[str]:
    lines = [
        f'dropped by the recorder: {gap.messages} messages '
        f'from {gap.start_ns / 1e9:.3f} s to {gap.end_ns / 1e9:.3f} s'
        for gap in result.gaps
    ]
    if result.drops and not result.gaps:
        lines.append(f'dropped by the recorder: {result.drops} messages')
    if result.messages == 0:
        return [*lines, 'not verified: the bag has no poses']
    compared = f'{result.messages:,} messages, {result.differing_bits:,} differing bits'
    if result.verified:
        return [*lines, f'[green]verified[/green]: {compared}']
    first = result.first
    if first is not None:
        values = f'recorded {first.recorded!r}, simulated {first.simulated!r}'
        place = f'first at {first.time_ns / 1e9:.9f} s, cube {first.cube}, {first.field}'
        lines += [
            f'[red]not verified[/red]: {compared} in {result.differing_messages:,} messages',
            f'{place}: {values}',
        ]
    if result.unverifiable is not None:
        lines.append(
            f'[red]not verified[/red] beyond {result.messages:,} messages: {result.unverifiable}'
        )
    return lines


def _as_json(result: Verification) -> dict[str, Any]:
    return {'verified': result.verified, **dataclasses.asdict(result)}
