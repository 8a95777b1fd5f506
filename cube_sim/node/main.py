"""The executable `sim_node`."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType


def main(argv: list[str] | None = None) -> int:
    """Run the node until it has reached its duration or is asked to end; return the exit code."""
    stop = threading.Event()

    def ask_to_stop(_: int, __: FrameType | None) -> None:
        stop.set()

    # A second signal only asks again, so that none can land in the middle of the clean end.
    signal.signal(signal.SIGINT, ask_to_stop)
    signal.signal(signal.SIGTERM, ask_to_stop)

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from cube_sim.node.live_line import LiveLine, banner
    from cube_sim.node.node import SimNode

    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        sys.stderr.write(f'sim_node: {error}\n')
        return 2
    node = SimNode(on_finished=stop.set)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, name='executor', daemon=True)
    spinning.start()
    try:
        if node.get_parameter('live_line').value:
            sys.stdout.write(
                banner(node.get_fully_qualified_name(), node.simulation, node.bag_path)
            )
            line = LiveLine.on_stdout(node.simulation, node.runner.progress())
            while not stop.wait(line.period):
                line.show(node.runner.progress(), '   paused' if node.runner.paused else '')
            line.close()
        else:
            stop.wait()
    finally:
        bag = node.close()
        executor.shutdown()
        spinning.join(5.0)
        node.destroy_node()
        rclpy.try_shutdown()
        if bag is not None:
            sys.stdout.write(f'bag: {bag}\n')
            sys.stdout.flush()
    return 0


if __name__ == '__main__':
    sys.exit(main())
