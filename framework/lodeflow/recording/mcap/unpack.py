"""Decompress a chunk, however damaged, into no more memory than its data asks for."""

from __future__ import annotations

import importlib
import struct
import zlib
from typing import NamedTuple

import zstandard

SMALL_CHUNK = 1 << 24
"""Bytes that a chunk may have in any file; writers make chunks of 1 to 4 MiB."""
RATIO = 5
"""How many times its whole file a larger chunk may have; a few bytes can stand for gigabytes."""
LARGEST_CHUNK = 1 << 30
"""Bytes that no chunk may have."""

_HEAD = struct.Struct("<QQQII")  # first and last log time, size, CRC, length of a name
_LZ4_RATIO = 256  # a byte of LZ4 stands for at most 255 bytes
_STEP = 1 << 20
_WINDOW = 1 << 23  # what the highest level of zstd asks for without "ultra"


class UnpackError(Exception):
    """A chunk cannot be unpacked; the text goes on from "the chunk at byte 7 ...".

    Attributes:
        damaged: false if it may be whole, and what unpacks it is missing here.
    """

    def __init__(self, text: str, *, damaged: bool = True) -> None:
        super().__init__(text)
        self.damaged = damaged


class Unpacked(NamedTuple):
    """A chunk whose CRC holds, if it has one.

    Attributes:
        compression: name of its compression.
        raw: its records.
        packed: its records as they are in the file.
        tidy: whether `packed` begins and ends as it should, so that all readers take it.
    """

    compression: str
    raw: bytes
    packed: memoryview
    tidy: bool


def largest_chunk(file_size: int) -> int:
    """Return how many bytes of a chunk are taken into memory, for a file of some size."""
    return min(max(SMALL_CHUNK, RATIO * file_size), LARGEST_CHUNK)


def unpack(body: bytes, largest: int) -> Unpacked:
    """Return the records in a chunk.

    Args:
        body: the chunk record without its prefix.
        largest: bytes that they may have; a damaged file may ask for any number.

    Raises:
        UnpackError: it is damaged, too large, or what unpacks it is missing.
    """
    try:
        _, _, size, crc, name_length = _HEAD.unpack_from(body)
        at = _HEAD.size + name_length
        compression = body[_HEAD.size : at].decode()
        (packed_size,) = struct.unpack_from("<Q", body, at)
    except (struct.error, ValueError, OverflowError) as error:
        raise UnpackError(f"is damaged: {error}") from error
    packed = memoryview(body)[at + 8 :]
    if len(packed) != packed_size:
        raise UnpackError("is damaged: its length differs")
    if size > largest:
        raise UnpackError(f"has {size} bytes; at most {largest} are read, in a file of this size")
    try:
        raw, tidy = _decompress(compression, packed, size)
    except (zstandard.ZstdError, RuntimeError, ValueError) as error:  # lz4: RuntimeError
        raise UnpackError(f"does not decompress: {error}") from error
    if len(raw) != size:
        raise UnpackError(f"is damaged: {len(raw)} bytes instead of {size}")
    if crc and zlib.crc32(raw) != crc:
        raise UnpackError("is damaged: its CRC differs")
    return Unpacked(compression, raw, packed, tidy)


def _decompress(compression: str, packed: memoryview, size: int) -> tuple[bytes, bool]:
    match compression:
        case "":
            return bytes(packed), True
        case "zstd":
            known = zstandard.frame_content_size(packed)
            if known == size:
                raw: bytes = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
                return raw, True
            if known != -1:  # else a damaged frame may ask for any amount of memory
                raise ValueError("its size differs")
            return _piecewise(packed, size), True
        case "lz4":
            try:
                lz4 = importlib.import_module("lz4.frame")
            except ImportError as error:
                text = "cannot be read here: it needs the package lz4; install it"
                raise UnpackError(text, damaged=False) from error
            if size > _LZ4_RATIO * len(packed):
                raise ValueError("its size differs")
            unpacker = lz4.LZ4FrameDecompressor()
            unpacked: bytes = unpacker.decompress(packed, max_length=size + 1)
            return unpacked, bool(unpacker.eof and not unpacker.unused_data)
    raise ValueError(f"its compression '{compression}' is unknown")


def _piecewise(packed: memoryview, size: int) -> bytes:
    """Decompress a zstd frame that does not say how long it is."""
    pieces, found = [], 0
    unpacker = zstandard.ZstdDecompressor(max_window_size=max(_WINDOW, size))
    with unpacker.stream_reader(packed) as reader:
        while found <= size and (piece := reader.read(min(_STEP, size + 1 - found))):
            pieces.append(piece)
            found += len(piece)
    return b"".join(pieces)
