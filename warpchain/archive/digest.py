"""Digests of what MCAP gives no checksum: metadata records, and channels with their schemas.

Each carries its own, under the key `digest`: the first 16 hexadecimal digits of the SHA-256 of a JSON text (no blanks,
keys sorted, UTF-8): of a metadata record [name, values], of a channel [number, topic, message encoding, metadata,
schema's name, its encoding, its SHA-256]. A whole file's summary has a checksum, and so repeats channels and schemas
safely; in a file that was cut, only the digests show what is right.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from mcap.records import Channel, Schema

DIGEST = "digest"


_TEXT = json.JSONEncoder(separators=(",", ":"), sort_keys=True, ensure_ascii=False)


@lru_cache(maxsize=64)
def _of_bytes(data: bytes) -> str:
    """Digest of a schema, which many channels share."""
    return hashlib.sha256(data).hexdigest()


def _of(value: Any) -> str:
    return hashlib.sha256(_TEXT.encode(value).encode("utf-8", "surrogatepass")).hexdigest()[:16]


def plain(values: Mapping[str, str]) -> dict[str, str]:
    """Metadata without their digest."""
    return {name: value for name, value in values.items() if name != DIGEST}


def plain_channel(channel: Channel) -> Channel:
    """A channel without its digest."""
    return replace(channel, metadata=plain(channel.metadata))


def of_metadata(name: str, values: Mapping[str, str]) -> str:
    """Digest of a metadata record."""
    return _of([name, plain(values)])


def of_channel(channel: Channel, schema: Schema) -> str:
    """Digest of a channel and its schema."""
    content = _of_bytes(bytes(schema.data))
    named = [channel.id, channel.topic, channel.message_encoding, plain(channel.metadata)]
    return _of([*named, schema.name, schema.encoding, content])


def is_right(channel: Channel, schemas: Mapping[int, Schema]) -> bool:
    """Whether a channel has a digest, and it is that of the channel and its schema."""
    schema = schemas.get(channel.schema_id)
    return schema is not None and channel.metadata.get(DIGEST) == of_channel(channel, schema)


def checked(name: str, values: Mapping[str, str], sealed: bool) -> dict[str, str]:
    """A metadata record's values without their digest, which is right.

    Args:
        sealed: whether the archive has digests; archives of earlier versions have none.

    Raises:
        ValueError: it is wrong, or missing.
    """
    if values.get(DIGEST, None if sealed else of_metadata(name, values)) != of_metadata(name, values):
        raise ValueError(f"metadata {name}: their digest is wrong")
    return plain(values)
