"""`cube_bag report`: what happened in a recording."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.console import Console

from cube_sim.analysis.findings import Findings
from cube_sim.analysis.run import find_out
from cube_sim.bag.description import Document, describe
from cube_sim.bag.progress import progress_bar
from cube_sim.bag.report_tables import print_report
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

SUMMARY = 'say what happened: throws, bounces, rest, energy, and the coefficients measured'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument('bags', nargs='+', metavar='BAG', help='a bag: its directory, or one .mcap')
    add_source_arguments(parser)
    parser.add_argument(
        '--bounces', action='store_true', help='list every bounce (unasked for up to 3 cubes)'
    )
    parser.add_argument(
        '--figures', type=Path, metavar='DIR', help='draw figures into this folder, PNG and SVG'
    )
    parser.add_argument(
        '--html', type=Path, metavar='FILE', help='write a page that needs nothing but itself'
    )


def add_source_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say what of a bag to believe, and what it does not say."""
    parser.add_argument(
        '--from-poses',
        action='store_true',
        help='use the recorded poses alone, also where the run could be simulated again',
    )
    parser.add_argument(
        '--topic', help='a topic of type PoseArray to look at, from its poses alone'
    )
    parser.add_argument(
        '--cube-size', type=float, metavar='M', help='side of the cubes, if the bag does not say'
    )
    parser.add_argument(
        '--gravity', type=float, metavar='M_S2', help='gravity, if the bag does not say'
    )
    parser.add_argument(
        '--noise',
        type=float,
        default=0.0,
        metavar='M',
        help='standard deviation of the positions, if they were measured (default 0)',
    )


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Report on every bag; 0 when that was possible."""
    documents = []
    pages = []
    for bag in arguments.bags:
        found = look_into(Path(bag), arguments)
        document = describe(Path(bag), found, bounces=arguments.bounces)
        documents.append(document)
        if not arguments.json:
            print_report(document, console, bounces=arguments.bounces)
        if arguments.figures is not None:
            from cube_sim.bag.figures import save_figures

            # Bags of one name would overwrite each other's figures.
            several = len(arguments.bags) > 1
            folder = arguments.figures / _name(len(documents), bag) if several else None
            paths = save_figures(found, folder or arguments.figures)
            document['figures'] = [str(path) for path in paths]
            if not arguments.json:
                console.print(f'figures: {paths[0].parent}')
        if arguments.html is not None:
            from cube_sim.bag.page import section

            pages.append(section(document, found))
    if arguments.html is not None:
        _write_page(arguments.html, pages, documents)
        if not arguments.json:
            console.print(f'page: {arguments.html}')
    if arguments.json:
        console.print_json(json.dumps({'bags': documents}))
    return 0


def look_into(bag: Path, arguments: argparse.Namespace) -> Findings:
    """Return the findings of a bag by the source arguments; RecordingError."""
    if not 0.0 <= arguments.noise < float('inf'):
        raise RecordingError(f'--noise is {arguments.noise}: metres from 0 on are needed.')
    with (
        BagReader(bag) as reader,
        progress_bar(f'looking into {bag.name}', shown=not arguments.json) as progress,
    ):
        return find_out(
            reader,
            topic=arguments.topic,
            from_poses=arguments.from_poses,
            cube_size=arguments.cube_size,
            gravity=arguments.gravity,
            noise=arguments.noise,
            progress=progress,
        )


def _name(number: int, bag: str) -> str:
    return f'{number:02}_{Path(bag).resolve().name}'


def _write_page(path: Path, sections: list[str], documents: list[Document]) -> None:
    from cube_sim.bag.page import page

    names = ', '.join(Path(document['bag']).resolve().name for document in documents)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(page(names, sections), encoding='utf-8')
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror}.') from None
