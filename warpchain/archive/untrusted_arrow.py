"""Arrow files from untrusted bytes: a table that is never larger than the bytes.

A message with compression or dictionaries, which Arrow expands to any stated size, is refused by its head.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

ARROW_MAGIC = b"ARROW1\0\0"
CONTENT_FIELD, COMPRESSION_FIELD = 2, 3


def table_from_untrusted_bytes(data: bytes) -> pa.Table:
    """Table of an Arrow file that anybody may have made.

    Raises:
        ValueError: compression, dictionaries, or columns that share bytes; `pyarrow.ArrowException` for other bytes.
    """
    import pyarrow as pa

    if not data.startswith(ARROW_MAGIC):
        raise ValueError("no Arrow file")
    messages = iter(pa.ipc.MessageReader.open_stream(pa.py_buffer(data)[len(ARROW_MAGIC) :]))
    schema = pa.ipc.read_schema(next(messages))
    batches = []
    for message in messages:
        if message.type != "record batch" or _content_field_offset(message.metadata.to_pybytes(), COMPRESSION_FIELD):
            raise ValueError("its columns are compressed or have dictionaries, as warpchain writes none")
        batches.append(pa.ipc.read_record_batch(message, schema))
    table = pa.Table.from_batches(batches, schema)
    if table.nbytes > len(data):
        raise ValueError("its columns share bytes")
    return table


def _content_field_offset(head: bytes, field: int) -> int:
    """Offset of a field in an Arrow message's content, or 0."""
    (message,) = struct.unpack_from("<I", head)
    content = message + _table_field_offset(head, message, CONTENT_FIELD)
    (content_offset,) = struct.unpack_from("<I", head, content)
    return _table_field_offset(head, content + content_offset, field)


def _table_field_offset(head: bytes, table: int, field: int) -> int:
    """Offset of a field in an Arrow message's flatbuffer table, or 0."""
    fields = table - struct.unpack_from("<i", head, table)[0]
    if fields < 0 or struct.unpack_from("<H", head, fields)[0] <= 4 + 2 * field:
        return 0
    return int(struct.unpack_from("<H", head, fields + 4 + 2 * field)[0])
