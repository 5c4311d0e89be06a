"""Runs the command line in the tests' own process."""

from warpchain import cli


def run(capsys, *words):
    """Exit status, output lines and error lines of one command."""
    try:
        status = cli.main([str(word) for word in words])
    except SystemExit as leave:
        status = leave.code
    captured = capsys.readouterr()
    return status, captured.out.splitlines(), captured.err.splitlines()
