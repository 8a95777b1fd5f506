"""SimNode: a Simulation with publishers, services and parameters around it."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped, Twist
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.serialization import deserialize_message, serialize_message
from std_srvs.srv import SetBool, Trigger

from cube_sim.node import parameters, topics
from cube_sim.node.diagnostics import diagnostic_array
from cube_sim.node.outlet import NodeOutlet
from cube_sim.physics import PhysicsError
from cube_sim.physics.settings import Settings
from cube_sim.physics.world import VELOCITY_LIMIT, vectors
from cube_sim.recording import Recorder, RecordingError, new_bag_path
from cube_sim.simulation import Scenario, ScenarioError, Simulation, Throwing
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.parameters import CHANGEABLE, PHYSICS, THROWING, settings_with
from cube_sim.simulation.runner import Runner
from cube_sim.simulation.simulation import steps_at

# A camera that hears no velocity for this long stops, s.
CMD_VEL_TIMEOUT = 0.5


class SimNode(Node):
    """
    The node of the contract: throws, poses, markers, settings and bags.

    The simulation runs in a thread of its own; callbacks hand it commands, which take effect
    between steps. Call `close` before the context goes.
    """

    def __init__(self, *, on_finished: Callable[[], None] = lambda: None, **options: Any) -> None:
        """Set up and start to run; `on_finished` is called when `duration` is over."""
        super().__init__(
            'cube_sim', automatically_declare_parameters_from_overrides=True, **options
        )
        values = parameters.declare(self)
        self._closing = threading.Lock()
        self._closed = False
        self._bag_directory = values['bag_directory']
        self._bag_name = values['bag_name']
        self._bag_options: dict[str, Any] = {
            'compression': values['bag_compression'],
            'max_bytes': values['max_bag_size'],
            'max_duration_ns': round(values['max_bag_duration'] * 1e9),
        }
        self._outlet = NodeOutlet(
            publish_clock=values['publish_clock'], record_markers=values['record_markers']
        )
        for spec in topics.PUBLISHED:
            publisher = self.create_publisher(spec.message, spec.name, spec.qos())
            self._outlet.publishers[spec.name] = publisher
        self._simulation = self._make_simulation(values)
        self._runner = Runner(
            self._simulation,
            real_time_factor=values['real_time_factor'],
            paused=values['start_paused'],
            on_finished=on_finished,
        )
        if values['record']:
            try:
                self._start_recording()
            except RecordingError as error:
                self.get_logger().error(f'{error} The simulation runs without a recording.')
        self._create_services()
        self._create_subscriptions()
        self.add_pre_set_parameters_callback(self._converted)
        self.add_on_set_parameters_callback(self._checked)
        self.add_post_set_parameters_callback(self._applied)
        self._before = self._runner.progress()
        self._dropped_before = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)
        self._runner.start()

    @property
    def simulation(self) -> Simulation:
        """The simulation; to look at. It belongs to the runner's thread."""
        return self._simulation

    @property
    def runner(self) -> Runner:
        """The pace, and the way to have something done between steps."""
        return self._runner

    @property
    def bag_path(self) -> Path | None:
        """The bag that is being recorded."""
        recorder = self._outlet.recorder
        return recorder.path if recorder else None

    def close(self) -> Path | None:
        """Stop the simulation and finish the bag; return its path, if one was recorded."""
        with self._closing:
            if self._closed:
                return None
            self._closed = True
        self._runner.stop()
        recorder = self._outlet.detach()
        return recorder.close() if recorder else None

    def destroy_node(self) -> None:
        """Close, then destroy."""
        self.close()
        super().destroy_node()

    def _make_simulation(self, values: Mapping[str, Any]) -> Simulation:
        settings = settings_with(Settings(), {name: values[name] for name in PHYSICS})
        scenario = None
        if values['scenario']:
            try:
                scenario = Scenario.load(values['scenario'])
            except ScenarioError as error:
                self.get_logger().error(f'{error} The simulation runs without a scenario.')
        duration = values['duration']
        return Simulation(
            self._outlet,
            settings,
            Throwing(**{name: values[name] for name in THROWING}),
            camera=Camera(values['camera.position'], values['camera.orientation']),
            scenario=scenario,
            period=parameters.steps_of_period(values['publish_rate'], settings.time_step_ns),
            end=steps_at(duration, settings.time_step_ns) if duration else None,
            frame_id=values['frame_id'],
            node_name=self.get_fully_qualified_name(),
            report=lambda sentence: self.get_logger().warning(sentence),
            announce=lambda changes: self._announce(changes),
        )

    # Services.

    def _create_services(self) -> None:
        for name, kind, answer in (
            ('~/throw', Trigger, self._throw),
            ('~/reset', Trigger, self._reset),
            ('~/pause', SetBool, self._pause),
            ('~/step', Trigger, self._step),
            ('~/record', SetBool, self._record),
            ('~/next_model', Trigger, self._next_model),
        ):
            self.create_service(kind, name, _answering(answer))

    def _throw(self, _: Trigger.Request) -> str:
        return str(self._runner.do(self._simulation.throw))

    def _reset(self, _: Trigger.Request) -> str:
        def reset() -> int:
            removed = len(self._simulation.world)
            self._simulation.reset()
            return removed

        return f'{self._runner.do(reset)} cubes removed'

    def _pause(self, request: SetBool.Request) -> str:
        def pause() -> str:
            self._runner.pause(request.data)
            word = 'paused' if request.data else 'running'
            return f'{word} at {self._simulation.world.time_ns / 1e9:.3f} s'

        return self._runner.do(pause)

    def _step(self, _: Trigger.Request) -> str:
        def step() -> str:
            if not self._runner.paused:
                raise PhysicsError('Only a paused simulation can be stepped: call pause first.')
            if self._simulation.finished:
                raise PhysicsError('The simulation has reached its duration.')
            self._simulation.advance()
            return f'{self._simulation.world.time_ns / 1e9:.3f} s'

        return self._runner.do(step)

    def _record(self, request: SetBool.Request) -> str:
        if request.data:
            return str(self._start_recording())
        recorder = self._runner.do(self._outlet.detach)
        if recorder is None:
            raise RecordingError('Nothing is being recorded.')
        self._dropped_before = 0
        path = recorder.close()
        if recorder.error is not None:
            raise RecordingError(recorder.error)
        return str(path)

    def _next_model(self, _: Trigger.Request) -> str:
        model = self._runner.do(self._simulation.next_model)
        result = self.set_parameters([RosParameter('physics_model', value=model)])[0]
        if not result.successful:
            raise PhysicsError(result.reason)
        return model

    def _start_recording(self) -> Path:
        if self._outlet.recorder is not None:
            raise RecordingError(f'Already recording to {self._outlet.recorder.path}.')
        try:
            directory = Path(self._bag_directory).expanduser()
        except RuntimeError as error:  # "~" of a user that is not there
            raise RecordingError(f'bag_directory is {self._bag_directory!r}: {error}') from None
        specs = [
            spec
            for spec in (*topics.PUBLISHED, *topics.SUBSCRIBED)
            if spec.name != topics.CONTACTS  # to look at; they can be computed again
        ]
        names = {spec.name: self.resolve_topic_name(spec.name) for spec in specs}
        recorder = Recorder(
            self._bag_path(directory),
            [spec.recorded(names[spec.name]) for spec in specs],
            on_error=lambda sentence: self.get_logger().error(sentence),
            on_notice=lambda sentence: self.get_logger().warning(sentence),
            **self._bag_options,
        )

        def attach() -> None:
            time_ns = self._simulation.world.time_ns
            self._outlet.attach(recorder, names, time_ns, self._simulation.latched())

        try:
            self._runner.do(attach)
        except RuntimeError:  # the simulation has stopped; an empty bag is still to be whole
            recorder.close()
            raise
        return recorder.path

    def _bag_path(self, directory: Path) -> Path:
        """Return where the next bag goes; the given name is that of the first."""
        name, self._bag_name = self._bag_name, ''
        if not name:
            return new_bag_path(directory, datetime.now())
        if name in ('.', '..') or '/' in name:
            raise RecordingError(f'bag_name is {name!r}: a name without a slash is needed.')
        return directory / str(name)

    # The camera.

    def _create_subscriptions(self) -> None:
        # Raw, so that the bag holds the very bytes that came.
        for spec, take in zip(
            topics.SUBSCRIBED, (self._set_camera_pose, self._set_camera_velocity), strict=True
        ):
            self.create_subscription(
                spec.message, spec.name, self._taking(spec, take), spec.qos(), raw=True
            )

    def _taking(
        self, spec: topics.TopicSpec, take: Callable[[Any], None]
    ) -> Callable[[bytes], None]:
        def callback(message: bytes) -> None:
            def command() -> None:
                time_ns = self._simulation.world.time_ns
                self._outlet.record(spec.name, time_ns, bytes(message))
                take(deserialize_message(message, spec.message))

            try:
                self._runner.do(command)
            except PhysicsError as error:
                name = self.resolve_topic_name(spec.name)
                self.get_logger().warning(f'{name}: {error} The camera stays as it is.')
            except RuntimeError:
                pass  # The simulation has stopped.

        return callback

    def _set_camera_pose(self, message: PoseStamped) -> None:
        frame = self.get_parameter('frame_id').value
        if message.header.frame_id not in ('', frame):
            raise PhysicsError(
                f'The pose is in frame {message.header.frame_id!r}: {frame!r} is needed.'
            )
        position, orientation = message.pose.position, message.pose.orientation
        self._simulation.place_camera(
            [position.x, position.y, position.z],
            [orientation.x, orientation.y, orientation.z, orientation.w],
        )

    def _set_camera_velocity(self, message: Twist) -> None:
        linear = [message.linear.x, message.linear.y, message.linear.z]
        angular = [message.angular.x, message.angular.y, message.angular.z]
        vectors('camera velocity', linear, 3, VELOCITY_LIMIT, 'm/s')
        vectors('camera angular velocity', angular, 3, VELOCITY_LIMIT, 'rad/s')
        self._runner.fly(linear, angular, CMD_VEL_TIMEOUT)

    # Parameters: converted, checked and, once rclpy has taken them, applied.

    def _converted(self, given: list[RosParameter]) -> list[RosParameter]:
        return [
            RosParameter(
                parameter.name,
                value=parameters.PARAMETERS[parameter.name].converted(parameter.value),
            )
            if parameter.name in parameters.PARAMETERS
            else parameter
            for parameter in given
        ]

    def _checked(self, given: list[RosParameter]) -> SetParametersResult:
        changes = {p.name: p.value for p in given if p.name in parameters.PARAMETERS}
        # rclpy gives arrays as array.array.
        changes = {
            name: list(value) if isinstance(parameters.PARAMETERS[name].default, list) else value
            for name, value in changes.items()
        }
        present = {name: self.get_parameter(name).value for name in parameters.PARAMETERS}
        try:
            parameters.check(present, changes)
        except parameters.ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _applied(self, given: list[RosParameter]) -> None:
        changes = {parameter.name: parameter.value for parameter in given}

        def apply() -> None:
            run = {name: value for name, value in changes.items() if name in CHANGEABLE}
            if run:
                self._simulation.configure(run)
            if 'publish_rate' in changes:
                step_ns = self._simulation.world.settings.time_step_ns
                rate = changes['publish_rate']
                self._simulation.set_period(parameters.steps_of_period(rate, step_ns))
                self._runner.set_real_time_factor(self._runner.real_time_factor)
            if 'real_time_factor' in changes:
                self._runner.set_real_time_factor(changes['real_time_factor'])
            if 'record_markers' in changes:
                self._outlet.record_markers = changes['record_markers']

        with contextlib.suppress(RuntimeError):  # the simulation has stopped
            self._runner.do(apply)

    def _announce(self, changes: Mapping[str, Any]) -> None:
        """Let the parameters show what the scenario has set."""
        self.set_parameters(parameters.as_ros(dict(changes)))

    # Diagnostics.

    def _publish_diagnostics(self) -> None:
        def publish() -> None:
            recorder = self._outlet.recorder
            now = self._runner.progress()
            array = diagnostic_array(
                self._simulation, self._runner, recorder, self._before, now, self._dropped_before
            )
            self._before = now
            self._dropped_before = recorder.drops if recorder else 0
            message = serialize_message(array)
            self._outlet.send(topics.DIAGNOSTICS, now.sim_ns, message)

        with contextlib.suppress(RuntimeError):  # the simulation has stopped
            self._runner.do(publish)


def _answering(answer: Callable[[Any], str]) -> Callable[[Any, Any], Any]:
    """Return a service callback: what `answer` returns, or the reason why not."""

    def callback(request: Any, response: Any) -> Any:
        try:
            response.message = answer(request)
            response.success = True
        except (PhysicsError, RecordingError, RuntimeError) as error:
            response.message = str(error)
            response.success = False
        return response

    return callback
