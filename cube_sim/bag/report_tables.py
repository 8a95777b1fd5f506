"""The tables of `cube_bag report` on a terminal."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cube_sim.analysis.findings import POSES
from cube_sim.bag.description import Document
from cube_sim.bag.wording import (
    BOUNCE_HEADINGS,
    ENERGY_WORDS,
    bounce_cells,
    cube_name,
    estimate_words,
    lost,
    number,
    regime_cells,
    rest_words,
    run_words,
)

# Lines of a table before it is cut, unless all are asked for.
LINES = 30
BOUNCES = 15

# What all columns need, characters; and those of a bounce for less.
WIDE = 112
_NARROW = (0, 2, 3, 4, 5, 8, 9, 11)


def print_report(document: Document, console: Console, *, bounces: bool = False) -> None:
    """Print what is known of one bag, with all of its `bounces` or only the first of each cube."""
    console.print(f'[bold]{escape(document["bag"])}[/bold]')
    for line in run_words(document):
        console.print(escape(line))
    for note in document['notes']:
        console.print(f'[yellow]{escape(note)}[/yellow]')
    if document['method'] == POSES:
        console.print(f'[yellow]{escape(estimate_words(document))}[/yellow]')
    if document['cubes']:
        console.print(_cubes(document, narrow=console.width < WIDE))
    if document['measured']:
        console.print(_measured(document))
    if document['cubes']:
        console.print(_energy(document))
    if document.get('bounces'):
        _print_bounces(document, console, None if bounces else BOUNCES)
    console.print()


def _cubes(document: Document, *, narrow: bool) -> Table:
    table = _table('cubes')
    # The last of these columns are what a narrow terminal has no room for.
    columns: list[tuple[str, Callable[[Document], str]]] = [
        ('cube', lambda cube: cube_name(cube, document)),
        ('thrown\nat s', lambda cube: number(cube['throw']['time_s'], 3)),
        ('speed\nm/s', lambda cube: number(cube['throw']['speed_m_s'], 2)),
        ('spin\nrad/s', lambda cube: number(cube['throw']['spin_rad_s'], 2)),
        ('apex\nm', lambda cube: number(cube['throw']['apex_m'], 3)),
        ('bounces', lambda cube: f'{cube["bounces"]:,}' + ('+' if cube['too_close'] else '')),
        ('hardest\nm/s', lambda cube: number(cube['hardest_impact_m_s'], 2)),
        ('lost\nJ', lambda cube: number(lost(cube['energy']), 2)),
        ('rest at\ns', rest_words),
        ('thrown from\nx, y, z m', _origin),
        ('up\n°', lambda cube: number(cube['throw']['elevation_deg'], 0)),
        ('deepest\nmm', lambda cube: number(_millimetres(cube['deepest_m']), 1)),
    ]
    if narrow:
        del columns[-3:]
    for heading, _ in columns:
        table.add_column(heading, justify='right', no_wrap=True)
    cubes = document['cubes']
    for cube in cubes[:LINES]:
        table.add_row(*(cell(cube) for _, cell in columns))
    if len(cubes) > LINES:
        table.caption = f'and {len(cubes) - LINES} more (--json or --html has them all)'
    return table


def _measured(document: Document) -> Table:
    table = _table('measured at bounces: median, and 5 % to 95 % of them')
    table.add_column('model')
    table.add_column('bounces', justify='right')
    for heading in ('restitution', 'friction', 'tangential factor'):
        table.add_column('set', justify='right')
        table.add_column(heading)
    for regime in document['measured']:
        table.add_row(*regime_cells(regime))
    return table


def _energy(document: Document) -> Table:
    table = _table('energy of all cubes, J (1 kg each)')
    table.add_column('')
    table.add_column('J', justify='right')
    for key, words in ENERGY_WORDS.items():
        value = document['energy'][key]
        if value is None or abs(value) < 5e-10:
            continue
        table.add_row(words, f'{value:+.3f}' if key.startswith('gained') else f'{value:.3f}')
    return table


def _print_bounces(document: Document, console: Console, most: int | None) -> None:
    """Print the bounces cube by cube, at `most` so many of each."""
    ordered = sorted(
        document['bounces'], key=lambda row: (row['generation'], row['cube'], row['time_s'])
    )
    for _, group in groupby(ordered, lambda row: (row['generation'], row['cube'])):
        rows = list(group)
        table = _bounces(rows[:most], document, narrow=console.width < WIDE)
        if most is not None and len(rows) > most:
            table.caption = f'and {len(rows) - most} more (--bounces has them all)'
        console.print(table)


def _bounces(rows: list[Document], document: Document, *, narrow: bool) -> Table:
    table = _table(f'bounces of cube {cube_name(rows[0], document)}')
    columns = _NARROW if narrow else range(len(BOUNCE_HEADINGS))
    for column in columns:
        heading = BOUNCE_HEADINGS[column].replace('|', '\n')
        table.add_column(heading, justify='right', no_wrap=True)
    for row in rows:
        cells = bounce_cells(row)
        table.add_row(*(cells[column] for column in columns))
    return table


def _origin(cube: Document) -> str:
    return ', '.join(number(cube['throw'][key], 2) for key in ('x_m', 'y_m', 'z_m'))


def _millimetres(metres: float | None) -> float | None:
    return None if metres is None else 1e3 * metres


def _table(title: str) -> Table:
    return Table(title=title, title_justify='left', box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
