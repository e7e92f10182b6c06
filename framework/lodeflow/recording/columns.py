"""Names of streams and of the numbers in them, as people write and read them."""

from __future__ import annotations

import numpy as np

from lodeflow.messages.fields import FieldSpec

_AXES = {"geometry_msgs/Vector3": "xyz", "geometry_msgs/Quaternion": "xyzw"}


def components(field: FieldSpec) -> list[str]:
    """Return the name of each component, in the order of memory: "rate.x", "matrix.0.2"."""
    if not field.shape:
        return [field.name]
    axes = _AXES.get(field.ros)
    if axes is not None:
        return [f"{field.name}.{axis}" for axis in axes]
    return [".".join([field.name, *map(str, place)]) for place in np.ndindex(field.shape)]


def topic_of(stream: str) -> str:
    """Return the topic of a stream that is named as in a graph, or by its topic."""
    return stream if stream.startswith("/") else "/" + stream.replace(".", "/")


def stream_of(topic: str) -> str:
    """Return a topic's name as in a graph: "vehicle.raw_mag" for "/vehicle/raw_mag"."""
    return topic.removeprefix("/").replace("/", ".")
