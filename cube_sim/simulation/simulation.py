"""The run itself: throws, settings and publications in the order of simulated time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from cube_sim.messages import events, markers, poses
from cube_sim.physics import PhysicsError, Settings, World
from cube_sim.physics.models import next_model
from cube_sim.physics.world import turned_by
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.ground import ground_triangles
from cube_sim.simulation.parameters import (
    THROWING,
    physics_parameters,
    settings_with,
    throwing_with,
)
from cube_sim.simulation.scenario import Entry, Place, Scenario, Set, Throw
from cube_sim.simulation.throwing import Throwing

# Topics by their private names, as the node resolves them.
POSES, MARKERS, GROUND, CONTACTS = '~/poses', '~/markers', '~/ground', '~/contacts'
THROWS, SETTINGS, RESETS = '~/throws', '~/settings', '~/resets'
CAMERA_POSE, CLOCK = '~/camera/pose', '/clock'


class Outlet(Protocol):
    """Where the messages of a run go."""

    def wants(self, topic: str) -> bool:
        """Say whether anyone takes `topic` now; if not, its messages are not even built."""

    def send(self, topic: str, time_ns: int, message: bytes) -> None:
        """Take a message (CDR) of simulated time `time_ns`."""


class Simulation:
    """
    A world, its camera and its scenario, run from one publication to the next.

    Everything here happens between two steps and carries the time of the next one. One thread
    at a time may call. `report` gets a sentence for what a scenario asks and cannot have,
    `announce` the parameters that it has set.
    """

    def __init__(
        self,
        outlet: Outlet,
        settings: Settings,
        throwing: Throwing,
        *,
        camera: Camera,
        scenario: Scenario | None = None,
        period: int = 10,
        end: int | None = None,
        frame_id: str = 'world',
        node_name: str = '/cube_sim',
        report: Callable[[str], None] = print,
        announce: Callable[[Mapping[str, Any]], None] = lambda changes: None,
    ) -> None:
        """
        Start at time 0 and send what is latched.

        `period` is the number of steps between publications; the run ends after `end` steps.
        """
        self._outlet = outlet
        self._world = World(settings)
        self._throwing = throwing
        self._camera = camera
        self._entries = list(scenario.entries) if scenario else []
        self._scenario_name = scenario.name if scenario else ''
        self._next_entry = 0
        self._period = period
        self._next_publication = period
        self._end = end
        self._frame_id = frame_id
        self._node_name = node_name
        self._report = report
        self._announce = announce
        self._marked = 0
        self._events: list[tuple[str, bytes]] = []
        self._latest: dict[str, bytes] = {}
        self.physics_ns = 0
        self.messages_ns = 0
        points, colors = ground_triangles()
        self._latch(GROUND, markers.triangle_list(0, frame_id, 'ground', points, colors))
        self._send_settings(new=True)
        self._send_camera()

    @property
    def world(self) -> World:
        """The cubes and the time; to look at."""
        return self._world

    @property
    def throwing(self) -> Throwing:
        """What a throw takes by default."""
        return self._throwing

    @property
    def camera(self) -> Camera:
        """The camera; to look at."""
        return self._camera

    @property
    def period_ns(self) -> int:
        """The simulated time between two publications, ns."""
        return self._period * self._world.settings.time_step_ns

    @property
    def next_publication_ns(self) -> int:
        """The simulated time of the next publication, ns."""
        return self._next_publication * self._world.settings.time_step_ns

    @property
    def finished(self) -> bool:
        """Whether the run has reached its end."""
        return self._end is not None and self._world.steps >= self._end

    def latched(self) -> list[tuple[str, bytes]]:
        """
        Return the messages that whoever comes late needs, oldest first.

        Ground and camera as they are; the settings, throws and resets from which the present
        cubes can be simulated again.
        """
        return [*self._latest.items(), *self._events]

    def advance(self) -> None:
        """Run to the next publication (or the end), and publish there."""
        if self.finished:
            return
        world = self._world
        goal = (
            self._next_publication if self._end is None else min(self._next_publication, self._end)
        )
        while True:
            until = self._play_entries(goal)
            start = time.perf_counter_ns()
            world.step(until - world.steps)
            self.physics_ns += time.perf_counter_ns() - start
            if until == goal:
                break
        if world.steps == self._next_publication:
            self._next_publication += self._period
            start = time.perf_counter_ns()
            self._publish()
            self.messages_ns += time.perf_counter_ns() - start

    def throw(self, speed: float | None = None, spin: ArrayLike | None = None) -> int:
        """
        Throw a cube from the camera along its x axis and return its index.

        `speed` (m/s) and `spin` (3,) (rad/s, camera axes) are those of the settings if None.
        PhysicsError when there are `max_cubes` already.
        """
        limit = self._throwing.max_cubes
        if len(self._world) >= limit:
            raise PhysicsError(
                f'There are {limit} cubes already: reset, or raise the parameter max_cubes.'
            )
        linear = (self._throwing.throw_speed if speed is None else speed, 0.0, 0.0)
        angular = self._throwing.throw_spin if spin is None else spin
        # The cube is turned as the camera: the camera's axes are its own at this instant, and
        # the twist in them is what the message holds and what the velocities come from.
        twist = np.concatenate([np.asarray(linear, float), np.asarray(angular, float)])
        camera = self._camera
        index = self._world.throw(
            camera.position,
            camera.orientation,
            turned_by(camera.orientation, twist[:3]),
            turned_by(camera.orientation, twist[3:]),
        )
        message = events.odometry(
            self._world.time_ns, self._frame_id, f'cube_{index}', camera.pose, twist
        )
        self._record(THROWS, message)
        return index

    def reset(self) -> None:
        """Remove all cubes; time goes on."""
        self._world.reset()
        # Nothing of the cubes that are gone is needed any more, only what holds now.
        self._events = [next(event for event in reversed(self._events) if event[0] == SETTINGS)]
        self._record(RESETS, events.header(self._world.time_ns, self._frame_id))

    def check(self, changes: Mapping[str, Any]) -> None:
        """Raise PhysicsError when these parameters could not be set."""
        settings_with(self._world.settings, changes)
        throwing_with(self._throwing, changes)

    def configure(self, changes: Mapping[str, Any]) -> None:
        """Set parameters by their ROS names from the next step on; PhysicsError changes nothing."""
        throwing = throwing_with(self._throwing, changes)
        settings = settings_with(self._world.settings, changes)
        if settings != self._world.settings:
            self._world.configure(
                **{field: getattr(settings, field) for field in settings.__dataclass_fields__}
            )
            self._send_settings(new=False)
        self._throwing = throwing

    def next_model(self) -> str:
        """Return the name of the model after the present one, as TAB would choose it."""
        return next_model(self._world.settings.model)

    def place_camera(self, position: ArrayLike | None, orientation: ArrayLike | None) -> None:
        """Put the camera somewhere; None keeps; PhysicsError changes nothing."""
        self._camera.place(
            self._camera.position if position is None else position,
            self._camera.orientation if orientation is None else orientation,
        )
        self._send_camera()

    def fly_camera(self, linear: ArrayLike, angular: ArrayLike, seconds: float) -> None:
        """Move the camera for `seconds` at a velocity in its own axes, m/s and rad/s."""
        self._camera.fly(linear, angular, seconds)
        self._send_camera()

    def set_period(self, period: int) -> None:
        """Publish every `period` steps from now on."""
        self._period = period
        self._next_publication = self._world.steps + period

    def parameters(self) -> dict[str, Any]:
        """Return the present value of every parameter that a scenario may set."""
        values = physics_parameters(self._world.settings)
        values.update({name: getattr(self._throwing, name) for name in THROWING})
        return values

    def _play_entries(self, goal: int) -> int:
        """Do what is due before the next step; return the step at which more is, at most goal."""
        step_ns = self._world.settings.time_step_ns
        while self._next_entry < len(self._entries):
            entry = self._entries[self._next_entry]
            due = -(-entry.time_ns // step_ns)
            if due > self._world.steps:
                return min(due, goal)
            self._next_entry += 1
            self._play(entry)
        return goal

    def _play(self, entry: Entry) -> None:
        try:
            action = entry.action
            if isinstance(action, Throw):
                self.throw(action.speed, action.spin)
            elif isinstance(action, Place):
                self.place_camera(action.position, action.orientation)
            elif isinstance(action, Set):
                self.configure(action.values)
                # As the records hold them: a scenario may say 10.0 where a whole number is meant.
                now = self.parameters()
                self._announce({name: now[name] for name in action.values})
            else:
                self.reset()
        except PhysicsError as error:
            self._report(f'{self._scenario_name}:{entry.line}: {error}')

    def _publish(self) -> None:
        world = self._world
        time_ns = world.time_ns
        if self._outlet.wants(CLOCK):
            self._outlet.send(CLOCK, time_ns, events.clock(time_ns))
        if self._outlet.wants(POSES):
            message = poses.pose_array(time_ns, self._frame_id, world.poses)
            self._outlet.send(POSES, time_ns, message)
        if self._outlet.wants(MARKERS):
            self._publish_markers(time_ns)
        if self._outlet.wants(CONTACTS):
            self._publish_contacts(time_ns)

    def _publish_markers(self, time_ns: int) -> None:
        size = self._world.settings.cube_size
        removed = max(0, self._marked - len(self._world))
        self._marked = len(self._world)
        message = markers.cube_markers(time_ns, self._frame_id, self._world.poses, size, removed)
        self._outlet.send(MARKERS, time_ns, message)

    def _publish_contacts(self, time_ns: int) -> None:
        points = self._world.contact_points
        size = self._world.settings.cube_size
        message = markers.contact_lines(
            time_ns, self._frame_id, points.positions, points.normals, size
        )
        self._outlet.send(CONTACTS, time_ns, message)

    def _send_settings(self, *, new: bool) -> None:
        values = physics_parameters(self._world.settings)
        message = events.parameter_event(
            self._world.time_ns,
            self._node_name,
            values if new else {},
            {} if new else values,
        )
        self._record(SETTINGS, message)

    def _send_camera(self) -> None:
        message = poses.pose_stamped(self._world.time_ns, self._frame_id, self._camera.pose)
        self._latch(CAMERA_POSE, message)

    def _record(self, topic: str, message: bytes) -> None:
        self._events.append((topic, message))
        self._outlet.send(topic, self._world.time_ns, message)

    def _latch(self, topic: str, message: bytes) -> None:
        self._latest[topic] = message
        self._outlet.send(topic, self._world.time_ns, message)


def steps_at(seconds: float, time_step_ns: int) -> int:
    """Return the first step that starts at or after that time."""
    return math.ceil(round(seconds * 1e9) / time_step_ns)
