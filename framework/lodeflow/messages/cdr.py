"""CDR (XCDR1, little endian) by compiled layout: no per-sample Python for blocks.

With a constant frame_id, all our messages have a fixed size, so that a block of N is one
structured array over a template that already holds everything that does not change.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lodeflow.errors import MessageError, did_you_mean
from lodeflow.messages.fields import INTEGER_RANGES
from lodeflow.messages.message import Message, generate
from lodeflow.messages.ros import PRIMITIVES, Leaf, definition, leaves

HEADER = b"\x00\x01\x00\x00"  # encapsulation: plain CDR, little endian
TEXT_AT = len(HEADER) + 8  # frame_id in a record, behind the stamp: its length, then its bytes
LONGEST_FRAME = 1 << 12
"""Bytes of a frame_id that are read; a layout is compiled for each length."""
NANOSECONDS = 1_000_000_000
FIRST_STAMP, LAST_STAMP = -(2**31) * NANOSECONDS, 2**31 * NANOSECONDS - 1
"""Stamps that fit builtin_interfaces/Time (int32 seconds)."""


@dataclass(frozen=True)
class StreamConstants:
    """What does not change within a stream.

    Attributes:
        frame_id: coordinate frame named in each header; bytes that are no UTF-8 are surrogates.
        values: ROS members that the message type does not declare, as (path, value) pairs.
    """

    frame_id: str
    values: tuple[tuple[str, Any], ...] = ()

    @classmethod
    def of(cls, kind: type[Message]) -> StreamConstants:
        """Return the defaults of a message type: zero, but for what it says of itself."""
        return cls(
            kind.frame,
            tuple(
                (leaf.path, kind.ros_defaults.get(leaf.path, _zero(leaf)))
                for leaf in leaves(definition(kind))
                if _undeclared(kind, leaf)
            ),
        )


_CODES = {"uint8": "B", "uint32": "I", "int64": "q"}
"""Codes of struct and numpy for the integers of ROS; all else is a double, "d"."""
PACKED_VALUES = 64
"""Values of a field up to which struct is quicker than numpy, which is slow to begin with."""


class Layout:
    """Encoder and decoder of one message type with given stream constants."""

    def __init__(self, kind: type[Message], constants: StreamConstants) -> None:
        self.kind = kind
        self.constants = constants
        self.template, self.offsets = _place(kind, constants)
        self.size = len(self.template)
        # No field can be called so: its name begins with a letter.
        formats: dict[str, Any] = {"_sec": ("<i4", ()), "_nanosec": ("<u4", ())}
        offsets = [self.offsets["header.stamp.sec"], self.offsets["header.stamp.nanosec"]]
        for field in kind.fields:
            formats[field.name] = ("<" + _CODES.get(field.ros, "d"), field.shape)
            offsets.append(self.offsets[field.name])
        self.dtype = np.dtype(
            {
                "names": list(formats),
                "formats": list(formats.values()),
                "offsets": offsets,
                "itemsize": self.size,
            }
        )
        self._template_row = np.frombuffer(self.template, dtype=f"V{self.size}")
        self.encode_sample = self._compile_encoder()
        self.decode_sample = self._compile_decoder()

    encode_sample: Callable[[Message], bytes]
    """Encode one sample. Raises MessageError for a stamp or value that does not fit."""

    decode_sample: Callable[[bytes], Message]
    """Return the sample that one record holds; see `decode_block` for errors."""

    def encode_block(
        self, block: Message, out: NDArray[np.uint8] | None = None
    ) -> NDArray[np.uint8]:
        """Encode a block of N samples.

        Args:
            block: N rows.
            out: where to write, uint8 of shape (N, size) with contiguous rows; new if None.

        Returns:
            The records, uint8 of shape (N, size).

        Raises:
            MessageError: a stamp outside the range of ROS time, or a column of another shape.
        """
        t = block.t
        if out is None:
            out = np.empty((len(t), self.size), dtype=np.uint8)
        if not len(t):
            return out
        out.view(self._template_row.dtype)[:] = self._template_row
        if t.min() < FIRST_STAMP or t.max() > LAST_STAMP:
            raise MessageError(f"{self.kind.__name__}: a stamp is outside the range of ROS time")
        records = out.view(self.dtype)[:, 0]
        records["_sec"], records["_nanosec"] = np.divmod(t, NANOSECONDS)
        for field, value in zip(self.kind.fields, block.values(), strict=True):
            if value.shape != (len(t), *field.shape):
                block.validate()
            if not field.integer:
                if np.isnan(value.min()):  # there are many NaN patterns; a stream has one
                    value = np.where(np.isnan(value), np.nan, value)
            elif (
                value.min() < INTEGER_RANGES[field.ros][0]
                or value.max() > (INTEGER_RANGES[field.ros][1])
            ):
                block.validate()
            records[field.name] = value
        return out

    def decode_block(self, records: NDArray[np.uint8]) -> Message:
        """Return the block that N records hold.

        Args:
            records: uint8 of shape (N, size); where the rows are contiguous, they may lie apart.

        Raises:
            MessageError: the records have another size or encapsulation.
        """
        if records.ndim != 2 or records.shape[1] != self.size or records.dtype != np.uint8:
            raise MessageError(
                f"{self.kind.__name__}: records of {records.shape} are not (N, {self.size}) bytes"
            )
        if records.strides[1] != 1:
            records = np.ascontiguousarray(records)
        if (records[:, :4].view("<u4") != int.from_bytes(HEADER, "little")).any():
            raise MessageError(f"{self.kind.__name__}: not plain little-endian CDR")
        view = records.view(self.dtype)[:, 0]
        t = view["_sec"].astype(np.int64) * NANOSECONDS + view["_nanosec"]
        return self.kind(
            t, *[view[field.name].astype(field.dtype, order="C") for field in self.kind.fields]
        )

    def _encode_unusual(self, sample: Message) -> bytes:
        """Encode a sample that may hold a NaN: there are many patterns, a stream has one."""
        record: bytes = self.encode_block(sample.as_block())[0].tobytes()
        return record

    def _compile_encoder(self) -> Callable[[Message], bytes]:
        """Generate the encoder of one sample: struct.pack with the constant bytes between.

        Large arrays are no arguments of it, but joined with what is packed before and behind.
        """
        pieces: list[tuple[int, str, str]] = [
            (self.offsets["header.stamp.sec"], "i", "sec"),
            (self.offsets["header.stamp.nanosec"], "I", "nanosec"),
        ]
        floats: list[str] = []
        joined: list[str] = []
        body = f"        sec = m.t // {NANOSECONDS}\n        nanosec = m.t - sec * {NANOSECONDS}\n"
        for index, field in enumerate(self.kind.fields):
            code = _CODES.get(field.ros, "d")
            value = f"m.{field.name}"
            if field.size > PACKED_VALUES:
                joined.append(field.name)
                pieces.append((self.offsets[field.name], f"{8 * field.size}x", field.name))
                continue
            total, count = value, ""
            if field.shape:
                flat = "" if len(field.shape) == 1 else ".ravel()"
                body += f"        v{index} = {value}{flat}.tolist()\n"
                value, total, count = f"*v{index}", f"sum(v{index})", str(field.size)
            pieces.append((self.offsets[field.name], f"{count}{code}", value))
            if not field.integer:
                floats.append(total)
        scope: dict[str, Any] = {"isnan": math.isnan, "slow": self._encode_unusual}
        scope |= {"errors": (struct.error, TypeError, AttributeError), "Refused": MessageError}
        scope |= {"plain": np.ascontiguousarray, "own": np.dtype("<f8")}
        packs: list[str] = []
        layout, at = "<", 0
        arguments: list[str] = []

        def close() -> None:
            """End a stretch that is packed at once."""
            nonlocal layout, arguments
            scope[f"pack{len(packs)}"] = struct.Struct(layout).pack
            packs.append(f"pack{len(packs)}({', '.join(arguments)})")
            layout, arguments = "<", []

        for offset, code, value in [*sorted(pieces), (self.size, "0x", "")]:
            if offset > at:
                scope[f"gap{at}"] = self.template[at:offset]
                layout += f"{offset - at}s"
                arguments.append(f"gap{at}")
            at = offset + struct.calcsize("<" + code)
            if value in joined:
                close()
                packs.append(value)
            elif value:
                layout += code
                arguments.append(value)
        close()
        for name in joined:
            body += f"        {name} = plain(m.{name}, own)\n"
            body += f"        if isnan({name}.min()):\n            return slow(m)\n"
        if floats:
            # A sum finds NaN at a tenth of the cost of looking at each value; inf - inf only
            # sends a good sample the slow way.
            body += f"        total = {' + '.join(floats)}\n"
            body += "        if total != total:\n            return slow(m)\n"
        whole = packs[0] if len(packs) == 1 else f"b''.join(({', '.join(packs)}))"
        source = (
            f"def encode_sample(m):\n    try:\n{body}        record = {whole}\n"
            "    except errors as problem:\n"
            f'        raise Refused(f"{self.kind.__name__} does not fit its layout: '
            '{problem}") from None\n'
        )
        if joined:  # struct counts by itself
            source += f"    if len(record) != {self.size}:\n        m.validate()\n"
        source += "    return record\n"
        exec(compile(source, f"<CDR of {self.kind.__name__}>", "exec"), scope)
        compiled: Callable[[Message], bytes] = scope["encode_sample"]
        return compiled

    def _compile_decoder(self) -> Callable[[bytes], Message]:
        """Generate the decoder of one sample: a struct.unpack, and a copy per array.

        The sample is filled in here, as its constructor would: one call less of several.
        """
        generate(self.kind)
        scalars = {"header": (0, "I"), "sec": (self.offsets["header.stamp.sec"], "i")}
        scalars["nanosec"] = (self.offsets["header.stamp.nanosec"], "I")
        wire, own = np.dtype("<f8"), np.dtype(np.float64)
        sets = f"    set_t(m, sec * {NANOSECONDS} + nanosec)\n"
        for field in self.kind.fields:
            at = self.offsets[field.name]
            value = f"m_{field.name}"
            if not field.shape:
                scalars[value] = at, _CODES.get(field.ros, "d")
            elif field.size <= PACKED_VALUES and wire == own:
                scalars[value] = at, f"{8 * field.size}s"
                value = f"ndarray({field.shape}, own, bytearray({value}))"
            else:
                value = f"frombuffer(record, wire, {field.size}, {at}).astype(own)"
                value += "" if len(field.shape) == 1 else f".reshape({field.shape})"
            sets += f"    set_{field.name}(m, {value})\n"
        layout, end = "<", 0
        for at, code in sorted(scalars.values()):
            layout += f"{at - end}x{code}"
            end = at + struct.calcsize("<" + code)
        names = ", ".join(sorted(scalars, key=scalars.__getitem__))
        scope: dict[str, Any] = {
            "unpack": struct.Struct(f"{layout}{self.size - end}x").unpack,
            "frombuffer": np.frombuffer,
            "ndarray": np.ndarray,
            "wire": wire,
            "own": own,
            "new": object.__new__,
            "kind": self.kind,
            "error": struct.error,
            "refuse": self._refuse_sample,
            **{f"set_{n}": getattr(self.kind, n).__set__ for n in ("t", *self.kind.field_names)},
        }
        source = (
            f"def decode_sample(record):\n    try:\n        {names} = unpack(record)\n"
            "    except error:\n        refuse(record)\n"
            f"    if header != {int.from_bytes(HEADER, 'little')}:\n        refuse(record)\n"
            f"    m = new(kind)\n{sets}    return m\n"
        )
        exec(compile(source, f"<CDR of {self.kind.__name__}>", "exec"), scope)
        compiled: Callable[[bytes], Message] = scope["decode_sample"]
        return compiled

    def _refuse_sample(self, record: bytes) -> None:
        self.decode_block(np.frombuffer(record, dtype=np.uint8)[None])


def layout_of(kind: type[Message], constants: StreamConstants | None = None) -> Layout:
    """Return the compiled layout of a type; with its default constants if none are given."""
    return _layout(kind, constants, repr(constants))


@lru_cache(maxsize=256)
def _layout(kind: type[Message], constants: StreamConstants | None, spelled: str) -> Layout:
    # Spelled out, because 0.0 equals -0.0 and 1 equals True, but their bytes differ.
    return Layout(kind, constants or StreamConstants.of(kind))


def complete_constants(kind: type[Message], constants: StreamConstants) -> StreamConstants:
    """Return constants with the type's defaults for all members that are not given.

    Raises:
        MessageError: the type has no such member, or it is declared; or a value does not fit.
    """
    known = dict(StreamConstants.of(kind).values)
    for path, _ in constants.values:
        if path not in known:
            raise MessageError(
                f"{kind.__name__} has no undeclared member '{path}'{did_you_mean(path, known)}"
            )
    complete = StreamConstants(
        constants.frame_id, tuple({**known, **dict(constants.values)}.items())
    )
    try:
        layout_of(kind, complete)
    except (struct.error, TypeError, AttributeError) as error:
        raise MessageError(f"{constants} does not fit {kind.ros}: {error}") from error
    return complete


def read_constants(kind: type[Message], record: bytes) -> StreamConstants:
    """Return the stream constants that a record was written with.

    Raises:
        MessageError: the record is truncated, big endian, or of another type.
    """
    if record[:4] != HEADER:
        raise MessageError(f"{kind.__name__}: not plain little-endian CDR")
    frame_id, values, at = "", [], 4
    for leaf in leaves(definition(kind)):
        at, value = _read(leaf, record, at, kind.__name__)
        if leaf.path == "header.frame_id":
            frame_id = value
        elif _undeclared(kind, leaf):
            values.append((leaf.path, value))
    if at != len(record):
        raise MessageError(f"{kind.__name__}: {len(record) - at} bytes too many")
    return StreamConstants(frame_id, tuple(values))


def _undeclared(kind: type[Message], leaf: Leaf) -> bool:
    top = leaf.path.partition(".")[0]
    return top != "header" and top not in kind.field_names


def _zero(leaf: Leaf) -> Any:
    zero = 0.0 if leaf.type.startswith("float") else 0
    return zero if leaf.count is None else (zero,) * leaf.count


def _align(at: int, size: int) -> int:
    return at + (-(at - 4)) % size  # alignment counts from behind the encapsulation header


def _read(leaf: Leaf, record: bytes, at: int, name: str) -> tuple[int, Any]:
    try:
        if leaf.type == "string":
            at = _align(at, 4)
            (length,) = struct.unpack_from("<I", record, at)
            text = record[at + 4 : at + 4 + length]
            if len(text) != length:
                raise MessageError(f"{name}: truncated at {leaf.path}")
            return at + 4 + length, text.removesuffix(b"\0").decode("utf-8", "surrogateescape")
        size, code = PRIMITIVES[leaf.type]
        at = _align(at, size)
        found = struct.unpack_from(f"<{leaf.count or 1}{code}", record, at)
    except struct.error:
        raise MessageError(f"{name}: truncated at {leaf.path}") from None
    return at + size * len(found), found[0] if leaf.count is None else found


def _place(kind: type[Message], constants: StreamConstants) -> tuple[bytes, dict[str, int]]:
    """Return the bytes of a record with all declared fields zero, and where members begin."""
    values: Mapping[str, Any] = dict(constants.values)
    out = bytearray(HEADER)
    offsets: dict[str, int] = {}
    for leaf in leaves(definition(kind)):
        if leaf.type == "string":
            text = constants.frame_id.encode("utf-8", "surrogateescape") + b"\0"
            out += bytes(_align(len(out), 4) - len(out))
            out += struct.pack("<I", len(text)) + text
            continue
        size, code = PRIMITIVES[leaf.type]
        out += bytes(_align(len(out), size) - len(out))
        offsets.setdefault(leaf.path, len(out))
        offsets.setdefault(leaf.path.split(".")[0], len(out))
        count = leaf.count or 1
        value = values.get(leaf.path, _zero(leaf))
        out += struct.pack(f"<{count}{code}", *(value if leaf.count is not None else (value,)))
    return bytes(out), offsets
