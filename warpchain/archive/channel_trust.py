"""Channels of a broken archive that can be trusted, by its summary, digests or numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from mcap.records import Channel, Schema

from warpchain.archive import archive_format
from warpchain.archive.digest import DIGEST_KEY, channel_digest, channel_without_digest, has_right_digest
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.mcap_write import McapWriter


def untrusted_channel(index: McapIndex) -> Channel | None:
    """First channel of an archive with a wrong digest, or None."""
    if not index.has_digests:
        return None
    recorded: list[str] | None = None
    for channel in index.channels.values():
        if has_right_digest(channel, index.schemas) or _is_foreign(channel):
            continue
        if recorded is None:
            recorded = _recorded_numbers(index.read_metadata(archive_format.RUN_METADATA) or {})
        if not _is_renumbered(channel, index.schemas, recorded):
            return channel
    return None


def _recorded_numbers(start: Mapping[str, str]) -> list[str]:
    """Numbers, as words, of variants that an archive file can hold."""
    return start.get("recorded", "").split()[: archive_format.MOST_VARIANTS]


def _is_foreign(channel: Channel) -> bool:
    """Whether an archive's channel is another program's."""
    return archive_format.variant_and_topic(channel.topic) is None and DIGEST_KEY not in channel.metadata


def _is_renumbered(channel: Channel, schemas: Mapping[int, Schema], recorded: Sequence[str]) -> bool:
    """Whether a channel's digest is right under a number of warpchain's."""
    named = archive_format.variant_and_topic(channel.topic)
    if named is None:
        return False
    likely = [recorded.index(str(named[0]))] if str(named[0]) in recorded else []
    numbers = (archive_format.channel_numbers(place)[named[1]] for place in (*likely, *range(len(recorded))))
    return any(has_right_digest(replace(channel, id=number), schemas) for number in numbers)


class TrustedTopics:
    """Channels and schemas of a broken archive, copied when asked for.

    With a right summary, `index`, its channels are trusted.
    """

    def __init__(self, index: McapIndex | None = None) -> None:
        self.has_digests = index is not None and index.has_digests
        self._channels = dict(index.channels) if index else {}
        self._schemas = dict(index.schemas) if index else {}
        self._found: list[Channel] = []
        self._variants: dict[int, int | None] = {}

    def add_schema(self, found: Schema) -> None:
        """Adds a broken archive's schema; raises ValueError if its number is taken."""
        if self._schemas.setdefault(found.id, found) != found:
            raise ValueError("two schemas of a number")

    def add_channel(self, channel: Channel) -> None:
        """Adds a broken archive's channel, for `decide_trust` to judge."""
        self.has_digests = self.has_digests or DIGEST_KEY in channel.metadata
        self._found.append(channel)

    def decide_trust(self, start: Mapping[str, str], used: Collection[int]) -> int:
        """Decides which channels of a broken archive to trust; returns how many not.

        `used` are channel numbers of messages; all must be described where one is not warpchain's own.
        """
        others: dict[int, list[Channel]] = {}
        wrong = 0
        for channel in self._found:
            own = self._has_digest(channel) if self.has_digests else self._has_own_number(channel, start)
            if own and self._channels.setdefault(channel.id, channel) == channel:
                continue
            if own or not self.has_digests:
                wrong += 1
            elif all(
                channel_without_digest(other) != channel_without_digest(channel) for other in others.get(channel.id, ())
            ):
                others.setdefault(channel.id, []).append(channel)
        for number in list(others):  # the same with another digest, in a chunk that was copied whole
            known = self._channels.get(number)
            others[number] = [
                c for c in others[number] if not known or channel_without_digest(c) != channel_without_digest(known)
            ]
        recorded = _recorded_numbers(start)
        whole = set(used) <= self._channels.keys() | others.keys()
        for number, channels in others.items():
            one = len(channels) == 1 and number not in self._channels and whole
            if one and (_is_foreign(channels[0]) or _is_renumbered(channels[0], self._schemas, recorded)):
                self._channels[number] = channels[0]
            else:
                wrong += len(channels)
        return wrong

    def _has_digest(self, channel: Channel) -> bool:
        """Whether a channel's digest is right, or with warpchain's own schema."""
        wanted = channel.metadata.get(DIGEST_KEY)
        named = archive_format.variant_and_topic(channel.topic)
        known = self._schemas.get(channel.schema_id)
        if known is not None and channel_digest(channel, known) == wanted:
            return True
        if named:
            name = archive_format.TOPICS[named[1]]
            encoding, data = archive_format.topic_schema(name)
            own = Schema(id=channel.schema_id, name=name, encoding=encoding, data=data)
            if channel_digest(channel, own) == wanted:
                self._schemas[own.id] = own
                return True
        return False

    def _has_own_number(self, channel: Channel, start: Mapping[str, str]) -> bool:
        """Whether a channel without digest has warpchain's number for its topic."""
        named = archive_format.variant_and_topic(channel.topic)
        if named is None:
            return True
        place, k = divmod(channel.id - 1, len(archive_format.TOPICS))
        recorded = start.get("recorded", "").split()
        right = list(archive_format.TOPICS)[k] == named[1] and str(named[0]) in recorded
        others = {v for p, v in self._variants.items() if p != place}
        if right and self._variants.setdefault(place, named[0]) == named[0] and named[0] not in others:
            return True
        self._variants[place] = None
        for number in range(1 + place * len(archive_format.TOPICS), 1 + (place + 1) * len(archive_format.TOPICS)):
            self._channels.pop(number, None)
        return False

    def variant_and_topic(self, number: int) -> tuple[int, str] | None:
        """Variant and topic of a broken archive's channel, or None."""
        channel = self._channels.get(number)
        return archive_format.variant_and_topic(channel.topic) if channel else None

    def is_known(self, number: int) -> bool:
        """Whether a broken archive's channel is described and trusted."""
        return number in self._channels and self._channels[number].schema_id in self._schemas

    def copy_topics(self, file: McapWriter, numbers: Iterable[int]) -> None:
        """Copies trusted channels to an archive file; raises ValueError for others."""
        wanted = [number for number in numbers if not file.has_channel(number)]
        for number in wanted:
            if not self.is_known(number):
                raise ValueError("its topic is not described")
        for number in wanted:
            channel = self._channels[number]
            kind = self._schemas[channel.schema_id]
            if not file.has_schema(kind.id):
                file.add_schema(kind.id, kind.name, kind.encoding, bytes(kind.data))
            file.add_channel(number, kind.id, channel.topic, channel.message_encoding, channel.metadata)
