"""The columns of exported tables: name, unit, meaning. Documented in docs/cube_bag.md."""

from __future__ import annotations

from typing import NamedTuple


class Column(NamedTuple):
    """A column: `kind` is 'integer', 'number', 'flag' or 'text'."""

    name: str
    unit: str
    meaning: str
    kind: str = 'number'


_WHO = (
    Column('generation', '', 'resets before this cube was thrown', 'integer'),
    Column('cube', '', 'index of the cube, in throw order', 'integer'),
)

STATES: tuple[Column, ...] = (
    Column('time_s', 's', 'simulated time of the recorded poses'),
    *_WHO,
    Column('x_m', 'm', 'position of the centre, world'),
    Column('y_m', 'm', 'position of the centre, world'),
    Column('z_m', 'm', 'position of the centre, world: height over the plane'),
    Column('qx', '', 'orientation, a unit quaternion'),
    Column('qy', '', 'orientation, a unit quaternion'),
    Column('qz', '', 'orientation, a unit quaternion'),
    Column('qw', '', 'orientation, a unit quaternion'),
    Column('vx_m_s', 'm/s', 'velocity of the centre, world'),
    Column('vy_m_s', 'm/s', 'velocity of the centre, world'),
    Column('vz_m_s', 'm/s', 'velocity of the centre, world'),
    Column('wx_rad_s', 'rad/s', 'spin, world'),
    Column('wy_rad_s', 'rad/s', 'spin, world'),
    Column('wz_rad_s', 'rad/s', 'spin, world'),
    Column(
        'velocity_source',
        '',
        'replay: exact, simulated again; flight: from the parabola through neighbouring poses; '
        'difference: of neighbouring poses, with a contact nearby; unknown: no neighbour',
        'text',
    ),
)

BOUNCES: tuple[Column, ...] = (
    Column('time_s', 's', 'end of the step in which the cube touched; estimated: of the contact'),
    *_WHO,
    Column('x_m', 'm', 'position of the centre at contact, before it is pushed out, world'),
    Column('y_m', 'm', 'position of the centre at contact, before it is pushed out, world'),
    Column('z_m', 'm', 'position of the centre at contact, before it is pushed out, world'),
    Column('contact_x_m', 'm', 'contact point, world'),
    Column('contact_y_m', 'm', 'contact point, world'),
    Column('depth_m', 'm', 'deepest penetration; empty when estimated'),
    Column('impact_speed_m_s', 'm/s', 'of the contact point towards the plane, before'),
    Column('rebound_speed_m_s', 'm/s', 'of the contact point off the plane, after'),
    Column('impact_sliding_m_s', 'm/s', 'speed of the contact point along the plane, before'),
    Column('rebound_sliding_m_s', 'm/s', 'speed of the contact point along the plane, after'),
    Column('centre_impact_speed_m_s', 'm/s', 'of the centre towards the plane, before'),
    Column('centre_rebound_speed_m_s', 'm/s', 'of the centre off the plane, after'),
    Column('wx_before_rad_s', 'rad/s', 'spin before, world'),
    Column('wy_before_rad_s', 'rad/s', 'spin before, world'),
    Column('wz_before_rad_s', 'rad/s', 'spin before, world'),
    Column('wx_after_rad_s', 'rad/s', 'spin after, world'),
    Column('wy_after_rad_s', 'rad/s', 'spin after, world'),
    Column('wz_after_rad_s', 'rad/s', 'spin after, world'),
    Column('model', '', 'physics model that was set; empty when the bag does not say', 'text'),
    Column('restitution', '', 'measured, as the law of the model means it'),
    Column('restitution_at_contact', '', 'rebound over impact speed of the contact point'),
    Column('restitution_of_centre', '', 'rebound over impact speed of the centre'),
    Column('restitution_set', '', 'restitution that was set'),
    Column('friction', '', 'measured, as the law of the model means it'),
    Column('friction_is_lower_bound', '', 'whether there may be more friction than that', 'flag'),
    Column('friction_set', '', 'friction that was set'),
    Column('tangential_factor', '', 'share of its sliding speed that the centre keeps'),
    Column('tangential_factor_set', '', 'tangential factor that was set'),
    Column('impulse_ratio', '', 'tangential over normal change of the velocity of the centre'),
    Column('energy_lost_j', 'J', 'kinetic energy lost at this bounce, for a cube of 1 kg'),
    Column('apex_m', 'm', 'greatest height of the centre until the next bounce; empty if it fell'),
    Column('apex_time_s', 's', 'when that was'),
)
