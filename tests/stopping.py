"""Commands that are interrupted, and processes that are killed, at a moment that can be told again."""

import os
import signal
import sys

from warpchain import cli


def interrupted_at(line, command):
    """Runs a command, with Ctrl-C at some line of the package's that it runs; its status, and how many lines it has."""
    lines = 0

    def trace(frame, event, _):
        nonlocal lines
        if "warpchain" not in frame.f_code.co_filename:
            return None
        lines += event == "line"
        if event == "line" and lines == line:
            signal.raise_signal(signal.SIGINT)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        return cli.main(command), lines
    finally:
        sys.settrace(before)


def interruptions(command, folder, count, capfd):
    """Interrupts a command at so many moments, spread over all lines that it runs, each time with another folder as its
    last word; yields that folder, the status, and what was told."""
    _, most = interrupted_at(0, [*command, str(folder / "counted")])
    capfd.readouterr()
    for turn in range(count):
        out = folder / str(turn)
        status, _ = interrupted_at(1 + (2 * turn + 1) * most // (2 * count), [*command, str(out)])
        yield out, status, capfd.readouterr()


class Killed(BaseException):
    """The end of the process: no handler of the package's catches it."""


def killed_at_file_operation(patch):
    """From now on file operations count down the first of the list that is returned, and the one at 0 kills."""
    left = [0]

    def deadly(operation):
        def call(*arguments, **settings):
            left[0] -= 1
            if left[0] == 0:
                raise Killed(operation.__name__)
            return operation(*arguments, **settings)

        return call

    for name in ("fsync", "link", "rename", "replace"):
        patch.setattr(os, name, deadly(getattr(os, name)))
    return left
