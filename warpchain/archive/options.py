"""Options of writing an archive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from warpchain.argument_checks import Count, Index, Workers, check_arguments
from warpchain.errors import ArchiveError

Compression = Literal["zstd", "lz4", "none"]
StoredPrecision = Literal["run", "float32"]


@check_arguments(ArchiveError)
@dataclass(frozen=True)
class ArchiveOptions:
    """Options of writing an archive.

    Attributes:
        compression: "zstd", "lz4" or "none".
        values: "run" keeps rollers in the run's precision, bitwise; "float32" halves the archive of a float64 run.
        exact_positions: with values = "float32", positions also as float64.
        split_size: size [bytes] at which another file begins.
        split_variants: recorded variants in one file. Not together with `split_size`.
        encoders: threads that compress chunks; None takes one a core, four at most.
        numbers: what the archive calls the run's variants; None calls them 0, 1, 2, ...
        seed: of the design whose variants these are.
        attachments: further files by name, such as {"study.toml": b"..."}.

    Raises:
        ArchiveError: a value that is not allowed.
    """

    compression: Compression = "zstd"
    values: StoredPrecision = "run"
    exact_positions: bool = False
    split_size: Count | None = None
    split_variants: Count | None = None
    encoders: Workers | None = None
    numbers: Sequence[Index] | None = None
    seed: int | None = None
    attachments: Mapping[str, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.split_size is not None and self.split_variants is not None:
            raise ArchiveError("split_size and split_variants: give one of them")
        if self.exact_positions and self.values != "float32":
            raise ArchiveError('exact_positions = True: goes with values="float32"; else positions are exact already')
        if self.numbers is not None and len(set(self.numbers)) < len(self.numbers):
            raise ArchiveError("numbers: must be different from each other")
        for name in self.attachments:
            if name == "metrics.arrow" or name.startswith("drives/"):
                raise ArchiveError(f"attachments: the name {name!r} is the archive's own")
