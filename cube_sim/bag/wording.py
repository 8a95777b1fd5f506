"""The sentences and numbers of a report, the same on a terminal and on a page."""

from __future__ import annotations

from typing import Any

from cube_sim.analysis.error_bars import POSES_OF_A_FLIGHT
from cube_sim.analysis.findings import REPLAY
from cube_sim.bag.description import Document

NONE = '–'

# Key of the energy -> what it is.
ENERGY_WORDS = {
    'thrown_j': 'thrown in',
    'gained_in_flight_j': 'in flight, by the integrator (−½ g² Δt² a step)',
    'gained_by_push_out_j': 'by being pushed out of the plane',
    'gained_at_bounces_j': 'at bounces',
    'gained_at_touches_j': 'at other touches',
    'gained_by_settings_j': 'by changed settings',
    'gained_unclear_j': 'where poses cannot tell',
    'removed_j': 'taken away by resets',
    'left_j': 'left at the end',
}


# A heading, and its unit behind a bar.
BOUNCE_HEADINGS = (
    'time|s',
    'at x, y|m',
    'impact|m/s',
    'rebound|m/s',
    'sliding|m/s',
    'after|m/s',
    'spin|rad/s',
    'after|rad/s',
    'restitution',
    'friction',
    'kept',
    'lost|J',
    'apex|m',
)


def number(value: float | None, digits: int) -> str:
    """Return `value` with that many decimals, or a dash for None."""
    if value is None:
        return NONE
    text = f'{value:,.{digits}f}'
    return text.removeprefix('-') if float(text.replace(',', '')) == 0.0 else text


def run_words(document: Document) -> list[str]:
    """Return what kind of a recording this is, in a few lines."""
    rate = 1.0 / document['period_s'] if document['period_s'] else 0.0
    span = f'{document["start_s"]:.3f} s to {document["end_s"]:.3f} s'
    replayed = document['method'] == REPLAY
    how = 'simulated again, exact at every step' if replayed else 'estimated from poses alone'
    words = [
        f'{document["messages"]:,} messages of poses'
        + (f', {rate:.4g} a second, {span}' if document['messages'] > 1 else '')
        + f'; {how}'
    ]
    if document['settings_recorded'] and document['settings']:
        first = document['settings'][0]
        changes = len(document['settings']) - 1
        words.append(
            f'model {first["model"]}, restitution {first["restitution"]:g}, '
            f'friction {first["friction"]:g}, tangential factor {first["tangential_factor"]:g}, '
            f'gravity {first["gravity_m_s2"]:g} m/s², side {first["cube_size_m"]:g} m, '
            f'step {1e3 * first["time_step_s"]:g} ms'
            + (f'; settings changed {_times(changes)}' if changes else '')
        )
    cubes, resting = document['cubes_in_all'], document['cubes_at_rest']
    words.append(
        f'{_count(cubes, "cube")}, {resting} came to rest '
        f'(no point above {document["rest_speed_m_s"]:g} m/s for {document["rest_duration_s"]:g} s'
        ' or more, until its end); '
        f'{_count(document["bounces_in_all"], "bounce")}, '
        f'{_count(document["touches_in_all"], "other touch", "es")}'
        + (f', {_count(len(document["resets_s"]), "reset")}' if document['resets_s'] else '')
    )
    return words


def estimate_words(document: Document) -> str:
    """Return how good estimates are, and what they cannot see."""
    bars = document['estimates_within']
    unclear = document['too_close_in_all']
    stretches = f'{_count(unclear, "stretch", "es")} of motion'
    return (
        f'Estimates: nine of ten are within ±{1e3 * bars["time_s"]:g} ms, '
        f'±{1e3 * bars["place_m"]:g} mm, ±{bars["speed_m_s"]:g} m/s, '
        f'±{bars["restitution"]:g} of restitution and ±{bars["friction"]:g} of friction '
        f'(measured with exact poses at {bars["rate_hz"]} a second and steps of 2 ms). '
        f'Bounces with fewer than {POSES_OF_A_FLIGHT} poses between them cannot be told apart: '
        f'{stretches} {"is" if unclear == 1 else "are"} too close to tell (marked +).'
    )


def rest_words(cube: Document) -> str:
    """Return when a cube came to rest, s, or that it did not."""
    return 'no' if cube['rest_time_s'] is None else f'{cube["rest_time_s"]:.3f}'


def regime_cells(regime: Document) -> list[str]:
    """Return the cells of a row: what was set and what was measured."""
    simple = regime['model'] == 'simple'
    bounds = regime['friction_lower_bounds']
    friction = spread_words(regime['friction'])
    if bounds and not simple:
        friction += f' ({_count(bounds, "lower bound")} apart)'
    return [
        regime['model'] or 'unknown',
        f'{regime["bounces"]:,}',
        _set(regime['restitution_set']),
        spread_words(regime['restitution']),
        NONE if simple else _set(regime['friction_set']),
        NONE if simple else friction,
        _set(regime['tangential_factor_set']) if simple else NONE,
        spread_words(regime['tangential_factor']),
    ]


def spread_words(spread: dict[str, Any] | None) -> str:
    """Return median and range of measured values."""
    if spread is None:
        return NONE
    low, high = f'{spread["low"]:.3f}', f'{spread["high"]:.3f}'
    median = f'{spread["median"]:.3f}'
    return median if low == high == median else f'{median} ({low} … {high})'


def _set(value: float | None) -> str:
    return NONE if value is None else f'{value:g}'


def _count(count: int, noun: str, plural: str = 's') -> str:
    return f'{count:,} {noun}{"" if count == 1 else plural}'


def _times(count: int) -> str:
    return 'once' if count == 1 else f'{count} times'


def cube_name(cube: Document, document: Document) -> str:
    """Return a cube's number, with that of its generation where there was a reset."""
    number_of_cube = str(cube['cube'])
    return f'{cube["generation"]}:{number_of_cube}' if document['resets_s'] else number_of_cube


def lost(energy: Document) -> float | None:
    """Return what a cube has lost since its throw, J."""
    parts = ('potential', 'translation', 'rotation')
    before = [energy[f'thrown_{part}_j'] for part in parts]
    after = [energy[f'end_{part}_j'] for part in parts]
    if None in before or None in after:
        return None
    return float(sum(before) - sum(after))


def spin(row: dict[str, Any], when: str) -> float:
    """Return the spin of a bounce 'before' or 'after', rad/s."""
    return float(sum(row[f'{axis}_{when}_rad_s'] ** 2 for axis in ('wx', 'wy', 'wz')) ** 0.5)


def bounce_cells(row: Document) -> list[str]:
    """Return the cells of a bounce, under BOUNCE_HEADINGS."""
    friction = number(row['friction'], 3)
    return [
        number(row['time_s'], 3),
        f'{number(row["contact_x_m"], 2)}, {number(row["contact_y_m"], 2)}',
        number(row['impact_speed_m_s'], 3),
        number(row['rebound_speed_m_s'], 3),
        number(row['impact_sliding_m_s'], 3),
        number(row['rebound_sliding_m_s'], 3),
        number(spin(row, 'before'), 2),
        number(spin(row, 'after'), 2),
        number(row['restitution'], 3),
        f'≥ {friction}' if row['friction_is_lower_bound'] else friction,
        number(row['tangential_factor'], 3) if row['model'] == 'simple' else NONE,
        number(row['energy_lost_j'], 3),
        number(row['apex_m'], 3),
    ]
