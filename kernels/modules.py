"""A Warp module for each kernel, found again at a later start by a digest of its sources.

It saves Warp's own hash of 0.1 s a kernel.
"""

import hashlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

from .by_reference import with_structs_by_reference
from .physics import impact

try:
    from warp._src.context import Module, ModuleHasher
except ImportError:  # Warp has no public names for them: a version that keeps them elsewhere hashes kernels itself
    Module = ModuleHasher = None

KNOWN_VERSIONS = ("1.19.",)
"""Versions of Warp that take a hasher and generate code as here."""
SAME_BINARY = ("use_precompiled_headers",)
"""Warp's options that leave the compiled kernel alone."""

HERE = Path(__file__).parent
IMPORT = re.compile(r"^[ \t]*from (\.+)([\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def imported_files(path: Path) -> Iterator[Path]:
    """Files of this package that a kernel's file imports."""
    for dots, module, names in IMPORT.findall(path.read_text(encoding="utf-8")):
        base = path.parents[len(dots) - 1].joinpath(*module.split("."))
        if base.is_dir():
            yield from (file for name in re.findall(r"\w+", names) if (file := base / f"{name}.py").exists())
        else:
            yield base.with_suffix(".py")


@cache
def reached_files(start: Path) -> tuple[Path, ...]:
    """Files of this package that a kernel's file imports, also indirectly, and itself."""
    found, ahead = {start}, [start]
    while ahead:
        more = set(imported_files(ahead.pop())) - found
        found |= more
        ahead.extend(more)
    return tuple(sorted(found))


@cache
def sources_digest(start: Path) -> bytes:
    """Digest of the files that a kernel's file reaches."""
    files = reached_files(start)
    return hashlib.sha256(b"".join(bytes(path.relative_to(HERE)) + path.read_bytes() for path in files)).digest()


@cache
def _source_of(kind: type) -> str:
    """Text of the file that defines a class of a kernel's arguments, or ""."""
    path = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return Path(path).read_text(encoding="utf-8") if path else ""


def kernel_digest(file: str, name: str, *form: Any) -> bytes:
    """Digest of a kernel's sources, contact laws and factory arguments `form`, by their `repr`."""
    laws = "".join(law.adj.source for law in impact.FORCES)
    words = [name, laws, *(word for of in form for word in (repr(of), _source_of(type(of))))]
    return hashlib.sha256(sources_digest(Path(file)) + "\0".join(words).encode()).digest()


class _Hasher(ModuleHasher or object):
    """Warp's module hasher with one digest for all code."""

    def __init__(self, made_of: bytes, kernels: Any, options: Any) -> None:
        self.made_of = made_of
        super().__init__(kernels, {name: of for name, of in options.items() if name not in SAME_BINARY})

    def hash_adjoint(self, adj: Any) -> bytes:
        """Digest of a kernel, whose launch dimensions Warp finds here."""
        adj.get_references()
        return self.made_of


class _Module(Module or object):  # type: ignore[misc]
    """Warp's module with `_Hasher` and structs by reference."""

    def __init__(self, name: str, made_of: bytes) -> None:
        super().__init__(name, None)
        self.made_of = made_of

    def get_module_hash(self, block_dim: int | None = None) -> bytes:
        """Hash of the module for blocks of `block_dim` threads."""
        if block_dim is None:
            block_dim = self.options["block_dim"]
        if block_dim not in self.hashers:
            options = self.resolve_options(wp.config, block_dim=block_dim)
            self.hashers[block_dim] = _Hasher(self.made_of, self._get_live_kernels(), options)
            self.resolved_options[block_dim] = options
        return self.hashers[block_dim].get_hash()  # Warp's own would wait for the code of another module

    def _run_codegen(self, options: dict[str, Any], is_cpu: bool) -> tuple[Any, ...]:
        """Source of the module that Warp compiles, structs by reference, and what goes with it."""
        source, *more = super()._run_codegen(options, is_cpu)
        return with_structs_by_reference(source), *more


@cache
def _module(name: str, made_of: bytes) -> Any:
    """Warp module of a name and digest, one for all who ask."""
    return _Module(f"{name}_{made_of.hex()[:8]}", made_of)


def own_module(file: str, name: str, *form: Any) -> Any:
    """A Warp module for kernel `name` of `file` made for `form`."""
    if Module is None or not wp.__version__.startswith(KNOWN_VERSIONS):
        return "unique"
    return _module(name, kernel_digest(file, name, *form))


def without_contraction(kernel: wp.Kernel) -> wp.Kernel:
    """Turns off contraction of products and sums in a kernel; fixes its bits."""
    wp.set_module_options({"fuse_fp": False}, kernel.module)
    return kernel
