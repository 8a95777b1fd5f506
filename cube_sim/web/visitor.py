"""Visitor: one open page, its camera, and what it is shown of the simulator's."""

from __future__ import annotations

import threading

import numpy as np
import viser
from numpy.typing import NDArray

from cube_sim.remote import Answer
from cube_sim.web.axes import body_pose, look_at, same_pose
from cube_sim.web.panel import refuse
from cube_sim.web.stage import CameraSign
from cube_sim.web.thrower import Thrower

Floats = NDArray[np.float64]

# Throws of a page that are still to be done; a key that is held asks for no more.
_MOST_THROWS = 3
# How far ahead of the camera lies the point about which a page that follows it turns, m.
_AHEAD = 5.0


class Visitor:
    """A page; made when it connects, dropped when it goes."""

    def __init__(self, client: viser.ClientHandle, thrower: Thrower) -> None:
        """Add what is this page's alone."""
        self._client = client
        self._thrower = thrower
        self._lock = threading.Lock()
        self._throws = 0
        self._own: Floats | None = None
        self._camera: Floats | None = None
        self._sign = CameraSign(client.scene)
        self._follow = client.gui.add_checkbox(
            'Follow the camera',
            False,
            hint="This page looks where the simulator's camera looks, as teleop_key flies it",
        )

        @self._follow.on_update
        async def _(_: object) -> None:
            camera, self._camera = self._camera, None
            self.show_camera(camera)

    def throw(self) -> None:
        """Throw a cube from where this page looks now; in viser's event loop."""
        with self._lock:
            if self._throws >= _MOST_THROWS:
                return
            self._throws += 1
        camera = self._client.camera
        pose = body_pose(camera.position, camera.wxyz)
        self._own = pose
        self._thrower.throw(pose, self._thrown)

    def show_camera(self, pose: Floats | None) -> None:
        """Show where the simulator's camera is, unless it is this page's own."""
        if pose is None or (self._camera is not None and same_pose(pose, self._camera)):
            return
        self._camera = pose
        following = bool(self._follow.value)
        own = self._own is not None and same_pose(pose, self._own)
        self._sign.show(pose, visible=not (following or own))
        if following:
            self._client.camera.position = pose[:3]
            self._client.camera.look_at = look_at(pose, _AHEAD)

    def _thrown(self, answer: Answer) -> None:
        with self._lock:
            self._throws -= 1
        if not answer.success:
            refuse(self._client, answer.message)
