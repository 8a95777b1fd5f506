"""Findings as plain data: `cube_bag report --json`, and what tables and pages are made of."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.bounces import Measures
from cube_sim.analysis.cubes import REST_NS, REST_SPEED, Records, rest_ns
from cube_sim.analysis.error_bars import error_bars
from cube_sim.analysis.findings import POSES, Findings
from cube_sim.analysis.summary import Regime, Spread, budget, regimes
from cube_sim.physics import Settings

Floats = NDArray[np.float64]
Document = dict[str, Any]

# Up to so many cubes all bounces are listed unasked.
FEW_CUBES = 3
# Points of the energy over time, as data.
_POINTS = 200

_POSE = ('x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw')
_VELOCITY = ('vx_m_s', 'vy_m_s', 'vz_m_s', 'wx_rad_s', 'wy_rad_s', 'wz_rad_s')


def describe(path: Path, found: Findings, *, bounces: bool = False) -> Document:
    """Return everything about a run, with units in the keys; no number is nan or infinite."""
    cubes = found.cubes.records
    document = {
        'bag': str(path),
        'method': found.method,
        'notes': found.notes,
        'messages': found.messages,
        'start_s': _seconds(found.start_ns),
        'end_s': _seconds(found.end_ns),
        'period_s': _seconds(found.period_ns),
        'settings': [
            {'from_s': _seconds(time_ns), **_settings(record)}
            for time_ns, record in zip(found.settings_from_ns, found.settings, strict=True)
        ],
        'settings_recorded': found.set_known,
        'resets_s': [_seconds(time_ns) for time_ns in found.resets_ns],
        'rest_speed_m_s': REST_SPEED,
        'rest_duration_s': _seconds(REST_NS),
        'cubes_in_all': len(cubes),
        'cubes_at_rest': sum(rest_ns(cube) is not None for cube in cubes),
        'bounces_in_all': len(found.bounces),
        'touches_in_all': int(cubes['touches'].sum()),
        'too_close_in_all': len(found.unclear),
        'estimates_within': (
            dataclasses.asdict(error_bars(found.period_ns)) if found.method == POSES else None
        ),
        'measured': [_regime(regime, found.set_known) for regime in regimes(found)],
        'energy': _energy(found),
        'energy_over_time': _energy_over_time(found),
        'cubes': _cubes(found),
    }
    if bounces or len(cubes) <= FEW_CUBES:
        document['bounces'] = _bounces(found)
    plain: Document = _finite(document)
    return plain


def _cubes(found: Findings) -> list[Document]:
    """Return the cubes; of their bounces the figures that a line of a table has."""
    speeds = found.measures().impact_speed
    # Cubes are in the order of generation and index, so that a bounce finds its own by bisection.
    ids, owners = (
        table.records['generation'].astype(np.int64) << 32 | table.records['cube']
        for table in (found.cubes, found.bounces)
    )
    hardest = np.zeros(len(ids))
    np.maximum.at(hardest, np.searchsorted(ids, owners), np.nan_to_num(speeds))
    return [
        {**_cube(cube), 'hardest_impact_m_s': float(hardest[row]) if cube['bounces'] else None}
        for row, cube in enumerate(found.cubes.records)
    ]


def _cube(cube: Records) -> Document:
    velocity = cube['velocity']
    speed = float(np.linalg.norm(velocity[:3]))
    resting = rest_ns(cube)
    depth_known = bool(np.isfinite(cube['deepest']))
    return {
        'cube': int(cube['cube']),
        'generation': int(cube['generation']),
        'throw': {
            'time_s': _seconds(cube['thrown_ns']),
            **dict(zip(_POSE, cube['pose'].tolist(), strict=True)),
            **dict(zip(_VELOCITY, velocity.tolist(), strict=True)),
            'speed_m_s': speed,
            'azimuth_deg': math.degrees(math.atan2(velocity[1], velocity[0])),
            'elevation_deg': (
                math.degrees(math.asin(max(-1.0, min(1.0, velocity[2] / speed))))
                if speed > 0.0
                else None
            ),
            'spin_rad_s': float(np.linalg.norm(velocity[3:])),
            'apex_m': float(cube['apex']),
            'apex_time_s': _seconds(cube['apex_ns']) if np.isfinite(cube['apex']) else None,
        },
        'bounces': int(cube['bounces']),
        'touches': int(cube['touches']),
        'too_close': int(cube['unclear_stretches']),
        'deepest_m': float(cube['deepest']),
        'deepest_time_s': (
            _seconds(cube['deepest_ns']) if depth_known and cube['deepest'] > 0.0 else None
        ),
        'rest_time_s': None if resting is None else _seconds(resting),
        'end': {
            'time_s': _seconds(cube['ended_ns']),
            'removed': bool(cube['removed']),
            **dict(zip(_POSE, cube['end_pose'].tolist(), strict=True)),
            'speed_m_s': float(np.linalg.norm(cube['end_velocity'][:3])),
            'spin_rad_s': float(np.linalg.norm(cube['end_velocity'][3:])),
        },
        'energy': {
            **_split('thrown', cube['thrown_energy']),
            **{f'{name}_j': float(cube[key]) for name, key in _GAINS.items()},
            **_split('end', cube['end_energy']),
        },
    }


# Key -> field of CUBE and of Budget.
_GAINS = {
    'gained_in_flight': 'flight',
    'gained_by_push_out': 'lift',
    'gained_at_bounces': 'bounced',
    'gained_at_touches': 'touched',
    'gained_by_settings': 'changed',
    'gained_unclear': 'unclear',
}


def _split(when: str, energies: Floats) -> Document:
    potential, translation, rotation = energies.tolist()
    return {
        f'{when}_potential_j': potential,
        f'{when}_translation_j': translation,
        f'{when}_rotation_j': rotation,
    }


def _energy(found: Findings) -> Document:
    total = budget(found)
    return {
        'thrown_j': total.thrown,
        **{name + '_j': getattr(total, key) for name, key in _GAINS.items()},
        'removed_j': total.removed,
        'left_j': total.left,
        'residue_j': total.residue,
    }


def _energy_over_time(found: Findings) -> list[Document]:
    frames = found.trace.frames
    stride = max(1, -(-len(frames) // _POINTS))
    return [
        {
            'time_s': _seconds(frame.time_ns),
            'cubes': len(frame.cubes),
            'potential_j': float(frame.energies[0]),
            'translation_j': float(frame.energies[1]),
            'rotation_j': float(frame.energies[2]),
        }
        for frame in frames[::stride]
    ]


def _bounces(found: Findings) -> list[Document]:
    return [
        bounce_row(record, found, index, measures)
        for measures in [found.measures()]
        for index, record in enumerate(found.bounces.records)
    ]


def bounce_row(record: Any, found: Findings, index: int, measures: Measures) -> Document:
    """Return what is known of one bounce: `record` is the one at `index`."""
    contact = record['position'] + record['arm']
    settings = found.settings[record['settings']]
    known = found.set_known
    apex = float(record['apex'])
    return {
        'cube': int(record['cube']),
        'generation': int(record['generation']),
        'time_s': _seconds(record['time_ns']),
        **dict(zip(('x_m', 'y_m', 'z_m'), record['position'].tolist(), strict=True)),
        'contact_x_m': float(contact[0]),
        'contact_y_m': float(contact[1]),
        'depth_m': float(record['depth']),
        'impact_speed_m_s': float(measures.impact_speed[index]),
        'rebound_speed_m_s': float(measures.rebound_speed[index]),
        'impact_sliding_m_s': float(measures.impact_sliding[index]),
        'rebound_sliding_m_s': float(measures.rebound_sliding[index]),
        'centre_impact_speed_m_s': float(measures.centre_impact_speed[index]),
        'centre_rebound_speed_m_s': float(measures.centre_rebound_speed[index]),
        **{
            f'{name}_{when}_rad_s': float(record[when][column])
            for when in ('before', 'after')
            for column, name in ((3, 'wx'), (4, 'wy'), (5, 'wz'))
        },
        'model': settings.model if known else None,
        'restitution': float(measures.restitution[index]),
        'restitution_at_contact': float(measures.restitution_at_contact[index]),
        'restitution_of_centre': float(measures.restitution_of_centre[index]),
        'restitution_set': settings.restitution if known else None,
        'friction': float(measures.friction[index]),
        'friction_is_lower_bound': bool(measures.friction_is_bound[index]),
        'friction_set': settings.friction if known else None,
        'tangential_factor': float(measures.tangential_factor[index]),
        'tangential_factor_set': settings.tangential_factor if known else None,
        'impulse_ratio': float(measures.impulse_ratio[index]),
        'energy_lost_j': float(record['lost']),
        'apex_m': apex,
        'apex_time_s': _seconds(record['apex_ns']) if math.isfinite(apex) else None,
    }


def _regime(regime: Regime, known: bool) -> Document:
    return {
        'model': regime.settings.model if known else None,
        'bounces': regime.bounces,
        'restitution_set': regime.settings.restitution if known else None,
        'restitution': _spread(regime.restitution),
        'friction_set': regime.settings.friction if known else None,
        'friction': _spread(regime.friction),
        'friction_lower_bounds': regime.bounds,
        'tangential_factor_set': regime.settings.tangential_factor if known else None,
        'tangential_factor': _spread(regime.tangential_factor),
    }


def _spread(spread: Spread | None) -> Document | None:
    return None if spread is None else dataclasses.asdict(spread)


def _settings(settings: Settings) -> Document:
    return {
        'model': settings.model,
        'restitution': settings.restitution,
        'friction': settings.friction,
        'tangential_factor': settings.tangential_factor,
        'gravity_m_s2': settings.gravity,
        'gravity_direction': list(settings.gravity_direction),
        'cube_size_m': settings.cube_size,
        'time_step_s': settings.time_step,
    }


def _seconds(time_ns: Any) -> float:
    return int(time_ns) / 1e9


def _finite(value: Any) -> Any:
    """Return `value` with None where a number is nan or infinite: JSON knows neither."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
