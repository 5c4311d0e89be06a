"""Which channels of a broken file can be trusted: what their summary, their digests or their numbers say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from mcap.records import Channel, Schema

from warpchain.archive import archive_format
from warpchain.archive.digest import DIGEST, is_right, of_channel
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.mcap_write import McapFile


def untrue(index: McapIndex) -> Channel | None:
    """A channel of an archive with digests that is not what was written; None if all are.

    Another program that wrote the archive anew may have numbered its channels anew, too: then a digest is right under
    one of the numbers that warpchain gives to such a topic.
    """
    if not index.sealed:
        return None
    recorded: list[str] | None = None
    for channel in index.channels.values():
        named = archive_format.variant_of(channel.topic)
        if is_right(channel, index.schemas) or (named is None and DIGEST not in channel.metadata):
            continue
        if named is None:
            return channel
        if recorded is None:
            recorded = (
                (index.values(archive_format.RUN_METADATA) or {})
                .get("recorded", "")
                .split()[: archive_format.MOST_VARIANTS]
            )
        likely = [recorded.index(str(named[0]))] if str(named[0]) in recorded else []
        numbers = (archive_format.channel_numbers(place)[named[1]] for place in (*likely, *range(len(recorded))))
        if not any(is_right(replace(channel, id=number), index.schemas) for number in numbers):
            return channel
    return None


class Topics:
    """Channels and schemas as they are found, each copied when the first chunk asks for it.

    Args:
        index: a summary that is right, whose channels and schemas all are; None goes by what `add` is given.

    Attributes:
        sealed: whether the archive has digests.
    """

    def __init__(self, index: McapIndex | None = None) -> None:
        self.sealed = index is not None and index.sealed
        self._channels = dict(index.channels) if index else {}
        self._schemas = dict(index.schemas) if index else {}
        self._variants: dict[int, int | None] = {}

    def add_schema(self, found: Schema) -> None:
        """Takes a schema.

        Raises:
            ValueError: there is another one of its number.
        """
        if self._schemas.setdefault(found.id, found) != found:
            raise ValueError("two schemas of a number")

    def add(self, channel: Channel, head: Mapping[str, str] | None) -> None:
        """Takes a channel, if it can be trusted.

        Args:
            head: the metadata at the file's start.

        Raises:
            ValueError: it cannot.
        """
        self.sealed = self.sealed or DIGEST in channel.metadata
        if self.sealed:
            self._check_digest(channel)
        else:
            self._check_number(channel, head or {})
        if self._channels.setdefault(channel.id, channel) != channel:
            raise ValueError("two channels of a number")

    def _check_digest(self, channel: Channel) -> None:
        """Refuses a channel unless its digest is right; a schema that is damaged is replaced by warpchain's own."""
        wanted = channel.metadata.get(DIGEST)
        named = archive_format.variant_of(channel.topic)
        known = self._schemas.get(channel.schema_id)
        if known is not None and of_channel(channel, known) == wanted:
            return
        if named:
            name = archive_format.TOPICS[named[1]]
            encoding, data = archive_format.schema_of(name)
            own = Schema(id=channel.schema_id, name=name, encoding=encoding, data=data)
            if of_channel(channel, own) == wanted:
                self._schemas[own.id] = own
                return
        raise ValueError("its digest is wrong")

    def _check_number(self, channel: Channel, head: Mapping[str, str]) -> None:
        """Refuses a channel of an archive without digests unless its topic is the one that warpchain numbers so.

        The channels of a variant have successive numbers; where one of them names another variant, none is trusted.
        """
        named = archive_format.variant_of(channel.topic)
        if named is None:
            return
        place, k = divmod(channel.id - 1, len(archive_format.TOPICS))
        recorded = head.get("recorded", "").split()
        right = list(archive_format.TOPICS)[k] == named[1] and str(named[0]) in recorded
        others = {v for p, v in self._variants.items() if p != place}
        if not right or self._variants.setdefault(place, named[0]) != named[0] or named[0] in others:
            self._variants[place] = None
            for number in range(1 + place * len(archive_format.TOPICS), 1 + (place + 1) * len(archive_format.TOPICS)):
                self._channels.pop(number, None)
            raise ValueError("its topic and its number do not fit")

    def variant_of_state(self, number: int) -> int | None:
        """The variant whose states a channel holds, None if it holds something else."""
        channel = self._channels.get(number)
        named = archive_format.variant_of(channel.topic) if channel else None
        return named[0] if named and named[1] == "state" else None

    def open(self, file: McapFile, numbers: Iterable[int]) -> None:
        """Copies channels and their schemas, unless that was done.

        Raises:
            ValueError: one is not described, or its description is damaged.
        """
        wanted = [number for number in numbers if not file.has_channel(number)]
        for number in wanted:
            if number not in self._channels or self._channels[number].schema_id not in self._schemas:
                raise ValueError("its topic is not described")
        for number in wanted:
            channel = self._channels[number]
            kind = self._schemas[channel.schema_id]
            if not file.has_schema(kind.id):
                file.schema(kind.id, kind.name, kind.encoding, bytes(kind.data))
            file.channel(number, kind.id, channel.topic, channel.message_encoding, channel.metadata)
