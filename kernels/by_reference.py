"""Structs by reference in the C++ that Warp generates, which compiles faster than by value.

Only structs of kinds that no function writes to.
"""

import re

STRUCT = re.compile(r"^struct (\w+)$", re.MULTILINE)
CONSTANT = re.compile(r"^ +const (\w+) var_\w+ = ", re.MULTILINE)
PIECE = re.compile(r'^(?=static |extern "C")', re.MULTILINE)
FUNCTION = re.compile(r"static .*?\b(?!adj_)(\w+)\($", re.MULTILINE)
PARAMETER = re.compile(r"^    (\w+) (var_\w+)(?=[,)])", re.MULTILINE)
BODY, FORWARD = "\n{\n", "    // forward\n"

VARIABLE = re.compile(r"\bvar_\w+")
ARRAY = re.compile(r"^ +wp::array_t<.*>\* (var_\w+);", re.MULTILINE)
ELEMENT = re.compile(r"wp::(?:index|array_atomic_\w+)\(\*\((var_\w+)\)")
ADDRESS = re.compile(r"(var_\w+) = &\((.*)\);")
LOAD = re.compile(r"(var_\w+) = wp::load\(var_\w+\);")
COPY = re.compile(r"(?:return |(ret_\w+|var_[\w.]+) = )(var_\w+);")
CALL = re.compile(r"(?:return |(var_[\w.]+) = )?([\w:]+)\(([\w, ]*)\);")
READING = {"wp::where", "wp::copy", "wp::array_store"}
"""Warp functions that do not write to their arguments."""


def with_structs_by_reference(source: str) -> str:
    """Warp's generated C++ with structs by reference that no function writes."""
    pieces = [piece.partition(BODY) for piece in PIECE.split(source)]
    functions = [(found[1], head, body) for head, _, body in pieces if (found := FUNCTION.match(head))]
    reading = READING | {name for name, _, _ in functions}
    kinds = set(STRUCT.findall(source)) - set(CONSTANT.findall(source))
    for _, head, body in functions:
        changed = _written_variables(body, reading)
        kinds -= {kind for kind, name in PARAMETER.findall(head) if name in changed}

    def parameter(of: re.Match[str]) -> str:
        """A struct's parameter by reference in C++, if of the kinds."""
        return f"    {of[1]} & {of[2]}" if of[1] in kinds else of[0]

    heads = (PARAMETER.sub(parameter, head) if FUNCTION.match(head) else head for head, _, _ in pieces)
    return "".join(head + brace + body for head, (_, brace, body) in zip(heads, pieces, strict=True))


def _written_variables(body: str, reading: set[str]) -> set[str]:
    """Variables of generated C++ that a function's statements may write."""
    changed: set[str] = set()
    handed: set[str] = set()
    pointers: dict[str, set[str]] = {}
    arrays = set(ARRAY.findall(body))
    for line in map(str.strip, body.partition(FORWARD)[2].split("\n")):
        if line.startswith("//"):
            continue
        line = ELEMENT.sub(lambda of: "" if of[1] in arrays else of[0], line)
        names = set(VARIABLE.findall(line))
        if address := ADDRESS.fullmatch(line):
            inside = set(VARIABLE.findall(address[2]))
            pointers.setdefault(address[1], set()).update(inside)
            handed |= inside
        elif load := LOAD.fullmatch(line):
            changed.add(load[1])
        elif (read := COPY.fullmatch(line)) or ((read := CALL.fullmatch(line)) and read[2] in reading):
            changed.update(VARIABLE.findall((read[1] or "").partition(".")[0]))
            handed |= set(VARIABLE.findall(line[read.start(2) :]))
        else:
            changed |= names
    for pointer, inside in pointers.items():
        if pointer in changed | handed:
            changed |= inside
    return changed
