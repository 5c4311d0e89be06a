"""A module for each kernel, which Warp finds again at a later start by the sources it was made of.

Warp finds a kernel that it has compiled before by a hash of every function, constant and type that the kernel reaches,
which takes it about 0.1 s a kernel at each start, and twice that where it also names the kernel's module. The kernels
here hang on nothing but files of this package, those that the kernel's own imports, directly or not, and on what their
factories were asked for: a hash of these does as well. Warp adds its own version, its options and the processor that it
compiles for, as always.
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
"""Warp's versions whose modules are known to take their hash from a hasher and to generate code as here."""
SAME_BINARY = ("use_precompiled_headers",)
"""Options that leave the compiled kernel as it is; the command line sets one that calls from Python do not."""

HERE = Path(__file__).parent
IMPORT = re.compile(r"^[ \t]*from (\.+)([\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def imported_files(path: Path) -> Iterator[Path]:
    """The files of this package that one of them imports, each by a relative import."""
    for dots, module, names in IMPORT.findall(path.read_text(encoding="utf-8")):
        base = path.parents[len(dots) - 1].joinpath(*module.split("."))
        if base.is_dir():
            yield from (file for name in re.findall(r"\w+", names) if (file := base / f"{name}.py").exists())
        else:
            yield base.with_suffix(".py")


@cache
def reached_files(start: Path) -> tuple[Path, ...]:
    """A file of this package and those that it imports, directly or not, in order."""
    found, ahead = {start}, [start]
    while ahead:
        more = set(imported_files(ahead.pop())) - found
        found |= more
        ahead.extend(more)
    return tuple(sorted(found))


@cache
def sources_digest(start: Path) -> bytes:
    """Digest of the files that a file of this package reaches."""
    files = reached_files(start)
    return hashlib.sha256(b"".join(bytes(path.relative_to(HERE)) + path.read_bytes() for path in files)).digest()


@cache
def _source_of(kind: type) -> str:
    """The file of a class, or "" of a builtin one."""
    path = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return Path(path).read_text(encoding="utf-8") if path else ""


def kernel_digest(file: str, name: str, *form: Any) -> bytes:
    """Digest of what a kernel of this name is made of: sources, the laws at hand, and what its factory was asked for.

    Args:
        file: where the kernel is.
        form: types, numbers, and dataclasses: what `repr` tells whole, together with the file of its class.
    """
    laws = "".join(law.adj.source for law in impact.FORCES)
    words = [name, laws, *(word for of in form for word in (repr(of), _source_of(type(of))))]
    return hashlib.sha256(sources_digest(Path(file)) + "\0".join(words).encode()).digest()


class _Hasher(ModuleHasher or object):
    """Warp's, with one digest for whatever a kernel reaches."""

    def __init__(self, made_of: bytes, kernels: Any, options: Any) -> None:
        self.made_of = made_of
        super().__init__(kernels, {name: of for name, of in options.items() if name not in SAME_BINARY})

    def hash_adjoint(self, adj: Any) -> bytes:
        """The digest, of a kernel; looking through it also tells it how many dimensions a launch has."""
        adj.get_references()
        return self.made_of


class _Module(Module or object):  # type: ignore[misc]
    """Warp's, with that hasher, and with structs handed by reference in the code that it generates."""

    def __init__(self, name: str, made_of: bytes) -> None:
        super().__init__(name, None)
        self.made_of = made_of

    def get_module_hash(self, block_dim: int | None = None) -> bytes:
        """The hash for blocks of so many threads."""
        if block_dim is None:
            block_dim = self.options["block_dim"]
        if block_dim not in self.hashers:
            options = self.resolve_options(wp.config, block_dim=block_dim)
            self.hashers[block_dim] = _Hasher(self.made_of, self._get_live_kernels(), options)
            self.resolved_options[block_dim] = options
        return self.hashers[block_dim].get_hash()  # Warp's own would wait for the code of another module

    def _run_codegen(self, options: dict[str, Any], is_cpu: bool) -> tuple[Any, ...]:
        """The source that is compiled, and what goes with it."""
        source, *more = super()._run_codegen(options, is_cpu)
        return with_structs_by_reference(source), *more


@cache
def _module(name: str, made_of: bytes) -> Any:
    return _Module(f"{name}_{made_of.hex()[:8]}", made_of)


def own_module(file: str, name: str, *form: Any) -> Any:
    """A module of its own, as `wp.kernel` takes it, for the kernel of this name in `file` that is made for `form`."""
    if Module is None or not wp.__version__.startswith(KNOWN_VERSIONS):
        return "unique"
    return _module(name, kernel_digest(file, name, *form))


def without_contraction(kernel: wp.Kernel) -> wp.Kernel:
    """A kernel in which the compiler takes no product and sum together: to each it gives the same bits wherever it
    stands, so kernels in which more or less is done beside it agree.
    """
    wp.set_module_options({"fuse_fp": False}, kernel.module)
    return kernel
