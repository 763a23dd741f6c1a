"""Opens an MCAP file with third-party readers; prints the number of messages by topic as JSON.

None of them knows of onbrick: `readers.py FILE mcap|rosbags|rerun`.
"""

import collections
import json
import pathlib
import sys


def by_mcap(path):
    """The format's own reader, through the indexes: in order of time, and from the middle on."""
    from mcap.reader import SeekingReader, make_reader

    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert isinstance(reader, SeekingReader)
        statistics = reader.get_summary().statistics
        middle = (statistics.message_start_time + statistics.message_end_time) // 2
        topics, unordered, last = collections.Counter(), 0, 0
        for _, channel, message in reader.iter_messages():
            topics[channel.topic] += 1
            unordered += message.log_time < last
            last = message.log_time
        late = list(reader.iter_messages(topics=["/pose"], starting_at=middle))
        poses = reader.iter_messages(topics=["/pose"], reverse=True)
        back = [message.log_time for _, _, message in poses]
    return {
        "topics": topics,
        "unordered": unordered,
        "before_the_middle": sum(message.log_time < middle for _, _, message in late),
        "late": len(late),
        "backwards": back == sorted(back, reverse=True),
    }


def by_rosbags(path):
    """Rosbags reads ROS 2's bags without ROS: every message by the definition in the file."""
    from rosbags.highlevel import AnyReader

    topics, unordered, last = collections.Counter(), 0, 0
    with AnyReader([pathlib.Path(path)]) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        for connection, log_time, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            topics[connection.topic] += 1
            unordered += log_time < last
            last = log_time
    return {"topics": topics, "types": types, "unordered": unordered}


def by_rerun(path):
    """Rerun: rows a topic, and what its viewer makes of the messages that it knows."""
    from rerun.chunk import McapReader

    topics, shown = collections.Counter(), collections.Counter()
    for chunk in McapReader(path, decoders=["raw"]).stream():
        if not chunk.is_static:
            topics[chunk.entity_path] += chunk.num_rows
    for chunk in McapReader(path).stream():
        for column in [] if chunk.is_static else chunk.to_record_batch().schema.names:
            shown[f"{chunk.entity_path} {column}"] += chunk.num_rows
    return {"topics": topics, "shown": shown}


if __name__ == "__main__":
    readers = {"mcap": by_mcap, "rosbags": by_rosbags, "rerun": by_rerun}
    json.dump(readers[sys.argv[2]](sys.argv[1]), sys.stdout)
