"""What CUDA's intermediate code (PTX) of a kernel does in its time loop, found by who can jump where."""

import re
from collections import Counter
from itertools import chain
from pathlib import Path

JUMP = re.compile(r"(@!?%\w+\s+)?bra(?:\.uni)?\s+(\$[\w$]+)")
END = re.compile(r"(ret|exit|trap)\b")


def compiled(kernel, folder: Path, arch: int = 89) -> str:
    """PTX of a Warp kernel's module; needs no GPU."""
    import warp as wp

    wp.compile_aot_module(kernel.module, device=None, arch=arch, module_dir=str(folder), use_ptx=True)
    (path,) = folder.glob("*.ptx")
    return path.read_text()


def called(ptx: str) -> set[str]:
    """Names of warpchain's functions that the compiler has not drawn in, where they are called."""
    return {name for name in re.findall(r"\bcall(?:\.uni)?\s+(?:\([^)]*\),\s*)?([\w$]+)", ptx) if "_locals__" in name}


def basic_blocks(ptx: str) -> tuple[list[list[str]], list[list[int]]]:
    """Instructions of the kernel's basic blocks, and to which of them each can go on."""
    blocks: list[list[str]] = [[]]
    names: dict[str, int] = {}
    for line in map(str.strip, ptx[ptx.index("\n{", ptx.index(".entry")) :].splitlines()):
        if label := re.match(r"(\$[\w$]+):", line):
            blocks.append([])
            names[label[1]] = len(blocks) - 1
        elif line and not line.startswith((".", "//", "{", "}")):
            blocks[-1].append(line)
            if JUMP.match(line) or END.match(line):
                blocks.append([])
    after = []
    for number, lines in enumerate(blocks):
        jump = JUMP.match(lines[-1]) if lines else None
        goes_on = not (lines and END.match(lines[-1])) and not (jump and jump[1] is None)
        ways = [names[jump[2]]] if jump else []
        after.append(ways + [number + 1] * (goes_on and number + 1 < len(blocks)))
    return blocks, after


def reached(start: int, ways: list[list[int]]) -> set[int]:
    """The blocks that one can come to from a block."""
    found, left = set(), [start]
    while left:
        for block in ways[left.pop()]:
            if block not in found:
                found.add(block)
                left.append(block)
    return found


def largest_loop(after: list[list[int]]) -> set[int]:
    """The blocks of the largest loop: all that can come to themselves again by way of each other."""
    before: list[list[int]] = [[] for _ in after]
    for number, ways in enumerate(after):
        for way in ways:
            before[way].append(number)
    return max((reached(number, after) & reached(number, before) for number in range(len(after))), key=len)


def time_loop(ptx: str) -> tuple[list[str], list[str]]:
    """All instructions of the kernel, and those of its largest loop."""
    blocks, after = basic_blocks(ptx)
    within = [blocks[number] for number in sorted(largest_loop(after))]
    return list(chain(*blocks)), list(chain(*within))


def header_of(loop: set[int], after: list[list[int]]) -> int:
    """The block by which one comes into a loop."""
    outside = ({0} | reached(0, after)) - loop  # the parser also makes empty blocks that nobody comes to
    (header,) = {way for number in outside for way in after[number] if way in loop}
    return header


def loop_without_float64(ptx: str) -> tuple[list[str], list[list[str]]]:
    """What of the time loop one can go around without float64, and the blocks with it, branch by branch.

    A branch is all that lies between two blocks that every way around goes through: what an event does is one,
    whatever it asks within.
    """
    blocks, after = basic_blocks(ptx)
    loop = largest_loop(after)
    with_it = {number for number in loop if float64_arithmetic(blocks[number])}
    free = loop - with_it
    clean = largest_loop([[way for way in ways if way in free and n in free] for n, ways in enumerate(after)])
    header, within = header_of(loop, after), [[way for way in ways if way in loop] for ways in after]
    others = [number for number in loop if number != header and header not in reached(header, without(number, within))]
    always = {header, *others}
    between = [[way for way in ways if way not in always] for ways in within]
    found = [with_it & ({number} | reached(number, between)) for number in sorted(always)]
    lines = [[line for number in sorted(branch) for line in blocks[number]] for branch in found if branch]
    return [line for number in sorted(clean) for line in blocks[number]], lines


def without(block: int, ways: list[list[int]]) -> list[list[int]]:
    """The ways that are left where nobody can come to a block."""
    return [[way for way in each if way != block] for each in ways]


def largest_part_without_float64(ptx: str) -> list[str]:
    """The most of the time loop that one block alone leads to and that has no float64: a step of a kind of its own."""
    blocks, after = basic_blocks(ptx)
    loop = largest_loop(after)
    header, within = header_of(loop, after), [[way for way in ways if way in loop] for ways in after]
    parts = [loop - reached(header, without(number, within)) - {header} for number in loop - {header}]
    clean = [part for part in parts if not any(float64_arithmetic(blocks[number]) for number in part)]
    return max(([line for number in sorted(part) for line in blocks[number]] for part in clean), key=len)


def contractible(lines: list[str]) -> list[str]:
    """Sums and products without a rounding of their own, which compilers may take together."""
    return [line for line in lines if re.search(r"\b(add|sub|mul)\.(ftz\.)?f(32|64)\b", line)]


MEMORY = ("ld.", "st.", "mov.", "shfl.", "red.", "atom.")
"""What is not the work of the units that calculate: the memory's own additions among them."""


def float64_arithmetic(lines: list[str]) -> Counter[str]:
    """How often each operation on float64 stands there: all but what memory does."""
    names = (re.sub(r"^@!?%\w+\s+", "", line).split()[0] for line in lines)
    return Counter(name for name in names if ".f64" in name and not name.startswith(MEMORY))
