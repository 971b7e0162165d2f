"""Writer of MCAP files that takes blocks of messages, whose records numpy has made.

The library's own writer takes one message at a time, which costs more than its data.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

__all__ = ["McapFile"]

MAGIC = b"\x89MCAP0\r\n"
CHUNK = 1 << 20  # bytes of single messages in a chunk
LEVEL = -3  # of zstd; numbers take 4 % more than at level 1 and half of its time


class McapFile:
    """MCAP file with chunks, indexes and a summary; `finish` completes it."""

    def __init__(self, out: BinaryIO, library: str) -> None:
        """Write the beginning of the file."""
        self._out, self._at = out, 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._waiting = RecordBuilder()  # schemas, channels and single messages of the next chunk
        self._index: dict[int, list[tuple[int, int]]] = {}  # of those messages: time, place
        self._write(MAGIC)
        self._write(_bytes(Header(profile="", library=library)))

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a record of metadata."""
        at, record = self._at, _bytes(Metadata(name=name, metadata=data))
        self._write(record)
        self._metadata.append(MetadataIndex(offset=at, length=len(record), name=name))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; return its number."""
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        schema.write(self._waiting)
        return len(self._schemas)

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: dict[str, str]
    ) -> int:
        """Add a channel; return its number."""
        channel = Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding=message_encoding,
            metadata=metadata, schema_id=schema_id,
        )  # fmt: skip
        self._channels.append(channel)
        channel.write(self._waiting)
        return len(self._channels)

    def add_message(self, channel: int, at: int, data: bytes) -> None:
        """Write a single message at a time [ns]."""
        self._index.setdefault(channel, []).append((at, self._waiting.count))
        message = Message(channel_id=channel, log_time=at, publish_time=at, sequence=0, data=data)
        message.write(self._waiting)
        if self._waiting.count > CHUNK:
            self._finish_chunk()

    def add_block(self, records: bytes | memoryview, index: Mapping[int, np.ndarray]) -> None:
        """Write the records of messages as one chunk.

        `index` has the messages of each channel in order, (n, 2) uint64: time [ns], and the place
        of the record in `records`.
        """
        self._finish_chunk(records, index)

    def finish(self) -> None:
        """Write the remaining messages, the summary and the end of the file."""
        if self._index:
            self._finish_chunk()
        self._write(_bytes(DataEnd(data_section_crc=0)))
        spans = [(c.message_start_time, c.message_end_time) for c in self._chunks]
        statistics = Statistics(
            attachment_count=0, channel_count=len(self._channels),
            channel_message_counts=self._counts, chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((end for _, end in spans), default=0),
            message_start_time=min((begin for begin, _ in spans), default=0),
            metadata_count=len(self._metadata), schema_count=len(self._schemas),
        )  # fmt: skip
        groups: list[tuple[Opcode, Sequence[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]), (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, self._metadata),
        ]  # fmt: skip
        begin, summary, offsets = self._at, b"", b""
        for opcode, records in groups:
            group = b"".join(_bytes(record) for record in records)
            place = SummaryOffset(
                group_opcode=opcode, group_start=begin + len(summary), group_length=len(group)
            )
            summary, offsets = summary + group, offsets + _bytes(place)
        offset_start = begin + len(summary)
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, begin, offset_start)
        crc = zlib.crc32(footer, zlib.crc32(summary + offsets))
        self._write(summary + offsets)
        end = Footer(summary_start=begin, summary_offset_start=offset_start, summary_crc=crc)
        self._write(_bytes(end) + MAGIC)

    def _finish_chunk(
        self, records: bytes | memoryview = b"", further: Mapping[int, np.ndarray] | None = None
    ) -> None:
        """Write what waits, and `records` after it, as a chunk and its indexes."""
        before = self._waiting.end()
        index = {c: np.array(pairs, np.uint64) for c, pairs in self._index.items()}
        for channel, pairs in (further or {}).items():
            own = pairs + np.array([0, len(before)], np.uint64)
            index[channel] = np.concatenate([index[channel], own]) if channel in index else own
        self._index = {}
        data = b"".join((before, records)) if before else records
        packed = zstandard.compress(data, LEVEL)
        times = [pairs[:, 0] for pairs in index.values()]
        begin, end = int(min(t.min() for t in times)), int(max(t.max() for t in times))
        place = self._at
        chunk = Chunk(
            compression="zstd", data=packed, message_start_time=begin, message_end_time=end,
            uncompressed_crc=zlib.crc32(data), uncompressed_size=len(data),
        )  # fmt: skip
        self._write(_bytes(chunk))
        length, indexes = self._at - place, {}
        for channel, pairs in index.items():
            indexes[channel] = self._at
            size = 16 * len(pairs)
            head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, channel, size)
            self._write(head + pairs.tobytes())
            self._counts[channel] = self._counts.get(channel, 0) + len(pairs)
        self._chunks.append(ChunkIndex(
            chunk_length=length, chunk_start_offset=place, compression="zstd",
            compressed_size=len(packed), message_end_time=end, message_index_length=self._at
            - place - length, message_index_offsets=indexes, message_start_time=begin,
            uncompressed_size=len(data),
        ))  # fmt: skip

    def _write(self, data: bytes) -> None:
        self._out.write(data)
        self._at += len(data)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
