"""The page of `cube_bag report`: one HTML file that needs nothing but itself."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from itertools import groupby
from pathlib import Path

from cube_sim.analysis.findings import POSES, Findings
from cube_sim.bag.description import Document
from cube_sim.bag.figures import figures, png
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

# More rows than this of one cube make a page that no browser likes.
BOUNCES_OF_A_CUBE = 300

_CAPTIONS = {
    'height': 'Height of the centres over time',
    'energy': 'Energy of all cubes over time, and what has been thrown in',
    'energy_by_cube': 'Energy of each cube over time',
    'bounces': 'Bounces from above',
    'phase': 'Phase portrait: height and vertical velocity',
}

_STYLE = """
:root { color-scheme: light; }
body { margin: 0 auto; max-width: 68rem; padding: 1.5rem; background: #fff; color: #1f2933;
  font: 16px/1.5 system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif; }
h1 { font-size: 1.7rem; margin: 0 0 .2rem; } h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; }
.path { color: #616e7c; font-size: .9rem; margin: 0 0 1rem; overflow-wrap: anywhere; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr)); gap: .8rem;
  margin: 1.2rem 0; }
.tile { border: 1px solid #d9e0e7; border-radius: .5rem; padding: .6rem .9rem; }
.tile b { display: block; font-size: 1.5rem; font-variant-numeric: tabular-nums; }
.tile span { color: #52606d; font-size: .85rem; }
.note { background: #fff8e6; border-left: 4px solid #e69f00; padding: .6rem .9rem; margin: 1rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .7rem; text-align: right; border-bottom: 1px solid #e4e9ee;
  white-space: nowrap; }
th { font-weight: 600; color: #3e4c59; vertical-align: bottom; border-bottom-color: #9aa5b1; }
th small { display: block; font-weight: 400; color: #616e7c; }
.text td:first-child, .text th:first-child { text-align: left; }
tbody tr:hover { background: #f5f7fa; }
figure { margin: 1.6rem 0; } figure img { width: 100%; height: auto; }
figcaption { font-weight: 600; margin-bottom: .3rem; }
details { margin: .5rem 0; } summary { cursor: pointer; }
article + article { border-top: 3px solid #d9e0e7; margin-top: 3rem; padding-top: 2rem; }
@media print { body { max-width: none; } details { break-inside: avoid; } }
"""


def page(title: str, sections: Sequence[str]) -> str:
    """Return the page of these sections."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n'
        + '\n'.join(sections)
        + '\n</body>\n</html>\n'
    )


def section(document: Document, found: Findings) -> str:
    """Return what there is to say and to see of one bag, as HTML; RecordingError."""
    parts = [
        f'<h1>{escape(Path(document["bag"]).resolve().name)}</h1>',
        f'<p class="path">{escape(document["bag"])}</p>',
        _tiles(document),
        *(f'<p>{escape(line)}</p>' for line in run_words(document)),
        *(f'<p class="note">{escape(note)}</p>' for note in document['notes']),
    ]
    if document['method'] == POSES:
        parts.append(f'<p class="note">{escape(estimate_words(document))}</p>')
    if document['measured']:
        parts += ['<h2>Measured at bounces</h2>', _measured(document)]
    if document['cubes']:
        parts += ['<h2>Figures</h2>', *_figures(found)]
        parts += ['<h2>Where the energy went</h2>', _energy(document)]
        parts += ['<h2>Cubes</h2>', _cubes(document)]
    if document.get('bounces'):
        parts += ['<h2>Bounces</h2>', *_bounces(document)]
    return '<article>\n' + '\n'.join(parts) + '\n</article>'


def _tiles(document: Document) -> str:
    span = document['end_s'] - document['start_s']
    hardest = [cube['hardest_impact_m_s'] or 0.0 for cube in document['cubes']]
    tiles = [
        (f'{document["cubes_in_all"]:,}', 'cubes thrown'),
        (f'{document["cubes_at_rest"]:,}', 'came to rest'),
        (f'{document["bounces_in_all"]:,}', 'bounces'),
        (f'{max(hardest, default=0.0):.2f} m/s', 'hardest impact'),
        (f'{span:.2f} s', 'recorded'),
    ]
    cells = ''.join(
        f'<div class="tile"><b>{value}</b><span>{words}</span></div>' for value, words in tiles
    )
    return f'<div class="tiles">{cells}</div>'


def _figures(found: Findings) -> list[str]:
    return [
        f'<figure><figcaption>{_CAPTIONS[name]}</figcaption><img alt="{_CAPTIONS[name]}" '
        f'src="data:image/png;base64,{base64.b64encode(png(figure)).decode()}"></figure>'
        for name, figure in figures(found).items()
    ]


def _measured(document: Document) -> str:
    headings = [
        'model',
        'bounces',
        'set',
        'restitution|median (5 % … 95 %)',
        'set',
        'friction|median (5 % … 95 %)',
        'set',
        'tangential factor|median (5 % … 95 %)',
    ]
    return _table(headings, (regime_cells(regime) for regime in document['measured']), text=True)


def _energy(document: Document) -> str:
    rows = []
    for key, words in ENERGY_WORDS.items():
        value = document['energy'][key]
        if value is not None and abs(value) >= 5e-10:
            rows.append([words, f'{value:+.3f}' if key.startswith('gained') else f'{value:.3f}'])
    return _table(['all cubes, 1 kg each', 'energy|J'], rows, text=True)


def _cubes(document: Document) -> str:
    headings = [
        'cube',
        'thrown|s',
        'from x, y, z|m',
        'speed|m/s',
        'azimuth|°',
        'elevation|°',
        'spin|rad/s',
        'apex|m',
        'bounces',
        'hardest|m/s',
        'deepest|mm',
        'lost|J',
        'at rest|s',
        'end x, y|m',
    ]
    rows = []
    for cube in document['cubes']:
        throw, end, deepest = cube['throw'], cube['end'], cube['deepest_m']
        rows.append(
            [
                cube_name(cube, document),
                number(throw['time_s'], 3),
                ', '.join(number(throw[key], 2) for key in ('x_m', 'y_m', 'z_m')),
                number(throw['speed_m_s'], 2),
                number(throw['azimuth_deg'], 0),
                number(throw['elevation_deg'], 0),
                number(throw['spin_rad_s'], 2),
                number(throw['apex_m'], 3),
                f'{cube["bounces"]:,}' + ('+' if cube['too_close'] else ''),
                number(cube['hardest_impact_m_s'], 2),
                number(None if deepest is None else 1e3 * deepest, 1),
                number(lost(cube['energy']), 2),
                rest_words(cube),
                f'{number(end["x_m"], 2)}, {number(end["y_m"], 2)}',
            ]
        )
    return _table(headings, rows)


def _bounces(document: Document) -> list[str]:
    ordered = sorted(
        document['bounces'], key=lambda row: (row['generation'], row['cube'], row['time_s'])
    )
    parts: list[str] = []
    for _, group in groupby(ordered, lambda row: (row['generation'], row['cube'])):
        rows = list(group)
        shown = rows[:BOUNCES_OF_A_CUBE]
        words = f'cube {cube_name(rows[0], document)}: {len(rows):,} bounces'
        if len(shown) < len(rows):
            words += f', the first {len(shown)} here'
        is_open = ' open' if len(parts) < 3 and len(rows) <= 40 else ''
        table = _table(BOUNCE_HEADINGS, (bounce_cells(row) for row in shown))
        parts.append(f'<details{is_open}><summary>{words}</summary>{table}</details>')
    return parts


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]], *, text: bool = False) -> str:
    """Return a table; a heading's unit stands behind a bar."""
    head = ''.join(
        f'<th>{escape(words)}{f"<small>{escape(unit)}</small>" if unit else ""}</th>'
        for words, _, unit in (heading.partition('|') for heading in headings)
    )
    body = '\n'.join(
        '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>' for row in rows
    )
    kind = ' class="text"' if text else ''
    return (
        f'<div class="wide"><table{kind}><thead><tr>{head}</tr></thead>\n'
        f'<tbody>\n{body}\n</tbody></table></div>'
    )
