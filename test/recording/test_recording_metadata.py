from __future__ import annotations

from cube_sim.recording import Topic
from cube_sim.recording.definitions import find_definition
from cube_sim.recording.metadata import NO_TIME_NS, FileInfo, bag_information


def test_a_bag_of_several_files_adds_up_and_an_empty_file_has_no_say():
    topic = Topic('/clock', 'rosgraph_msgs/msg/Clock')
    files = [
        FileInfo('b_0.mcap', 100, 300, {'/clock': 3}),
        FileInfo('b_1.mcap'),
        FileInfo('b_2.mcap', 250, 400, {'/clock': 2}),
    ]
    found = bag_information([(topic, find_definition(topic.type))], files, {})
    assert found['starting_time'] == {'nanoseconds_since_epoch': 100}
    assert found['duration'] == {'nanoseconds': 300}
    assert found['message_count'] == 5
    assert found['topics_with_message_count'][0]['message_count'] == 5
    assert found['relative_file_paths'] == ['b_0.mcap', 'b_1.mcap', 'b_2.mcap']
    assert [
        (
            file['starting_time']['nanoseconds_since_epoch'],
            file['duration']['nanoseconds'],
            file['message_count'],
        )
        for file in found['files']
    ] == [(100, 200, 3), (NO_TIME_NS, 0, 0), (250, 150, 2)]
    assert found['custom_data'] is None
