"""Recording: messages in, bags on disk.

A bag is a directory `NAME/` with `NAME_0.mcap` and `metadata.yaml`, as `ros2 bag` makes them. This
room knows topics, message definitions and files; it imports no ROS and never looks at a message's
bytes.

    topic         Topic: name, type, quality of service
    definitions   message texts and type hashes, from the ROS installation's share directory
    chunk         a chunk of messages, in memory and as records
    compression   none, lz4, zstd
    mcap_file     McapFile: one MCAP file
    metadata      the bag's description, for metadata.yaml and inside of each file
    drops         DropLog: what a bag lacks, and when
    directory     the bag's directory; new_bag_path: a free name for it
    bag           BagWriter: the files of a bag, one after the other
    recorder      Recorder: a BagWriter in a thread, behind a bounded queue

    reader            BagReader: the messages of any bag in order of time, checked
    recovery          recover: a whole bag out of a damaged or unfinished one
    bag_directory     what a path is as a bag; its metadata.yaml
    bag_notes         drops, gaps and quality of service, as a bag notes them
    mcap_records      the records of a file, read from bytes that may be anything
    mcap_ends         how a file starts and ends, and its index
    mcap_source       McapSource: one sound file, chunk by chunk
    chunk_content     a chunk, decompressed, checked and cut into messages
    compressed_files  what rosbag2 compressed as a whole
    merging           chunks whose times overlap, in order, with few in memory
    salvage           Salvage: what a damaged file still holds

What goes wrong leaves this room as RecordingError, in a sentence for the user. An MCAP file that
its process could not finish still holds every chunk that was flushed.
"""

from cube_sim.recording.bag import BagWriter
from cube_sim.recording.compression import Compression
from cube_sim.recording.directory import new_bag_path
from cube_sim.recording.drops import DropLog, Gap
from cube_sim.recording.errors import RecordingError
from cube_sim.recording.recorder import Recorder
from cube_sim.recording.topic import Topic

__all__ = [
    'BagWriter',
    'Compression',
    'DropLog',
    'Gap',
    'Recorder',
    'RecordingError',
    'Topic',
    'new_bag_path',
]
