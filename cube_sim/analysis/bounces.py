"""Bounces: what was seen of each, and what that says about restitution and friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.cubes import Records
from cube_sim.physics import Settings

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# One bounce: at `time_ns` the centre of the cube is at `position`, its contact point `arm` away
# from there; velocities (6,) before and after. `settings` is an index into those of the run;
# `apex` the greatest height of the centre until the next bounce (nan if it only falls).
BOUNCE = np.dtype(
    [
        ('generation', np.int32),
        ('cube', np.int32),
        ('time_ns', np.int64),
        ('settings', np.int32),
        ('position', np.float64, 3),
        ('arm', np.float64, 3),
        ('before', np.float64, 6),
        ('after', np.float64, 6),
        ('depth', np.float64),
        ('lost', np.float64),
        ('apex', np.float64),
        ('apex_ns', np.int64),
    ]
)

# Contacts slower than this are touches and no bounces, m/s; and never fewer than so many steps of
# gravity, or a cube that lies on the plane would bounce at every step.
SLOWEST_BOUNCE = 0.05
_STEPS_OF_GRAVITY = 3.0

# A bounce ends a flight of at least this long, ns, or is at least this hard, m/s. A cube that
# rattles on two of its edges, as it does under `impulse`, touches the plane but does not bounce.
SHORTEST_FLIGHT_NS = 20_000_000
HARD = 1.0

# Below this a speed is none: there is no ratio to take, m/s.
_NO_SPEED = 1e-6
# Relative distance to a limit at which it counts as reached.
_AT_LIMIT = 1e-6


@dataclass(frozen=True)
class Measures:
    """
    What bounces (K,) say; nan where it cannot be said. Speeds m/s, all in world.

    `impact_speed` and `rebound_speed` are those of the contact point along the normal, towards
    the plane and away from it; the `sliding` speeds are along the plane; `centre_...` are those
    of the centre.

    `restitution` and `friction` are measured as the law of the model means them, and so can be
    held beside the settings:

    simple    restitution: speeds of the centre; `tangential_factor`: what it keeps of its sliding
    impulse   restitution: of the normal impulse, j_n K / -v_r.n - 1 with
              K = 1/m + n.(I^-1 (r x n) x r); friction: the share of the impulse that would stop
              the sliding, j_t r.(I^-1 (r x t) x t) / v_r.t; j_t is clamped to j_n, and where it
              is, this is a lower bound
    others    and where the model is not known, unless the spin stays as it is, which is taken for
              `simple`: restitution: speeds of the contact point; friction: |dv_t| / |dv_n|
              (Coulomb), a lower bound where the sliding ends: sticking takes less than the cone
              allows

    `restitution_at_contact` and `restitution_of_centre` are the plain ratios of the speeds, and
    `impulse_ratio` is |dv_t| / |dv_n| of the centre, under every model.
    """

    impact_speed: Floats
    rebound_speed: Floats
    impact_sliding: Floats
    rebound_sliding: Floats
    centre_impact_speed: Floats
    centre_rebound_speed: Floats
    restitution: Floats
    restitution_at_contact: Floats
    restitution_of_centre: Floats
    friction: Floats
    friction_is_bound: Flags
    tangential_factor: Floats
    impulse_ratio: Floats


def slowest_bounce(settings: Settings) -> float:
    """Return the impact speed below which a contact is no bounce but a touch, m/s."""
    return max(SLOWEST_BOUNCE, _STEPS_OF_GRAVITY * settings.gravity * settings.time_step)


def approach_speeds(arms: Floats, velocities: Floats, model: str) -> Floats:
    """
    Return how fast cubes (K,) run into the plane, m/s, as their model sees it.

    `simple` knows the centre only; for the others it is the contact point `arms` (K, 3) away.
    """
    if model == 'simple':
        return -velocities[:, 2]
    return -_at_contact(arms, velocities)[:, 2]


def measure(bounces: Records, settings: list[Settings], models: list[str]) -> Measures:
    """
    Return what `bounces` (K,) of type BOUNCE say, under the settings that they refer to.

    `models` are those by whose law to measure, one for each of `settings`; '' where unknown.
    """
    before, after, arms = bounces['before'], bounces['after'], bounces['arm']
    used = bounces['settings']
    laws = np.array(models or [''])[used]
    sizes = np.array([record.cube_size for record in settings] or [np.nan])[used]
    contact_before, contact_after = _at_contact(arms, before), _at_contact(arms, after)
    impact, rebound = -contact_before[:, 2], contact_after[:, 2]
    sliding = np.hypot(contact_before[:, 0], contact_before[:, 1])
    sliding_after = np.hypot(contact_after[:, 0], contact_after[:, 1])
    centre_impact, centre_rebound = -before[:, 2], after[:, 2]
    centre_sliding = np.hypot(before[:, 0], before[:, 1])
    impulse = after[:, :3] - before[:, :3]
    tangential = np.hypot(impulse[:, 0], impulse[:, 1])
    ratio = _ratio(tangential, np.abs(impulse[:, 2]))

    at_contact = _ratio(rebound, impact)
    of_centre = _ratio(centre_rebound, centre_impact)
    # Of a law that is not known, this much can be seen: whether it leaves the spin alone.
    turning = 0.5 * sizes * np.linalg.norm(after[:, 3:] - before[:, 3:], axis=1)
    keeps_spin = turning <= 1e-3 * np.linalg.norm(impulse, axis=1)
    is_simple = (laws == 'simple') | ((laws == '') & keeps_spin)
    is_impulse = laws == 'impulse'
    restitution = np.where(is_simple, of_centre, at_contact)
    friction = np.where(is_simple, np.nan, ratio)
    bound = ~is_simple & (sliding_after <= 1e-3 * np.maximum(sliding, _NO_SPEED))
    if is_impulse.any():
        yielding = 6.0 / (sizes * sizes)
        normal = 1.0 + yielding * (arms[:, 0] ** 2 + arms[:, 1] ** 2)
        by_law = _ratio(impulse[:, 2] * normal, impact) - 1.0
        restitution = np.where(is_impulse, by_law, restitution)
        share = _ratio(tangential * yielding * _turning(arms, contact_before), sliding)
        friction = np.where(is_impulse, share, friction)
        clamped = tangential >= np.abs(impulse[:, 2]) * (1.0 - _AT_LIMIT)
        bound = np.where(is_impulse, clamped, bound)
    slides = np.where(is_simple, centre_sliding, sliding) > _NO_SPEED
    friction = np.where(slides, friction, np.nan)
    return Measures(
        impact_speed=impact,
        rebound_speed=rebound,
        impact_sliding=sliding,
        rebound_sliding=sliding_after,
        centre_impact_speed=centre_impact,
        centre_rebound_speed=centre_rebound,
        restitution=restitution,
        restitution_at_contact=at_contact,
        restitution_of_centre=of_centre,
        friction=friction,
        friction_is_bound=bound & np.isfinite(friction),
        tangential_factor=_ratio(np.hypot(after[:, 0], after[:, 1]), centre_sliding),
        impulse_ratio=ratio,
    )


def _at_contact(arms: Floats, velocities: Floats) -> Floats:
    """Return v_r = v + w x r (K, 3)."""
    vx, vy, vz, wx, wy, wz = velocities.T
    x, y, z = arms.T
    # Written out: np.cross takes ten times as long for the few cubes of one step.
    return np.stack([vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x], axis=1)


def _turning(arms: Floats, sliding: Floats) -> Floats:
    """Return |r x t|^2 for the directions t of the sliding, m^2."""
    speed = np.hypot(sliding[:, 0], sliding[:, 1])
    direction = np.zeros_like(arms)
    moves = speed > _NO_SPEED
    direction[moves, :2] = sliding[moves, :2] / speed[moves, None]
    turning: Floats = np.sum(np.cross(arms, direction) ** 2, axis=1)
    return turning


def _ratio(part: Floats, whole: Floats) -> Floats:
    ratio = np.full(np.shape(whole), np.nan)
    np.divide(part, whole, out=ratio, where=whole > _NO_SPEED)
    return ratio
