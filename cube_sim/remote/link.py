"""SimulatorLink: a simulator's services, parameters and camera, whether it answers or not."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from numpy.typing import NDArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from cube_sim.messages.decode import MessageError, read_clock, read_pose_stamped
from cube_sim.remote.serving import Serving
from cube_sim.remote.status import Status, status_of

Floats = NDArray[np.float64]

SERVICES: dict[str, Any] = {
    'throw': Trigger,
    'reset': Trigger,
    'pause': SetBool,
    'step': Trigger,
    'record': SetBool,
    'next_model': Trigger,
}

# A service that has not answered for this long is taken not to, s.
ANSWER_DEADLINE = 5.0
# /diagnostics comes once a second; a simulator not heard of for this long has gone, s.
SILENCE = 4.0
_LOOK_AGAIN = 0.25

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass(frozen=True)
class Answer:
    """What a service said, or why it said nothing."""

    success: bool
    message: str


Done = Callable[[Answer], None]


@dataclass
class _Call:
    """A request whose answer is still to come."""

    client: Any
    deadline: float
    take: Callable[[Any], None]
    fail: Callable[[str], None]


class SimulatorLink:
    """
    Talks to the simulator called `simulator` from a node of its own.

    Nothing here waits: what is asked for is answered through `done`, on the link's thread, and
    always, be it with why there was no answer. `on_change` and `on_camera` are called there too.
    """

    def __init__(
        self,
        simulator: str,
        *,
        name: str,
        context: Context | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        """Make the node `name`; `start` begins to listen."""
        self.simulator = simulator
        self.on_change = on_change
        self.on_camera: Callable[[Floats], None] = lambda pose: None
        self.node = Node(name, context=context, start_parameter_services=False)
        self._serving = Serving(self.node)
        self._lock = threading.Lock()
        self._status = Status()
        self._present = False
        self._heard = -SILENCE
        self._camera: Floats | None = None
        self._calls: dict[Any, _Call] = {}
        self._clients = {
            service: self.node.create_client(kind, f'{simulator}/{service}')
            for service, kind in SERVICES.items()
        }
        self._get = self.node.create_client(GetParameters, f'{simulator}/get_parameters')
        self._set = self.node.create_client(SetParameters, f'{simulator}/set_parameters')
        self._velocity = self.node.create_publisher(Twist, f'{simulator}/camera/cmd_vel', 10)
        self._placing = self.node.create_publisher(PoseStamped, f'{simulator}/camera/set_pose', 10)
        self.listen(PoseStamped, f'{simulator}/camera/pose', self._take_camera, LATCHED)
        self.listen(Clock, '/clock', self._take_clock, _LATEST)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take_diagnostics, 10)
        steady = RosClock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(_LOOK_AGAIN, self._look, clock=steady)

    @property
    def present(self) -> bool:
        """Whether the simulator answers."""
        return self._present

    @property
    def status(self) -> Status:
        """How it is doing."""
        with self._lock:
            return self._status

    @property
    def camera(self) -> Floats | None:
        """Where it throws from: x y z qx qy qz qw, m; None as long as that is not known."""
        return self._camera

    @property
    def absence(self) -> str:
        """A sentence for when the simulator is not present."""
        return f'No simulator answers on {self.simulator}; sim_node or make run starts one.'

    def listen(self, kind: Any, topic: str, take: Callable[[bytes], None], qos: Any) -> Any:
        """
        Hand the bytes of every message of `topic` to `take`; MessageError drops one.

        Return the subscription, which `node.destroy_subscription` ends.
        """

        def callback(message: bytes) -> None:
            try:
                take(message)
            except MessageError as error:
                self.node.get_logger().warning(f'{topic}: {error}', throttle_duration_sec=5.0)

        return self.node.create_subscription(kind, topic, callback, qos, raw=True)

    def start(self) -> None:
        """Begin to listen."""
        self._serving.start()

    def close(self) -> None:
        """End the node; what is still unanswered is told so."""
        self._serving.close()
        self._give_up(float('inf'), 'The link to the simulator is closed.')

    def call(self, service: str, done: Done = lambda _: None, data: bool | None = None) -> None:
        """Call one of SERVICES; `data` is what a SetBool is given."""
        kind = SERVICES[service]
        request = kind.Request() if data is None else kind.Request(data=data)

        def take(response: Any) -> None:
            answer = Answer(response.success, response.message)
            if answer.success:
                self._learn(service, data, answer.message)
            done(answer)

        self._request(self._clients[service], request, take, lambda why: done(Answer(False, why)))

    def set_parameter(self, name: str, value: Any, done: Done = lambda _: None) -> None:
        """Set a parameter of the simulator; a refusal's message says why."""
        message = ParameterMessage(
            name=name, value=Parameter(name, value=value).get_parameter_value()
        )

        def take(response: Any) -> None:
            result = response.results[0]
            done(Answer(result.successful, result.reason))

        request = SetParameters.Request(parameters=[message])
        self._request(self._set, request, take, lambda why: done(Answer(False, why)))

    def get_parameters(self, names: Sequence[str], done: Callable[[dict[str, Any]], None]) -> None:
        """Ask for parameters; `done` gets those that there are, none when no answer comes."""

        def take(response: Any) -> None:
            values = [parameter_value_to_python(value) for value in response.values]
            found = zip(names, values, strict=False)
            done({name: value for name, value in found if value is not None})

        self._request(self._get, GetParameters.Request(names=names), take, lambda _: done({}))

    def fly(self, linear: Iterable[float], angular: Iterable[float]) -> None:
        """Fly the camera, m/s and rad/s in its own axes, for half a second at most."""
        velocity = Twist(linear=Vector3(), angular=Vector3())
        velocity.linear.x, velocity.linear.y, velocity.linear.z = map(float, linear)
        velocity.angular.x, velocity.angular.y, velocity.angular.z = map(float, angular)
        self._velocity.publish(velocity)

    def place(self, pose: Floats) -> None:
        """Put the camera at x y z qx qy qz qw, m; x forward, y left, z up."""
        x, y, z, qx, qy, qz, qw = map(float, pose)
        place, turn = Point(x=x, y=y, z=z), Quaternion(x=qx, y=qy, z=qz, w=qw)
        self._placing.publish(PoseStamped(pose=Pose(position=place, orientation=turn)))

    def update(self, **changes: Any) -> None:
        """Note what has been learnt of the simulator's status."""
        with self._lock:
            self._status = dataclasses.replace(self._status, **changes)
        self.on_change()

    def heard(self) -> None:
        """Note a sign of life."""
        self._heard = time.monotonic()

    def _learn(self, service: str, data: bool | None, message: str) -> None:
        if service == 'throw' and message.isdigit():
            self.update(cubes=int(message) + 1)
        elif service == 'reset':
            self.update(cubes=0)
        elif service == 'next_model':
            self.update(model=message)
        elif service == 'pause':
            self.update(paused=bool(data))
        elif service == 'record':
            self.update(bag=message if data else '')

    def _request(
        self,
        client: Any,
        request: Any,
        take: Callable[[Any], None],
        fail: Callable[[str], None],
    ) -> None:
        if not client.service_is_ready():
            fail(self.absence)
            return
        future = client.call_async(request)
        deadline = time.monotonic() + ANSWER_DEADLINE
        with self._lock:
            self._calls[future] = _Call(client, deadline, take, fail)
        future.add_done_callback(self._answered)

    def _answered(self, future: Any) -> None:
        with self._lock:
            call = self._calls.pop(future, None)
        if call is not None and not future.cancelled():
            self.heard()
            call.take(future.result())

    def _give_up(self, now: float, why: str) -> None:
        with self._lock:
            late = [(f, call) for f, call in self._calls.items() if call.deadline < now]
            for future, _ in late:
                del self._calls[future]
        for future, call in late:
            call.client.remove_pending_request(future)
            call.fail(why)

    def _look(self) -> None:
        now = time.monotonic()
        self._give_up(now, f'No answer came from {self.simulator} in {ANSWER_DEADLINE:g} s.')
        present = now - self._heard < SILENCE and self._clients['throw'].service_is_ready()
        if present != self._present:
            self._present = present
            if not present:
                self._camera = None
                with self._lock:
                    self._status = Status()
            self.on_change()

    def _take_camera(self, message: bytes) -> None:
        self._camera = np.array(read_pose_stamped(message).pose)
        self.heard()
        self.on_camera(self._camera)

    def _take_clock(self, message: bytes) -> None:
        time_ns = read_clock(message)
        with self._lock:
            self._status = dataclasses.replace(self._status, time_ns=time_ns)
        self.heard()

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        status = status_of(message)
        if status is not None:
            self.heard()
            with self._lock:
                self._status = status
            self.on_change()
