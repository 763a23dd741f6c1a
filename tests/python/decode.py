"""Decodes every message of an MCAP file by the definition inside it; prints the result as JSON.

An independent reader: the packages mcap and mcap-ros2-support know nothing of onbrick.
"""

import json
import math
import sys

from mcap.reader import make_reader, NonSeekingReader
from mcap_ros2.decoder import DecoderFactory


def plain(value):
    """A decoded message as JSON: NaN and infinities become text, long lists their length."""
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, (bytes, bytearray, list, tuple)):
        return [plain(item) for item in value] if len(value) <= 40 else {"length": len(value)}
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    return value


def main(path, indexed):
    found = {"topics": {}, "attachments": {}, "metadata": {}}
    with open(path, "rb") as stream:
        if indexed:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            summary = reader.get_summary()
            found["chunks"] = len(summary.chunk_indexes)
            found["counted"] = summary.statistics.message_count
        else:
            factories = [DecoderFactory()]
            reader = NonSeekingReader(stream, validate_crcs=True, decoder_factories=factories)
        header = make_reader(open(path, "rb")).get_header()
        found["profile"], found["library"] = header.profile, header.library
        messages = reader.iter_decoded_messages(log_time_order=indexed)
        for schema, channel, message, decoded in messages:
            topic = found["topics"].setdefault(channel.topic, {"schema": schema.name, "count": 0})
            topic["count"] += 1
            topic.setdefault("first", plain(decoded))
            topic.setdefault("first_log_time", message.log_time)
            topic["last"] = plain(decoded)
        stream.seek(0)
        if indexed:
            reader = make_reader(stream, validate_crcs=True)
            for attachment in reader.iter_attachments():
                found["attachments"][attachment.name] = attachment.data.decode()
            for metadata in reader.iter_metadata():
                found["metadata"][metadata.name] = metadata.metadata
    json.dump(found, sys.stdout)


main(sys.argv[1], sys.argv[2] == "indexed")
