"""A run simulated again from the bytes of its throws, settings and resets: the same bits."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from support.collecting_outlet import CollectingOutlet
from support.ros_messages import decoded, plain

from cube_sim.physics import Settings, World
from cube_sim.physics.world import turned_by
from cube_sim.simulation import Scenario, Simulation, Throwing
from cube_sim.simulation.camera import Camera

NEEDED = ('~/throws', '~/settings', '~/resets')
STEP_NS = 2_000_000

SCENARIO = """
- {at: 0.0, camera: {position: [0.1, -0.2, 0.4], orientation: [0.1, 0.2, -0.3, 0.7]}}
- {at: 0.0, throw: {}}
- {at: 0.0111, throw: {speed: 5.7, spin: [11, -7, 0.3]}}
- {at: 0.1, camera: {orientation: [0.02, -0.12, -0.17, 0.97]}}
- {at: 0.123, throw: {}}
- {at: 0.2, set: {restitution: 0.83, throw_speed: 3.3}}
- {at: 0.25, set: {physics_model: impulse}}
- {at: 0.3, throw: {}}
- {at: 0.4, set: {gravity_direction: [0.3, -0.1, -0.9], friction: 0.21}}
- {at: 0.5, throw: {spin: [900, -1000, 100]}}
- {at: 0.6, reset: {}}
- {at: 0.6, throw: {}}
- {at: 0.61, camera: {position: [3.3, 0, 0.4], orientation: [0.5, -0.5, 0.1, -0.6]}}
- {at: 0.61, throw: {}}
- {at: 0.8, set: {physics_model: simple, tangential_factor: 0.7, cube_size: 0.3}}
- {at: 0.8, throw: {}}
- {at: 0.9, set: {physics_model: impulse, gravity: 3.71, gravity_direction: [0, 0, -1]}}
- {at: 1.1, throw: {speed: 0.1}}
"""


def stamp_of(stamp) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


class Again:
    """A second simulation that knows the first by its messages alone."""

    def __init__(self, messages: Iterable[tuple[str, bytes]]) -> None:
        self._due: list[tuple[int, str, object]] = []
        for topic, data in messages:
            if topic == '~/settings':
                event = decoded(data, 'rcl_interfaces/msg/ParameterEvent')
                settings = self._settings([*event.new_parameters, *event.changed_parameters])
                self._due.append((stamp_of(event.stamp), topic, settings))
            elif topic == '~/throws':
                throw = decoded(data, 'nav_msgs/msg/Odometry')
                self._due.append((stamp_of(throw.header.stamp), topic, throw))
            elif topic == '~/resets':
                stamp = stamp_of(decoded(data, 'std_msgs/msg/Header').stamp)
                self._due.append((stamp, topic, None))
        _, topic, first = self._due.pop(0)
        assert topic == '~/settings'
        self.world = World(first)

    @staticmethod
    def _settings(parameters) -> Settings:
        member = {1: 'bool_value', 3: 'double_value', 4: 'string_value', 8: 'double_array_value'}
        values = {
            item.name: plain(getattr(item.value, member[item.value.type])) for item in parameters
        }
        values['model'] = values.pop('physics_model')
        values['time_step_ns'] = round(values.pop('time_step') * 1e9)
        return Settings(**values)

    def until(self, time_ns: int) -> np.ndarray:
        """The poses after the step that ends at that time."""
        while self._due and self._due[0][0] < time_ns:
            stamp, topic, content = self._due.pop(0)
            self._step_to(stamp)
            if topic == '~/settings':
                self.world.configure(
                    **{name: getattr(content, name) for name in content.__dataclass_fields__}
                )
            elif topic == '~/resets':
                self.world.reset()
            else:
                self._throw(content)
        self._step_to(time_ns)
        return self.world.poses

    def _step_to(self, time_ns: int) -> None:
        # What was settled before the start of this second run is older than its time.
        self.world.step(max(0, time_ns // STEP_NS - self.world.steps))

    def _throw(self, message) -> None:
        pose, twist = plain(message.pose.pose), plain(message.twist.twist)
        orientation = list(pose['orientation'].values())
        index = self.world.throw(
            list(pose['position'].values()),
            orientation,
            turned_by(orientation, list(twist['linear'].values())),
            turned_by(orientation, list(twist['angular'].values())),
        )
        assert message.child_frame_id == f'cube_{index}'


def run(latched_at: int | None = None):
    """The scenario's run; what was latched after so many periods and the messages since."""
    outlet = CollectingOutlet()
    simulation = Simulation(
        outlet,
        Settings(restitution=0.37),
        Throwing(),
        camera=Camera(),
        scenario=Scenario.parse(SCENARIO),
        end=2000,
        period=5,
    )
    latched, since = None, 0
    periods = 0
    while not simulation.finished:
        if periods == latched_at:
            latched, since = simulation.latched(), len(outlet.messages)
        simulation.advance()
        if periods == 20:
            # Not only from a scenario: flown by hand, so that the orientation is no round number.
            simulation.fly_camera((0.3, 0.1, 0.2), (0.7, -0.9, 1.1), 0.123)
        periods += 1
    return outlet.messages, latched, outlet.messages[since:]


def bits(data: bytes) -> bytes:
    """The memory of the poses of a PoseArray: behind its header of frame `world`."""
    message = decoded(data, 'geometry_msgs/msg/PoseArray')
    return data[len(data) - 56 * len(message.poses) :]


def check(again: Again, messages) -> int:
    compared = 0
    for topic, time_ns, data in messages:
        if topic == '~/poses':
            assert again.until(time_ns).tobytes() == bits(data), f'at {time_ns} ns'
            compared += len(again.world)
    return compared


def test_a_run_can_be_simulated_again_from_its_events_to_the_same_bits():
    messages, _, _ = run()
    again = Again((topic, data) for topic, _, data in messages if topic in NEEDED)
    assert check(again, messages) > 500
    assert again.world.contacts > 50


@pytest.mark.parametrize('periods', [1, 21, 45, 59, 60, 61, 62, 85, 150])
def test_what_is_latched_suffices_to_simulate_all_that_follows(periods):
    # Before, at and after the reset, which comes before the step at 0.6 s, that is 60 periods.
    _, latched, since = run(latched_at=periods)
    needed = [(topic, data) for topic, data in latched if topic in NEEDED]
    later = [(topic, data) for topic, _, data in since if topic in NEEDED]
    again = Again([*needed, *later])
    assert check(again, since) > 200
