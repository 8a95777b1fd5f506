"""Run: what the topics of a simulator say, in the order in which it is to be shown."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.decode import (
    PoseArrayDecoder,
    read_header,
    read_odometry,
    read_parameter_event,
)

Floats = NDArray[np.float64]


class Frame(NamedTuple):
    """The cubes at one time."""

    number: int
    """Counts the changes; frames in between may never have been looked at."""
    time_ns: int
    poses: Floats
    """(N, 7), m, x y z qx qy qz qw."""
    cube_size: float


class Run:
    """
    Keeps the latest frame only. Messages come on one thread, frames are taken on another.

    Poses come once a period, throws and resets at once; those that were sent before the last throw
    or reset, and come late, are not shown any more.
    """

    def __init__(self) -> None:
        self._decode = PoseArrayDecoder()
        self._changed = threading.Condition()
        self._number = 0
        self._time_ns = 0
        self._posed_ns = -1
        self._floor_ns = -1
        self._poses: Floats = np.empty((0, 7))
        self._cube_size = 0.5

    def frame(self) -> Frame:
        """Return the latest frame."""
        with self._changed:
            return Frame(self._number, self._time_ns, self._poses, self._cube_size)

    def wait(self, number: int, seconds: float) -> bool:
        """Wait for a frame that is not that one, for so long; say whether there is."""
        with self._changed:
            return self._changed.wait_for(lambda: self._number != number, seconds)

    def wake(self) -> None:
        """Make `wait` return, as if something had changed."""
        with self._changed:
            self._touch()

    def clear(self) -> None:
        """Forget everything: the simulator has gone."""
        with self._changed:
            self._posed_ns = self._floor_ns = -1
            self._poses = np.empty((0, 7))
            self._touch()

    def take_poses(self, message: bytes) -> None:
        """Take a geometry_msgs/PoseArray of every cube."""
        view = self._decode(message)
        with self._changed:
            if view.time_ns < self._posed_ns:  # time never goes back: another simulator has come
                self._floor_ns = -1
            self._posed_ns = view.time_ns
            if view.time_ns <= self._floor_ns:
                return
            self._time_ns = view.time_ns
            self._poses = view.poses
            self._touch()

    def take_throw(self, message: bytes) -> None:
        """Take the nav_msgs/Odometry of a throw: the cube is there at once, paused or not."""
        throw = read_odometry(message)
        index = throw.child_frame_id.removeprefix('cube_')
        with self._changed:
            if index.isdigit() and int(index) == len(self._poses):
                self._poses = np.concatenate([self._poses, throw.pose[None]])
                self._floor_ns = throw.time_ns
                self._touch()

    def take_reset(self, message: bytes) -> None:
        """Take the std_msgs/Header of a reset: the cubes are gone at once."""
        time_ns, _ = read_header(message)
        with self._changed:
            if time_ns >= self._posed_ns:  # not one of those that are kept for who comes late
                self._poses = np.empty((0, 7))
                self._floor_ns = time_ns
                self._touch()

    def take_settings(self, message: bytes) -> None:
        """Take an rcl_interfaces/ParameterEvent of the physics."""
        event = read_parameter_event(message)
        size = {**event.new, **event.changed}.get('cube_size')
        if isinstance(size, float):
            with self._changed:
                self._cube_size = size
                self._touch()

    def _touch(self) -> None:
        self._number += 1
        self._changed.notify_all()
