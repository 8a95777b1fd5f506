"""`cube_bag recover`: what can be had from a truncated or damaged bag."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from rich.console import Console

from cube_sim.bag.progress import progress_bar
from cube_sim.recording.recovery import recover

SUMMARY = 'save what a truncated or damaged bag still holds into a new, complete one'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument('bag', help='the broken bag: its directory, or one .mcap')
    parser.add_argument(
        '-o', '--output', type=Path, help='the new bag (default: NAME_recovered beside it)'
    )


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Recover the bag; 1 when there was nothing to be had."""
    with progress_bar('recovering', shown=not arguments.json) as progress:
        result = recover(arguments.bag, arguments.output, progress=progress)
    if arguments.json:
        content = {**dataclasses.asdict(result), 'path': str(result.path)}
        console.print_json(json.dumps(content))
        return 0 if result.messages else 1
    for words in result.damaged:
        console.print(f'[yellow]damaged[/yellow]: {words}', markup=True)
    console.print(
        f'{result.messages:,} messages recovered from {result.start_ns / 1e9:.3f} s to '
        f'{result.end_ns / 1e9:.3f} s, {result.lost_bytes:,} bytes lost'
    )
    console.print(f'bag: {result.path}')
    return 0 if result.messages else 1
