"""The camera: placed by ~/camera/set_pose, flown by ~/camera/cmd_vel, thrown from."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from node.ros_values import free_flight, pose7, xyz
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from cube_sim.node import node as node_module

HALF = math.sqrt(0.5)


def placed(position, orientation, frame='world'):
    return PoseStamped(
        header=Header(frame_id=frame),
        pose=Pose(
            position=Point(**dict(zip('xyz', map(float, position), strict=True))),
            orientation=Quaternion(**dict(zip('xyzw', map(float, orientation), strict=True))),
        ),
    )


def moving(linear=(0, 0, 0), angular=(0, 0, 0)):
    return Twist(
        linear=Vector3(**dict(zip('xyz', map(float, linear), strict=True))),
        angular=Vector3(**dict(zip('xyz', map(float, angular), strict=True))),
    )


@pytest.fixture
def camera(ros, sim):
    """The poses of the camera of a paused simulation; the first is there."""
    sim(start_paused=True)
    listener = ros.listen('camera/pose')
    listener.wait_for()
    return listener


def test_the_camera_starts_where_the_parameters_put_it(ros, sim):
    place = {'camera.position': [1.0, 2.0, 3.0], 'camera.orientation': [0.0, 0.0, 3.0, 4.0]}
    sim(place)
    pose = ros.listen('camera/pose').wait_for()
    assert pose7(pose.pose) == pytest.approx([1, 2, 3, 0, 0, 0.6, 0.8])


def test_the_camera_can_be_placed_and_throws_come_from_there(ros, camera):
    throws, poses = ros.listen('throws'), ros.listen('poses')
    # Looks along y and down by 45 degrees: yaw 90, then pitch 45 about its own y axis.
    down = math.pi / 8
    yaw = np.array([0.0, 0.0, HALF, HALF])
    turn = [-yaw[2] * math.sin(down), yaw[3] * math.sin(down), *(yaw[2:] * math.cos(down))]
    ros.publisher('camera/set_pose').publish(placed([5, 6, 70], turn))
    expected = [5, 6, 70, *turn]
    assert pose7(camera.wait_for(after=1).pose) == pytest.approx(expected)
    ros.do('throw')
    thrown = throws.wait_for()
    assert pose7(thrown.pose.pose).tolist() == pose7(camera.last.pose).tolist()
    assert xyz(thrown.twist.twist.linear).tolist() == [8, 0, 0]
    ros.do('step')
    velocity = np.array([0.0, 8 * HALF, -8 * HALF])
    place = free_flight(np.array([5.0, 6.0, 70.0]), velocity, 0.02, 0.002)
    assert xyz(poses.wait_for().poses[0].position) == pytest.approx(place, abs=1e-12)


def test_a_quaternion_that_is_not_of_unit_length_is_normalised(ros, camera):
    ros.publisher('camera/set_pose').publish(placed([1, 0, 2], [0, 0, 30, 40]))
    assert pose7(camera.wait_for(after=1).pose) == pytest.approx([1, 0, 2, 0, 0, 0.6, 0.8])


def test_a_pose_without_a_frame_is_in_that_of_the_simulator(ros, camera):
    ros.publisher('camera/set_pose').publish(placed([1, 0, 2], [0, 0, 0, 1], frame=''))
    assert pose7(camera.wait_for(after=1).pose).tolist() == [1, 0, 2, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ('bad', 'reason'),
    [
        (placed([1, 0, 2], [0, 0, 0, 0]), 'quaternion'),
        (placed([1, 0, 2], [0, 0, 0, math.nan]), 'finite'),
        (placed([1, math.inf, 2], [0, 0, 0, 1]), 'finite'),
        (placed([1, 0, 1e300], [0, 0, 0, 1]), '1e+07 m'),
        (placed([1, 0, 2], [0, 0, 0, 1], frame='map'), "'world' is needed"),
    ],
)
def test_a_pose_that_cannot_be_is_refused_and_the_camera_stays(ros, camera, bad, reason):
    log, publisher = ros.listen('/rosout'), ros.publisher('camera/set_pose')
    publisher.publish(bad)
    warning = log.wait_for(lambda entry: entry.level == Log.WARN)
    assert '/cube_sim/camera/set_pose' in warning.msg
    assert reason in warning.msg
    publisher.publish(placed([7, 0, 2], [0, 0, 0, 1]))
    camera.wait_for(lambda message: message.pose.position.x == 7, after=1)
    assert [message.pose.position.x for message in camera.messages] == [0, 7]
    ros.do('throw')


@pytest.mark.parametrize(
    'bad', [moving([math.nan, 0, 0]), moving([0, 0, 1e9]), moving(angular=[0, math.inf, 0])]
)
def test_a_velocity_that_cannot_be_is_refused_and_the_camera_stays(ros, camera, bad):
    log = ros.listen('/rosout')
    ros.publisher('camera/cmd_vel').publish(bad)
    warning = log.wait_for(lambda entry: entry.level == Log.WARN)
    assert '/cube_sim/camera/cmd_vel' in warning.msg
    ros.publisher('camera/set_pose').publish(placed([7, 0, 2], [0, 0, 0, 1]))
    camera.wait_for(lambda message: message.pose.position.x == 7, after=1)
    assert len(camera.messages) == 2


def test_a_message_that_is_cut_short_does_no_harm(ros, camera):
    whole = serialize_message(placed([3, 0, 2], [0, 0, 0, 1]))
    publisher = ros.publisher('camera/set_pose')
    for length in (4, 10, len(whole) - 8):
        publisher.publish(whole[:length])
    publisher.publish(placed([7, 0, 2], [0, 0, 0, 1]))
    camera.wait_for(lambda message: message.pose.position.x == 7, after=1)
    assert [message.pose.position.x for message in camera.messages] == [0, 7]
    ros.do('throw')


def test_the_camera_flies_in_its_own_axes_and_stops_when_it_hears_no_more(ros, camera):
    ros.publisher('camera/set_pose').publish(placed([0, 0, 2], [0, 0, HALF, HALF]))
    camera.wait_for(after=1)
    # One command holds for CMD_VEL_TIMEOUT: forward is along y now, and up is up.
    ros.publisher('camera/cmd_vel').publish(moving([4, 0, 2]))
    way = np.array([0.0, 4.0, 2.0]) * node_module.CMD_VEL_TIMEOUT
    end = np.array([0.0, 0.0, 2.0]) + way
    camera.wait_for(lambda message: message.pose.position.y > end[1] - 1e-3, after=2)
    throws = ros.listen('throws')
    ros.do('throw')
    assert xyz(throws.wait_for().pose.pose.position) == pytest.approx(end, abs=1e-3)
    assert len(camera.messages) > 5, 'it is seen to fly'
    height = [message.pose.position.z for message in camera.messages[1:]]
    assert height == sorted(height)


def test_the_camera_turns_about_its_own_axes(ros, camera):
    ros.publisher('camera/set_pose').publish(placed([0, 0, 2], [HALF, 0, 0, HALF]))
    camera.wait_for(after=1)
    # Rolled by 90 degrees its z axis is -y of world, about which it turns by a quarter.
    rate = 0.5 * math.pi / node_module.CMD_VEL_TIMEOUT
    ros.publisher('camera/cmd_vel').publish(moving(angular=[0, 0, rate]))
    expected = np.array([0, 0, 2, 0.5, -0.5, 0.5, 0.5])

    def there(message):
        return np.allclose(pose7(message.pose), expected, atol=1e-3)

    camera.wait_for(there, after=2)


def test_a_velocity_of_zero_stops_the_camera_at_once(ros, camera, monkeypatch):
    monkeypatch.setattr(node_module, 'CMD_VEL_TIMEOUT', 1000.0)
    publisher = ros.publisher('camera/cmd_vel')
    publisher.publish(moving([1, 0, 0]))
    camera.wait_for(after=3)
    publisher.publish(moving())
    # The pose that is asked for comes behind the stop, on another topic: only when the camera
    # stands does it stay where it is put.
    placer = ros.publisher('camera/set_pose')
    throws = ros.listen('throws')
    for turn in range(1, 100):
        placer.publish(placed([-turn, 0, 2], [0, 0, 0, 1]))
        camera.wait_for(lambda message, x=-turn: message.pose.position.x == x, after=1)
        ros.do('throw')
        if throws.wait_for_count(turn)[-1].pose.pose.position.x == -turn:
            return
    pytest.fail('the camera flies on')


def test_commands_that_come_fast_do_not_slow_the_camera_down(ros, camera, monkeypatch):
    monkeypatch.setattr(node_module, 'CMD_VEL_TIMEOUT', 1000.0)
    publisher = ros.publisher('camera/cmd_vel')
    publisher.publish(moving([1, 0, 0]))
    camera.wait_for(after=1)
    first_seen = time.monotonic()
    # A command for every pose that is seen, each before the camera's next frame of 20 ms.
    for _ in range(200):
        last_sent = time.monotonic()
        publisher.publish(moving([1, 0, 0]))
        camera.next()
    # By the time of this answer the last command has been taken.
    ros.do('pause', True)
    ros.do('throw')
    x = ros.listen('throws').wait_for().pose.pose.position.x
    assert x >= last_sent - first_seen - 1e-6


def test_a_camera_at_the_end_of_the_world_stays_there_and_the_node_goes_on(ros, camera):
    ros.publisher('camera/set_pose').publish(placed([1e7 - 1, 0, 2], [0, 0, 0, 1]))
    camera.wait_for(after=1)
    ros.publisher('camera/cmd_vel').publish(moving([1000, 0, 0]))
    throws = ros.listen('throws')
    ros.do('throw')
    ros.do('step')
    ros.publisher('camera/set_pose').publish(placed([0, 0, 2], [0, 0, 0, 1]))
    ros.do('throw')
    assert all(abs(message.pose.pose.position.x) <= 1e7 for message in throws.wait_for_count(2))
    assert all(message.pose.position.x <= 1e7 for message in camera.messages)
