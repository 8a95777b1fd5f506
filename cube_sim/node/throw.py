"""Throw cubes from a terminal without the ros2 command: `python3 -m cube_sim.node.throw [N]`."""

from __future__ import annotations

import sys

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

# Discovery between two processes takes up to three seconds.
DEADLINE = 10.0


def main(argv: list[str] | None = None) -> int:
    """Throw N cubes (1 if not given) and print the answers; 1 when no simulator answers."""
    arguments = sys.argv[1:] if argv is None else argv
    if len(arguments) > 1 or not all(argument.isdigit() for argument in arguments):
        sys.stderr.write('usage: python3 -m cube_sim.node.throw [NUMBER OF CUBES]\n')
        return 2
    rclpy.init()
    try:
        node = Node('cube_thrower')
        client = node.create_client(Trigger, '/cube_sim/throw')
        if not client.wait_for_service(DEADLINE):
            sys.stderr.write('No simulator answers on /cube_sim/throw; is sim_node running?\n')
            return 1
        for _ in range(int(arguments[0]) if arguments else 1):
            future = client.call_async(Trigger.Request())
            rclpy.spin_until_future_complete(node, future, timeout_sec=DEADLINE)
            answer = future.result()
            if answer is None or not answer.success:
                sys.stderr.write(f'{answer.message if answer else "No answer came."}\n')
                return 1
            sys.stdout.write(f'cube {answer.message}\n')
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
