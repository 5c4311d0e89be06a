"""Digests of MCAP records that have no checksum: metadata, and channels with their schemas (docs/archive.md)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from mcap.records import Channel, Schema

DIGEST_KEY = "digest"


_CANONICAL_JSON = json.JSONEncoder(separators=(",", ":"), sort_keys=True, ensure_ascii=False)


@lru_cache(maxsize=64)
def _schema_digest(data: bytes) -> str:
    """SHA-256 of an MCAP schema's bytes."""
    return hashlib.sha256(data).hexdigest()


def _json_digest(value: Any) -> str:
    """Digest of a JSON value."""
    return hashlib.sha256(_CANONICAL_JSON.encode(value).encode("utf-8", "surrogatepass")).hexdigest()[:16]


def metadata_without_digest(values: Mapping[str, str]) -> dict[str, str]:
    """MCAP metadata without their digest."""
    return {name: value for name, value in values.items() if name != DIGEST_KEY}


def channel_without_digest(channel: Channel) -> Channel:
    """MCAP channel without its digest."""
    return replace(channel, metadata=metadata_without_digest(channel.metadata))


def metadata_digest(name: str, values: Mapping[str, str]) -> str:
    """Digest of an MCAP metadata record."""
    return _json_digest([name, metadata_without_digest(values)])


def channel_digest(channel: Channel, schema: Schema) -> str:
    """Digest of an MCAP channel and its schema."""
    content = _schema_digest(bytes(schema.data))
    named = [channel.id, channel.topic, channel.message_encoding, metadata_without_digest(channel.metadata)]
    return _json_digest([*named, schema.name, schema.encoding, content])


def has_right_digest(channel: Channel, schemas: Mapping[int, Schema]) -> bool:
    """Whether an MCAP channel's digest is right."""
    schema = schemas.get(channel.schema_id)
    return schema is not None and channel.metadata.get(DIGEST_KEY) == channel_digest(channel, schema)


def checked_metadata(name: str, values: Mapping[str, str], has_digests: bool) -> dict[str, str]:
    """Values of an MCAP metadata record; raises ValueError for a wrong digest."""
    if values.get(DIGEST_KEY, None if has_digests else metadata_digest(name, values)) != metadata_digest(name, values):
        raise ValueError(f"metadata {name}: their digest is wrong")
    return metadata_without_digest(values)
