"""Live: a simulator on pages, from what its topics say and through its services."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import viser
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_parameter_events
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from cube_sim.remote import SimulatorLink
from cube_sim.remote.link import LATCHED
from cube_sim.web.heights import beside
from cube_sim.web.panel import KEYS, PARAMETERS, Panel
from cube_sim.web.run import Run
from cube_sim.web.stage import NO_LINES, Stage, lines_of
from cube_sim.web.thrower import Thrower
from cube_sim.web.visitor import Visitor

Floats = NDArray[np.float64]

# The most frames that go to the pages, and how often texts and plots are redrawn, 1/s.
FRAMES = 60.0
_TEXTS = 5.0

# What is kept of throws and resets for those who come late.
_DEEP = QoSProfile(depth=10_000, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_HOTKEYS = (
    ('reset', 'Remove all cubes', 'R'),
    ('pause', 'Pause, go on', 'P'),
    ('step', 'One step', 'N'),
    ('record', 'Record a bag, on and off', 'B'),
    ('next_model', 'Next physics model', 'tab'),
)


class Live:
    """Shows the simulator at the other end of `link` on the pages of `server`."""

    def __init__(
        self, server: viser.ViserServer, link: SimulatorLink, *, shadows: bool = True
    ) -> None:
        """Build pages and subscriptions; `start` brings them to life."""
        self.frames = 0
        """How many frames went to the pages."""
        self._link = link
        self._run = Run()
        self.stage = Stage(server, shadows=shadows)
        """What the pages show."""
        self._thrower = Thrower(link)
        self._visitors: dict[int, Visitor] = {}
        self._panel = Panel(server.gui, link, self._throw, self._look_for_contacts)
        self._heights = beside(server.gui, KEYS)
        self._present = False
        self._closing = False
        self._ground: bytes | None = None
        self._contacts: Floats | None = None
        self._contacts_subscription: Any = None
        self._server = server
        self._subscribe()
        self._bind_keys()
        self._thread = threading.Thread(target=self._show, name='frames', daemon=True)

    def start(self) -> None:
        """Begin to show."""
        self._link.on_change = self._run.wake
        self._link.on_camera = self._camera_moved
        self._thrower.start()
        self._thread.start()
        self._server.on_client_connect(self._come)
        self._server.on_client_disconnect(self._go)
        self._link.start()

    def close(self) -> None:
        """End everything but the server, the link included."""
        self._closing = True
        self._run.wake()
        self._link.on_change = lambda: None
        self._thrower.close()
        self._link.close()
        self._thread.join(5.0)

    def _subscribe(self) -> None:
        name = self._link.simulator
        for kind, topic, take, qos in (
            (PoseArray, 'poses', self._run.take_poses, QoSProfile(depth=1)),
            (Odometry, 'throws', self._run.take_throw, _DEEP),
            (Header, 'resets', self._run.take_reset, _DEEP),
            (ParameterEvent, 'settings', self._run.take_settings, _DEEP),
            (Marker, 'ground', self._take_ground, LATCHED),
        ):
            self._link.listen(kind, f'{name}/{topic}', take, qos)
        self._link.node.create_subscription(
            ParameterEvent, '/parameter_events', self._take_event, qos_profile_parameter_events
        )

    def _bind_keys(self) -> None:
        gui = self._server.gui

        async def throw(event: Any) -> None:
            self._throw(event.client)

        gui.add_command('Throw a cube', hotkey='space').on_trigger(throw)
        for service, label, key in _HOTKEYS:

            async def call(event: Any, service: str = service) -> None:
                self._panel.do(service, event.client)

            gui.add_command(label, hotkey=key).on_trigger(call)  # type: ignore[arg-type]

        async def contacts(event: Any) -> None:
            self._panel.turn_contacts()

        gui.add_command('Contact points, on and off', hotkey='C').on_trigger(contacts)

    async def _come(self, client: viser.ClientHandle) -> None:
        visitor = Visitor(client, self._thrower)
        visitor.show_camera(self._link.camera)
        self._visitors[client.client_id] = visitor

    async def _go(self, client: viser.ClientHandle) -> None:
        self._visitors.pop(client.client_id, None)

    def _throw(self, client: viser.ClientHandle) -> None:
        visitor = self._visitors.get(client.client_id)
        if visitor is not None:
            visitor.throw()

    def _camera_moved(self, pose: Any) -> None:
        self._thrower.camera_is_at(pose)
        self._run.wake()

    def _take_ground(self, message: bytes) -> None:
        self._ground = bytes(message)
        self._run.wake()

    def _look_for_contacts(self, wanted: bool) -> None:
        """Listen to contacts, or no longer: the simulator gathers them for who listens."""
        link = self._link
        if wanted and self._contacts_subscription is None:
            topic = f'{link.simulator}/contacts'
            take = self._take_contacts
            self._contacts_subscription = link.listen(Marker, topic, take, QoSProfile(depth=1))
        elif not wanted and self._contacts_subscription is not None:
            link.node.destroy_subscription(self._contacts_subscription)
            self._contacts_subscription = None
            self._contacts = NO_LINES
            self._run.wake()

    def _take_contacts(self, message: bytes) -> None:
        self._contacts = lines_of(message)
        self._run.wake()

    def _take_event(self, event: ParameterEvent) -> None:
        if event.node == self._link.simulator:
            changed = [*event.new_parameters, *event.changed_parameters]
            self._panel.learn({p.name: parameter_value_to_python(p.value) for p in changed})

    def _show(self) -> None:
        """Show what has changed, at most FRAMES times a second; a slow page gets fewer."""
        number, texts_due = -1, 0.0
        while not self._closing:
            began = time.monotonic()
            if self._run.wait(number, max(0.0, texts_due - began)):
                number = self._show_frame(number)
            now = time.monotonic()
            if now >= texts_due:
                texts_due = now + 1.0 / _TEXTS
                self._show_texts()
            threading.Event().wait(max(0.0, began + 1.0 / FRAMES - now))

    def _show_frame(self, number: int) -> int:
        link = self._link
        if link.present != self._present:
            self._present = link.present
            if self._present:
                link.get_parameters(PARAMETERS, self._panel.learn)
            else:
                self._run.clear()
        ground, self._ground = self._ground, None
        if ground is not None:
            self.stage.show_ground(ground)
        contacts, self._contacts = self._contacts, None
        if contacts is not None:
            self.stage.show_contacts(contacts)
        frame = self._run.frame()
        self.stage.show_cubes(frame.poses, frame.cube_size)
        self._heights.add(frame.time_ns / 1e9, frame.poses, len(frame.poses))
        for visitor in tuple(self._visitors.values()):
            visitor.show_camera(link.camera)
        self.frames += 1
        return frame.number

    def _show_texts(self) -> None:
        frame = self._run.frame()
        self._panel.show(self._link.status, len(frame.poses), frame.time_ns)
        self._heights.draw()
