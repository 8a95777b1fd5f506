"""A node whose callbacks run on a thread of their own."""

from __future__ import annotations

import threading

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

# The longest that a callback may still take when the node is closed, s.
_PATIENCE = 5.0


class Serving:
    """Serves `node` from `start` until `close`, which also destroys it."""

    def __init__(self, node: Node) -> None:
        """Set up; nothing runs before `start`."""
        self._node = node
        self._done = Future()
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._thread = threading.Thread(
            target=self._serve, name=f'{node.get_name()} callbacks', daemon=True
        )

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def close(self) -> None:
        """Stop between two callbacks, and destroy the node."""
        self._done.set_result(None)
        if self._thread.ident is not None:
            self._thread.join(_PATIENCE)
        self._executor.shutdown(timeout_sec=_PATIENCE)
        self._node.destroy_node()

    def _serve(self) -> None:
        while self._node.context.ok() and not self._done.done():
            try:
                self._executor.spin_until_future_complete(self._done)
            except Exception as error:  # one bad message must not make the node deaf
                if not self._done.done():
                    self._node.get_logger().error(f'A message could not be handled: {error!r}')
