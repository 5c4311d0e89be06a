"""A table from the bytes of an Arrow file that anybody may have made: never larger than the bytes.

Arrow's own reader opens compressed buffers to whatever size they say. warpchain writes none, so a message that has
them, or dictionaries, is refused by its head, a flatbuffer table, before its body is read.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

MAGIC = b"ARROW1\0\0"
"""First bytes of an Arrow file; a stream of messages follows."""
HEADER, COMPRESSION = 2, 3
"""Fields of a message's head: of any message its content, of a batch of records its compression."""


def plain_table(data: bytes) -> pa.Table:
    """The table of an Arrow file without compression or dictionaries.

    Raises:
        ValueError: one that has them, or whose columns share bytes; or, as `pyarrow.ArrowException`, none at all.
    """
    import pyarrow as pa

    if not data.startswith(MAGIC):
        raise ValueError("no Arrow file")
    messages = iter(pa.ipc.MessageReader.open_stream(pa.py_buffer(data)[len(MAGIC) :]))
    schema = pa.ipc.read_schema(next(messages))
    batches = []
    for message in messages:
        if message.type != "record batch" or _field(message.metadata.to_pybytes(), COMPRESSION):
            raise ValueError("its columns are compressed or have dictionaries, as warpchain writes none")
        batches.append(pa.ipc.read_record_batch(message, schema))
    table = pa.Table.from_batches(batches, schema)
    if table.nbytes > len(data):
        raise ValueError("its columns share bytes")
    return table


def _field(head: bytes, field: int) -> int:
    """Where a field of a message's content lies in its table, 0 if it is not there."""
    (message,) = struct.unpack_from("<I", head)
    content = message + _place(head, message, HEADER)
    (content_offset,) = struct.unpack_from("<I", head, content)
    return _place(head, content + content_offset, field)


def _place(head: bytes, table: int, field: int) -> int:
    """Offset of a field from the beginning of its flatbuffer table, 0 if the table lacks it."""
    fields = table - struct.unpack_from("<i", head, table)[0]
    if fields < 0 or struct.unpack_from("<H", head, fields)[0] <= 4 + 2 * field:
        return 0
    return int(struct.unpack_from("<H", head, fields + 4 + 2 * field)[0])
