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


def refused(capsys, *words):
    """The one line that a command is refused with, which prints nothing else."""
    status, out, err = run(capsys, *words)
    assert (status, out, len(err)) == (2, [], 1), (out, err)
    assert err[0].startswith("warpchain") and ": error: " in err[0]
    return err[0]
