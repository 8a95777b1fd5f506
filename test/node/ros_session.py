"""ROS as a test meets it: a context on a domain of its own, and what is done with it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest
from node import ros_contract
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future

# The longest that anything may take, s; it is met in milliseconds, or in the 3 s of discovery.
DEADLINE = 20.0


class Spinning:
    """A node that is served on a thread of its own until `close`."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._done = Future()
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._thread = threading.Thread(
            target=self._executor.spin_until_future_complete, args=[self._done]
        )
        self._thread.start()

    def close(self) -> None:
        """Stop, and destroy the node."""
        self._done.set_result(None)
        self._thread.join(DEADLINE)
        assert not self._thread.is_alive(), f'{self.node.get_name()} hangs in a callback'
        self._executor.shutdown()
        self.node.destroy_node()


class Listener:
    """Collects the messages of a topic, and waits for those that are still to come."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._messages: list[Any] = []
        self._arrived = threading.Condition()

    def take(self, message: Any) -> None:
        """Add a message; the subscription's callback."""
        with self._arrived:
            self._messages.append(message)
            self._arrived.notify_all()

    @property
    def messages(self) -> list[Any]:
        """All that have come, in their order."""
        with self._arrived:
            return list(self._messages)

    @property
    def last(self) -> Any:
        """The latest."""
        return self.messages[-1]

    def wait_for(
        self,
        predicate: Callable[[Any], Any] = lambda message: True,
        *,
        after: int = 0,
        deadline: float = DEADLINE,
    ) -> Any:
        """Return the first message, but for the first `after`, for which `predicate` holds."""
        seen = after

        def found() -> bool:
            nonlocal seen
            while seen < len(self._messages):
                if predicate(self._messages[seen]):
                    return True
                seen += 1
            return False

        with self._arrived:
            if self._arrived.wait_for(found, deadline):
                return self._messages[seen]
            came = f'{len(self._messages)} came'
            last = f', the last: {self._messages[-1]}' if self._messages else ''
        return pytest.fail(f'{self.topic}: no such message within {deadline:g} s; {came}{last}')

    def next(self, predicate: Callable[[Any], Any] = lambda message: True) -> Any:
        """Wait for a message that has not come yet."""
        return self.wait_for(predicate, after=len(self.messages))

    def wait_for_count(self, count: int) -> list[Any]:
        """Wait until that many have come; return all that have."""
        self.wait_for(after=count - 1)
        return self.messages


class RosSession:
    """A context on `domain` and a node in it, `probe`, that listens, publishes and calls."""

    def __init__(self, domain: int, name: str = 'probe') -> None:
        self.domain = domain
        self.context = Context()
        self.context.init(args=[], domain_id=domain)
        self.node = Node(
            name, context=self.context, use_global_arguments=False, start_parameter_services=False
        )
        self._clients: dict[str, Any] = {}
        self._spinning = Spinning(self.node)

    def listen(self, topic: str, *, raw: bool = False, message: Any = None) -> Listener:
        """
        Collect a topic from now on; one without a leading slash is the simulator's.

        `raw` collects the bytes on the wire; `message` is the type of a topic that the contract
        does not name.
        """
        name = topic if topic.startswith('/') else f'/cube_sim/{topic}'
        known = {**ros_contract.PUBLISHED, **ros_contract.OTHERS}
        channel = known[name] if message is None else ros_contract.Channel(message)
        listener = Listener(name)
        take = (lambda data: listener.take(bytes(data))) if raw else listener.take
        self.node.create_subscription(channel.message, name, take, channel.qos(), raw=raw)
        return listener

    def publisher(self, topic: str) -> Any:
        """Return a publisher to a topic of the simulator that has found its subscriber."""
        name = f'/cube_sim/{topic}'
        channel = ros_contract.SUBSCRIBED[name]
        matched = threading.Event()
        publisher = self.node.create_publisher(
            channel.message,
            name,
            channel.depth,
            event_callbacks=PublisherEventCallbacks(matched=lambda _: matched.set()),
        )
        assert matched.wait(DEADLINE), f'nobody listens to {name}'
        return publisher

    def call(self, service: str, data: bool | None = None) -> Any:
        """Call a service of the simulator; `data` is what a SetBool is given."""
        kind = ros_contract.SERVICES[service]
        request = kind.Request() if data is None else kind.Request(data=data)
        return self.request(kind, f'/cube_sim/{service}', request)

    def do(self, service: str, data: bool | None = None) -> str:
        """Call a service that has to succeed; return its message."""
        answer = self.call(service, data)
        assert answer.success, f'{service}: {answer.message}'
        return str(answer.message)

    def refuse(self, service: str, data: bool | None = None) -> str:
        """Call a service that has to fail; return the reason."""
        answer = self.call(service, data)
        assert not answer.success, f'{service}: {answer.message}'
        return str(answer.message)

    def request(self, kind: Any, name: str, request: Any) -> Any:
        """Call any service, and return its response."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
            assert self._clients[name].wait_for_service(DEADLINE), f'{name} is not served'
        answered = threading.Event()
        future = self._clients[name].call_async(request)
        future.add_done_callback(lambda _: answered.set())
        assert answered.wait(DEADLINE), f'{name} does not answer'
        return future.result()

    def set(self, name: str, value: Any) -> Any:
        """Set a parameter of the simulator, a value or a ParameterValue; return the result."""
        message = Parameter(name, value=None).to_parameter_msg()
        message.value = (
            value
            if isinstance(value, ParameterValue)
            else Parameter(name, value=value).get_parameter_value()
        )
        request = SetParameters.Request(parameters=[message])
        return self.request(SetParameters, '/cube_sim/set_parameters', request).results[0]

    def get(self, *names: str) -> list[Any]:
        """Return the simulator's values of parameters."""
        request = GetParameters.Request(names=names)
        values = self.request(GetParameters, '/cube_sim/get_parameters', request).values
        found = [parameter_value_to_python(value) for value in values]
        return [value if isinstance(value, (str, int, float)) else list(value) for value in found]

    def describe(self, *names: str) -> list[Any]:
        """Return the simulator's descriptors of parameters."""
        request = DescribeParameters.Request(names=names)
        name = '/cube_sim/describe_parameters'
        return list(self.request(DescribeParameters, name, request).descriptors)

    def close(self) -> None:
        """End it; nodes of others in the context have to be gone."""
        self._spinning.close()
        self.context.try_shutdown()
