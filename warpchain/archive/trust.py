"""Which channels of a broken file can be trusted: what their summary, their digests or their numbers say."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from mcap.records import Channel, Schema

from warpchain.archive import archive_format
from warpchain.archive.digest import DIGEST, is_right, of_channel, plain_channel
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.mcap_write import McapFile


def untrue(index: McapIndex) -> Channel | None:
    """A channel of an archive with digests that is not what was written; None if all are."""
    if not index.sealed:
        return None
    recorded: list[str] | None = None
    for channel in index.channels.values():
        if is_right(channel, index.schemas) or _is_foreign(channel):
            continue
        if recorded is None:
            recorded = _recorded(index.values(archive_format.RUN_METADATA) or {})
        if not _is_renumbered(channel, index.schemas, recorded):
            return channel
    return None


def _recorded(head: Mapping[str, str]) -> list[str]:
    """Numbers of the recorded variants that one file can hold."""
    return head.get("recorded", "").split()[: archive_format.MOST_VARIANTS]


def _is_foreign(channel: Channel) -> bool:
    """Whether a channel of an archive with digests is none of warpchain's."""
    return archive_format.variant_of(channel.topic) is None and DIGEST not in channel.metadata


def _is_renumbered(channel: Channel, schemas: Mapping[int, Schema], recorded: Sequence[str]) -> bool:
    """Whether another program that wrote the archive anew may have given a channel its number.

    Then the digest is right under one of the numbers that warpchain gives to such a topic.
    """
    named = archive_format.variant_of(channel.topic)
    if named is None:
        return False
    likely = [recorded.index(str(named[0]))] if str(named[0]) in recorded else []
    numbers = (archive_format.channel_numbers(place)[named[1]] for place in (*likely, *range(len(recorded))))
    return any(is_right(replace(channel, id=number), schemas) for number in numbers)


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
        self._found: list[Channel] = []
        self._variants: dict[int, int | None] = {}

    def add_schema(self, found: Schema) -> None:
        """Takes a schema.

        Raises:
            ValueError: there is another one of its number.
        """
        if self._schemas.setdefault(found.id, found) != found:
            raise ValueError("two schemas of a number")

    def add(self, channel: Channel) -> None:
        """Takes a channel; `settle` decides whether it can be trusted."""
        self.sealed = self.sealed or DIGEST in channel.metadata
        self._found.append(channel)

    def settle(self, head: Mapping[str, str], used: Collection[int]) -> int:
        """Decides on the channels that were added; returns how many cannot be trusted.

        A bit of a channel's number may have changed, which gives it another one's messages. A number that is not
        warpchain's own is therefore believed only where every message's channel is described, and by one record.

        Args:
            head: the metadata at the file's start.
            used: numbers of the channels that messages have.
        """
        others: dict[int, list[Channel]] = {}
        wrong = 0
        for channel in self._found:
            own = self._has_digest(channel) if self.sealed else self._has_own_number(channel, head)
            if own and self._channels.setdefault(channel.id, channel) == channel:
                continue
            if own or not self.sealed:
                wrong += 1
            elif all(plain_channel(other) != plain_channel(channel) for other in others.get(channel.id, ())):
                others.setdefault(channel.id, []).append(channel)
        for number in list(others):  # the same with another digest, in a chunk that was copied whole
            known = self._channels.get(number)
            others[number] = [c for c in others[number] if not known or plain_channel(c) != plain_channel(known)]
        recorded = _recorded(head)
        whole = set(used) <= self._channels.keys() | others.keys()
        for number, channels in others.items():
            one = len(channels) == 1 and number not in self._channels and whole
            if one and (_is_foreign(channels[0]) or _is_renumbered(channels[0], self._schemas, recorded)):
                self._channels[number] = channels[0]
            else:
                wrong += len(channels)
        return wrong

    def _has_digest(self, channel: Channel) -> bool:
        """Whether a channel's digest is right; a schema that is damaged is replaced by warpchain's own."""
        wanted = channel.metadata.get(DIGEST)
        named = archive_format.variant_of(channel.topic)
        known = self._schemas.get(channel.schema_id)
        if known is not None and of_channel(channel, known) == wanted:
            return True
        if named:
            name = archive_format.TOPICS[named[1]]
            encoding, data = archive_format.schema_of(name)
            own = Schema(id=channel.schema_id, name=name, encoding=encoding, data=data)
            if of_channel(channel, own) == wanted:
                self._schemas[own.id] = own
                return True
        return False

    def _has_own_number(self, channel: Channel, head: Mapping[str, str]) -> bool:
        """Whether a channel of an archive without digests has the number that warpchain gives to its topic.

        The channels of a variant have successive numbers; where one of them names another variant, none is trusted.
        """
        named = archive_format.variant_of(channel.topic)
        if named is None:
            return True
        place, k = divmod(channel.id - 1, len(archive_format.TOPICS))
        recorded = head.get("recorded", "").split()
        right = list(archive_format.TOPICS)[k] == named[1] and str(named[0]) in recorded
        others = {v for p, v in self._variants.items() if p != place}
        if right and self._variants.setdefault(place, named[0]) == named[0] and named[0] not in others:
            return True
        self._variants[place] = None
        for number in range(1 + place * len(archive_format.TOPICS), 1 + (place + 1) * len(archive_format.TOPICS)):
            self._channels.pop(number, None)
        return False

    def variant_of(self, number: int) -> tuple[int, str] | None:
        """Variant and topic of a channel, None if it is foreign or cannot be trusted."""
        channel = self._channels.get(number)
        return archive_format.variant_of(channel.topic) if channel else None

    def is_known(self, number: int) -> bool:
        """Whether a channel is described and can be trusted."""
        return number in self._channels and self._channels[number].schema_id in self._schemas

    def open(self, file: McapFile, numbers: Iterable[int]) -> None:
        """Copies channels and their schemas, unless that was done.

        Raises:
            ValueError: one is not described, or its description is damaged.
        """
        wanted = [number for number in numbers if not file.has_channel(number)]
        for number in wanted:
            if not self.is_known(number):
                raise ValueError("its topic is not described")
        for number in wanted:
            channel = self._channels[number]
            kind = self._schemas[channel.schema_id]
            if not file.has_schema(kind.id):
                file.schema(kind.id, kind.name, kind.encoding, bytes(kind.data))
            file.channel(number, kind.id, channel.topic, channel.message_encoding, channel.metadata)
