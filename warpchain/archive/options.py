"""Options of writing an archive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from warpchain.errors import ArchiveError

COMPRESSIONS = ("zstd", "lz4", "none")
VALUES = ("run", "float32")


@dataclass(frozen=True)
class ArchiveOptions:
    """Options of writing an archive.

    Attributes:
        compression: of the chunks, "zstd", "lz4" or "none".
        values: "run" keeps rollers in the run's own precision, bitwise; "float32" halves the archive of a float64 run.
        exact_positions: with values = "float32", positions also as float64, on a topic of their own.
        split_size: begin another file when one has reached this size [bytes]; None does not.
        split_variants: recorded variants in one file; None puts all into one. Not together with `split_size`.
        encoders: threads that lay out and compress chunks; None takes one a core, four at most.
        numbers: what the archive calls the run's variants, one each; None calls them 0, 1, 2, ...
        seed: of the design whose variants these are; goes into the metadata.
        attachments: further files to put into the archive, by name, such as {"study.toml": b"..."}.

    Raises:
        ArchiveError: a value that is not allowed.
    """

    compression: str = "zstd"
    values: str = "run"
    exact_positions: bool = False
    split_size: int | None = None
    split_variants: int | None = None
    encoders: int | None = None
    numbers: Sequence[int] | None = None
    seed: int | None = None
    attachments: Mapping[str, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, allowed in (("compression", COMPRESSIONS), ("values", VALUES)):
            value = getattr(self, name)
            if value not in allowed:
                words = ", ".join(f'"{word}"' for word in allowed)
                raise ArchiveError(f"{name} = {value!r}: allowed are {words}")
        for name in ("split_size", "split_variants", "encoders"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int) and value > 0):
                raise ArchiveError(f"{name} = {value!r}: allowed is a whole number above 0, or None")
        if self.split_size is not None and self.split_variants is not None:
            raise ArchiveError("split_size and split_variants: give one of them")
        if self.exact_positions and self.values != "float32":
            raise ArchiveError('exact_positions: goes with values = "float32"; else positions are exact already')
        numbers = self.numbers or ()
        if len(set(numbers)) < len(numbers) or min(numbers, default=0) < 0:
            raise ArchiveError("numbers: allowed are different whole numbers of at least 0")
        for name, data in self.attachments.items():
            if not isinstance(data, bytes):
                raise ArchiveError(f"attachments: {name!r} is {type(data).__name__}; allowed are bytes")
            if name == "metrics.arrow" or name.startswith("drives/"):
                raise ArchiveError(f"attachments: the name {name!r} is the archive's own")
