"""Bytes that are no message raise MessageError, whatever they are, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cube_sim.messages import decode, events, markers, poses
from cube_sim.messages.decode import MessageError, PoseArrayDecoder

WORLD = poses.pose_array(5, 'world', np.ones((3, 7)))


def learned(data: bytes) -> Any:
    decoder = PoseArrayDecoder()
    decoder(WORLD)
    return decoder(data)


MESSAGES: dict[str, tuple[Callable[[bytes], Any], bytes]] = {
    'clock': (decode.read_clock, events.clock(5)),
    'header': (decode.read_header, events.header(5, 'world')),
    'pose array': (decode.read_pose_array, WORLD),
    'pose arrays': (learned, WORLD),
    'pose': (decode.read_pose_stamped, poses.pose_stamped(5, 'world', np.ones(7))),
    'odometry': (
        decode.read_odometry, events.odometry(5, 'world', 'cube_0', np.ones(7), np.ones(6))
    ),
    'marker': (
        decode.read_marker,
        markers.triangle_list(5, 'world', 'ground', np.ones((3, 3)), np.ones((3, 4))),
    ),
    'parameters': (
        decode.read_parameter_event,
        events.parameter_event(5, '/n', {'a': 1, 'b': 'x', 'c': [1.0, 2.0]}, {'d': True}),
    ),
}  # fmt: skip
each = pytest.mark.parametrize(('read', 'data'), MESSAGES.values(), ids=MESSAGES)


def only_message_error(read: Callable[[bytes], Any], data: bytes) -> bool:
    try:
        read(data)
    except MessageError as error:
        text = str(error)
        assert '\n' not in text
        assert text.endswith('.')
        return True
    return False


@each
def test_a_message_that_is_cut_off_anywhere(read, data):
    for length in range(len(data)):
        with pytest.raises(MessageError):
            read(data[:length])


@each
def test_a_message_with_more_behind_it(read, data):
    for more in (4, 56, 1000):
        with pytest.raises(MessageError):
            read(data + bytes(more))


@each
def test_a_message_with_any_byte_wrong(read, data):
    for offset in range(len(data)):
        for mask in (1, 0x80, 0xFF):
            changed = bytearray(data)
            changed[offset] ^= mask
            only_message_error(read, bytes(changed))


@each
@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200))
def test_random_bytes(read, data, content):
    only_message_error(read, content)
    for start in (b'\x00\x01\x00\x00', b'\x00\x00\x00\x00'):
        only_message_error(read, start + content)


@each
@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_message_with_several_bytes_wrong(read, data, choices):
    changed = bytearray(data)
    for _ in range(choices.draw(st.integers(1, 6))):
        offset = choices.draw(st.integers(0, len(data) - 1))
        changed[offset] = choices.draw(st.sampled_from([0, 1, 0x7F, 0x80, 0xFF]))
    only_message_error(read, bytes(changed))


def test_messages_of_other_types_are_refused():
    for name, (read, _) in MESSAGES.items():
        for other, (_, data) in MESSAGES.items():
            if name.split()[0] != other.split()[0]:
                with pytest.raises(MessageError):
                    read(data)


@pytest.mark.parametrize(
    ('data', 'words'),
    [
        (b'', 'has 0 bytes, fewer than the encapsulation alone'),
        (b'\x00\x0b\x00\x00' + bytes(8), 'has the encapsulation 000b, not 0000 or 0001'),
        (b'\x28\xb5\x2f\xfd' + bytes(8), 'has the encapsulation 28b5'),
        (b'\x00\x01\x00\x00\x05\x00\x00\x00', 'ends too early'),
        (events.clock(5) + bytes(8), 'should end after 12 bytes'),
        (b'\x00\x01\x00\x00' + bytes(4) + b'\x00\xca\x9a\x3b', 'has 1000000000 ns beside'),
    ],
)
def test_the_error_says_what_is_wrong(data, words):
    with pytest.raises(MessageError) as caught:
        decode.read_clock(data)
    assert words in str(caught.value)
    assert str(caught.value).startswith(f'These {len(data)} bytes are no rosgraph_msgs/Clock: ')


def test_a_claim_of_many_poses_allocates_nothing():
    data = bytearray(WORLD)
    count_at = data.index(b'\x03\x00\x00\x00', 20)
    data[count_at : count_at + 4] = b'\xff\xff\xff\x7f'
    for read in (decode.read_pose_array, learned):
        with pytest.raises(MessageError, match='claims 2147483647 items'):
            read(bytes(data))


def test_a_text_that_is_no_utf_8_or_has_no_end():
    data = events.header(5, 'world')
    with pytest.raises(MessageError, match='not UTF-8'):
        decode.read_header(data.replace(b'o', b'\xff'))
    with pytest.raises(MessageError, match='without its closing zero'):
        decode.read_header(data[:-1] + b'd')


def test_a_parameter_of_an_unknown_kind():
    data = events.parameter_event(5, '/n', {'a': True}, {})
    at = data.index(b'a\x00') + 2
    with pytest.raises(MessageError, match='unknown kind 10'):
        decode.read_parameter_event(data[:at] + b'\x0a' + data[at + 1 :])
