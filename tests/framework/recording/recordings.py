"""Small recordings to damage, and what the mcap package finds in a file."""

import struct
from random import Random

import numpy as np
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

import lodeflow as lf
from lodeflow.graph import load_graph_text
from lodeflow.messages.cdr import StreamConstants, layout_of
from lodeflow.messages.ros import schema_text
from lodeflow.messages.vocabulary import Heading, Imu
from lodeflow.recording.mcap.records import MAGIC, PREFIX
from lodeflow.recording.mcap.writer import McapWriter
from lodeflow.recording.reader import Recording
from lodeflow.recording.recover import recover
from lodeflow.supervisor.run import run


def random_block(kind, t, seed=0):
    random = np.random.default_rng(seed)
    columns = [
        random.integers(0, 3, (len(t), *field.shape))
        if field.integer
        else random.standard_normal((len(t), *field.shape))
        for field in kind.fields
    ]
    return kind(np.asarray(t, dtype=np.int64), *columns)


def read(path, wanted, **span):
    """Return {topic: block}, and check that the blocks of each chunk are proper ones."""
    found = {topic: [] for topic in wanted}
    with Recording(path) as recording:
        for blocks in recording.blocks(wanted, **span):
            assert blocks
            for topic, block in blocks.items():
                block.validate()
                assert len(block)
                found[topic].append(block)
    return {topic: wanted[topic].concat(blocks) for topic, blocks in found.items()}


def record(path, blocks, *, cuts=None, provenance=None, **options):
    """Write {topic: block}; `cuts`, a seed, decides in which order and in what parts."""
    random = Random(cuts)
    with McapWriter(path, **options) as writer:
        if provenance is not None:
            writer.metadata("lodeflow.provenance", provenance)
        channels, left = {}, dict.fromkeys(blocks, 0)
        topics = list(blocks)
        if cuts is not None:
            random.shuffle(topics)
        for topic in topics:
            kind = type(blocks[topic])
            channels[topic] = writer.channel(topic, kind.ros, schema_text(kind))
        while left:
            topic = random.choice(list(left)) if cuts is not None else next(iter(left))
            start, block = left[topic], blocks[topic]
            end = random.randint(start, len(block)) if cuts is not None else len(block)
            part = block[start:end]
            writer.write(channels[topic], part.t, layout_of(type(block)).encode_block(part))
            left[topic] = end
            if end == len(block):
                del left[topic]
            if cuts is not None and random.random() < 0.1:
                writer.flush_chunk()
    return path


HEADING = Heading(np.arange(0, 600, 2), np.linspace(0, 6, 300))
IMU = Imu(np.arange(1, 201, 2), np.ones((100, 3)), np.arange(300.0).reshape(100, 3))
WANTED = {"/heading": Heading, "/imu": Imu}


class Forward(lf.Node):
    """Sends what it gets."""

    def step_block(self, imu: lf.Imu) -> lf.Imu:
        return imu


def write(path, *, compression="zstd", closed=True):
    """Write a recording with several chunks; if it is not closed, it ends with the last of them."""
    path.unlink(missing_ok=True)
    writer = McapWriter(path, compression=compression, chunk_bytes=3000)
    writer.metadata("lodeflow.provenance", {"graph": "test"})
    writer.attachment("graph.yaml", "application/yaml", b"nodes: {}\n")
    channels = [writer.channel(topic, k.ros, schema_text(k)) for topic, k in WANTED.items()]
    for part in range(10):
        for channel, block in zip(channels, (HEADING, IMU), strict=True):
            rows = len(block) // 10
            some = block[part * rows : (part + 1) * rows]
            writer.write(channel, some.t, layout_of(type(block)).encode_block(some))
    writer.flush_chunk()
    end = path.stat().st_size
    writer.metadata("lodeflow.summary", {"stopped": "no"})
    writer.close()
    if not closed:
        path.write_bytes(path.read_bytes()[:end])
    return path


def of_package(path):
    """Return (log time, payload) of each topic as the mcap package reads a closed file."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = {channel.topic: [] for channel in reader.get_summary().channels.values()}
        for _, channel, message in reader.iter_messages(log_time_order=False):
            found[channel.topic].append((message.log_time, message.data))
    return found


def streamed(path):
    """Return kinds of all records outside of chunks as a reader without an index finds them."""
    with path.open("rb") as file:
        reader = StreamReader(file, emit_chunks=True, validate_crcs=True)
        return [type(record).__name__ for record in reader.records]


def records(data):
    """Yield (opcode, start, end) of the records of a good file."""
    at = len(MAGIC)
    while at < len(data) and data[at:] != MAGIC:
        op, length = PREFIX.unpack_from(data, at)
        yield op, at, at + PREFIX.size + length
        at += PREFIX.size + length


def columns(path):
    """Return {topic: block} as the columnar reader finds them."""
    with Recording(path) as recording:
        return {
            topic: kind.concat(list(recording.stream(topic, kind)))
            for topic, kind in WANTED.items()
            if topic in recording.topics
        }


def is_good(path):
    """Check what every reader relies on, and that there is nothing left to mend."""
    assert recover(path, path.with_name("never.mcap")).out is None
    assert not path.with_name("never.mcap").exists()
    assert streamed(path)[-1] == "Footer"


def foreign(path, **options):
    writer = Writer(str(path), **{"chunk_size": 2000, **options})
    writer.start(profile="ros2", library="someone")
    writer.add_attachment(5, 4, "photo.png", "image/png", b"pixels")
    ids = []
    for topic, kind in WANTED.items():
        schema = writer.register_schema(kind.ros, "ros2msg", schema_text(kind).encode())
        ids.append(writer.register_channel(topic, "cdr", schema, metadata={"qos": "µ"}))
    for channel, block in zip(ids, (HEADING, IMU), strict=True):
        for t, row in zip(
            block.t.tolist(), layout_of(type(block)).encode_block(block), strict=True
        ):
            writer.add_message(channel, t, row.tobytes(), publish_time=t)
    writer.add_metadata("note", {"weather": "rain"})
    writer.finish()


def foreign_members(path):
    """Write IMU as others would who add members of any size to the type, with changing frames."""
    text = schema_text(Imu).replace("=", "string[] notes\nint16[] numbers\n=", 1)
    writer = Writer(str(path), chunk_size=4000)
    writer.start(profile="ros2")
    schema = writer.register_schema(Imu.ros, "ros2msg", text.encode())
    channel = writer.register_channel("/imu", "cdr", schema)
    for number, t in enumerate(IMU.t.tolist()):
        layout = layout_of(Imu, StreamConstants("f" * (number % 5)))
        data = layout.encode_block(IMU[number : number + 1])[0].tobytes()
        # Behind the last float64 all is aligned: two strings of 3 letters, 3 numbers of 2 bytes.
        data += struct.pack("<II4sI4sI3h", 2, 4, b"one\0", 4, b"two\0", 3, 1, 2, 3)
        writer.add_message(channel, t, data, publish_time=t)
    writer.finish()


def replayable(path):
    """Record a run of a small graph that reads another recording."""
    source = path.with_name("source.mcap")
    record(source, {"/imu": IMU})
    graph = load_graph_text(
        "lodeflow: 1\nname: small\nnodes:\n"
        f"  s: {{use: recorded_sensors, params: {{file: {source}, imu: /imu, mag: null}}}}\n"
        '  f: {use: "recordings:Forward", inputs: {imu: s.imu}}\n'
    )
    run(graph, record=str(path))
    source.unlink()
