"""Recording: messages in, bags on disk.

A bag is a directory `NAME/` with `NAME_0.mcap` and `metadata.yaml`, as `ros2 bag` makes them. This
room knows topics, message definitions and files; it imports no ROS and never looks at a message's
bytes.

    topic         Topic: name, type, quality of service
    definitions   message texts and type hashes, from the ROS installation's share directory
    mcap_file     McapFile: one MCAP file
    metadata      the bag's description, for metadata.yaml and inside of each file
    bag           BagWriter: the directory; new_bag_path: a free name for it
    recorder      Recorder: a BagWriter in a thread, behind a bounded queue

What goes wrong leaves this room as RecordingError, in a sentence for the user. An MCAP file that
its process could not finish still holds every chunk that was flushed.
"""

from cube_sim.recording.bag import BagWriter, new_bag_path
from cube_sim.recording.errors import RecordingError
from cube_sim.recording.mcap_file import Compression
from cube_sim.recording.recorder import Recorder
from cube_sim.recording.topic import Topic

__all__ = ['BagWriter', 'Compression', 'Recorder', 'RecordingError', 'Topic', 'new_bag_path']
