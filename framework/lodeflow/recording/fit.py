"""Which message type a topic of a file can be read as; or, in one sentence, why none."""

from __future__ import annotations

from collections.abc import Sequence

from mcap import records as mcap

from lodeflow.errors import MessageError
from lodeflow.messages import vocabulary as bundled  # noqa: F401 (declares the bundled types)
from lodeflow.messages.message import Message, by_ros_name
from lodeflow.recording.mcap.file import McapFile
from lodeflow.recording.ros2msg.translation import Translation, translation
from lodeflow.recording.stream import StreamDecoder

Channels = Sequence[mcap.Channel]

_WITHOUT = mcap.Schema(id=0, data=b"", encoding="", name="")


def schema_of(file: McapFile, channel: mcap.Channel) -> mcap.Schema:
    """Return the schema of a channel, an empty one if it has none."""
    return file.schemas.get(channel.schema_id, _WITHOUT)


def type_name(file: McapFile, channels: Channels) -> str:
    """Return the name of the type that a topic holds; several are joined by " | "."""
    return " | ".join(dict.fromkeys(schema_of(file, channel).name for channel in channels))


def encoding(channels: Channels) -> str:
    """Return how the messages of a topic are encoded; several are joined by " | "."""
    return " | ".join(dict.fromkeys(channel.message_encoding for channel in channels))


def require_cdr(file: McapFile, channels: Channels) -> None:
    """Look at how the messages of a topic are encoded.

    Raises:
        MessageError: not as ROS 2 does; the text goes on from "'/topic' ".
    """
    if (found := encoding(channels)) != "cdr":
        name = type_name(file, channels) or "no type"
        raise MessageError(f"is encoded as '{found}' ({name}); only 'cdr' (ROS 2) can be read")


def kind_of(file: McapFile, channels: Channels) -> type[Message]:
    """Return the declared message type that a topic holds.

    Raises:
        MessageError: there is none, or the topic cannot be read; the text goes on from "'/topic' ".
    """
    require_cdr(file, channels)
    name = type_name(file, channels)
    if name not in by_ros_name:
        raise MessageError(
            f"holds {name or 'messages without a type'}, and neither lodeflow nor an installed "
            "plugin package declares a message type for that"
        )
    translated(file, channels, by_ros_name[name])
    return by_ros_name[name]


def translated(file: McapFile, channels: Channels, kind: type[Message]) -> Translation | None:
    """Return how the records of a topic become those of a type; None if they are.

    Raises:
        MessageError: they do not fit; the text goes on from "'/topic' ".
    """
    schemas = {schema_of(file, channel).id: schema_of(file, channel) for channel in channels}
    texts = {schema.data for schema in schemas.values() if schema.encoding == "ros2msg"}
    try:
        found = [translation(kind, kind.ros, text) for text in texts]
    except MessageError as error:
        raise MessageError(f"cannot be read as {kind.__name__}: {error}") from error
    if len(found) > 1 and any(found):
        raise MessageError(f"has several definitions of {kind.ros} in this file")
    return found[0] if found else None


def decoder(file: McapFile, channels: Channels, kind: type[Message]) -> StreamDecoder:
    """Return what decodes a topic as a type; see `translated` for errors."""
    ids = [channel.id for channel in channels]
    return StreamDecoder(kind, ids, translated(file, channels, kind))
