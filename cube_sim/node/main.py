"""The executable `sim_node`."""

from __future__ import annotations

import signal
import sys
import threading
from queue import Empty, SimpleQueue
from types import FrameType


class _Stop:
    """Lets the main thread wait for the end, which a signal handler may ask for at any moment.

    An Event would not do: a signal that comes while its lock is held waits for it for ever.
    """

    def __init__(self) -> None:
        self._asked: SimpleQueue[None] = SimpleQueue()

    def set(self) -> None:
        self._asked.put(None)

    def wait(self, timeout: float | None = None) -> bool:
        try:
            self._asked.get(timeout=timeout)
        except Empty:
            return False
        return True


def main(argv: list[str] | None = None) -> int:
    """Run the node until it has reached its duration or is asked to end; return the exit code."""
    stop = _Stop()

    def ask_to_stop(_: int, __: FrameType | None) -> None:
        stop.set()

    # A second signal only asks again, so that none can land in the middle of the clean end.
    signal.signal(signal.SIGINT, ask_to_stop)
    signal.signal(signal.SIGTERM, ask_to_stop)

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.logging import LoggingSeverity, get_logger_effective_level, set_logger_level
    from rclpy.signals import SignalHandlerOptions
    from rclpy.task import Future

    from cube_sim.node.live_line import LiveLine, banner
    from cube_sim.node.node import SimNode

    try:
        # What is wrong with the arguments is said once, below.
        set_logger_level('rcl', LoggingSeverity.FATAL)
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        if get_logger_effective_level('rcl') == LoggingSeverity.FATAL:
            set_logger_level('rcl', LoggingSeverity.UNSET)
    except Exception as error:
        sys.stderr.write(f'sim_node: {error}\n')
        return 2
    node = SimNode(on_finished=stop.set)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    served = Future()

    def serve() -> None:
        while rclpy.ok() and not served.done():
            try:
                executor.spin_until_future_complete(served)
            except Exception as error:  # one bad request must not make the node deaf
                node.get_logger().error(f'A request could not be served: {error!r}')

    serving = threading.Thread(target=serve, name='executor', daemon=True)
    serving.start()
    try:
        if node.get_parameter('live_line').value:
            sys.stdout.write(
                banner(node.get_fully_qualified_name(), node.simulation, node.bag_path)
            )
            sys.stdout.flush()
            line = LiveLine.on_stdout(node.simulation, node.runner.progress())
            while not stop.wait(line.period):
                line.show(node.runner.progress(), '   paused' if node.runner.paused else '')
            line.close()
        else:
            stop.wait()
    finally:
        bag = node.close()
        served.set_result(None)
        serving.join(5.0)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        if bag is not None:
            sys.stdout.write(f'bag: {bag}\n')
            sys.stdout.flush()
        # While Python ends it would put back the handlers that kill.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    return 0


if __name__ == '__main__':
    sys.exit(main())
