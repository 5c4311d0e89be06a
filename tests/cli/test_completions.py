"""Shell completion: the scripts complete commands, options and files, in bash as it runs."""

import subprocess
import sys

import pytest
from command import refused
from command import run as command


def completed(script, *words, cwd):
    """Completions that bash offers for the last of the words."""
    line = " ".join(words)
    code = (
        f"{script}\ncomplete -p warpchain >/dev/null || exit 9\n"
        f"COMP_WORDS=({' '.join(repr(word) for word in words)}); COMP_CWORD={len(words) - 1}\n"
        f"COMP_LINE={line!r}; COMP_POINT={len(line)}\n"
        "$(complete -p warpchain | sed -n 's/.*-F \\([^ ]*\\).*/\\1/p') warpchain\nprintf '%s\\n' \"${COMPREPLY[@]}\""
    )
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return {word.strip() for word in done.stdout.splitlines()}


def test_bash_completes_commands_options_words_and_files(capsys, tmp_path):
    pytest.importorskip("shtab")
    status, out, err = command(capsys, "--completions", "bash")
    assert (status, err) == (0, [])
    script = "\n".join(out)
    (tmp_path / "drive.toml").write_text("")
    (tmp_path / "folder").mkdir()
    assert {"check", "draw", "study", "schema"} <= completed(script, "warpchain", "", cwd=tmp_path)
    assert completed(script, "warpchain", "sche", cwd=tmp_path) == {"schema"}
    assert {"run", "plan", "merge"} <= completed(script, "warpchain", "study", "", cwd=tmp_path)
    assert "--watch" in completed(script, "warpchain", "draw", "--", cwd=tmp_path)
    assert completed(script, "warpchain", "schema", "", cwd=tmp_path) >= {"drive", "study"}
    assert {"float32", "float64"} <= completed(script, "warpchain", "run", "--precision", "", cwd=tmp_path)
    assert {"drive.toml", "folder/"} & completed(script, "warpchain", "check", "d", cwd=tmp_path) == {"drive.toml"}


@pytest.mark.parametrize(("shell", "mark"), [("zsh", "#compdef warpchain"), ("fish", "complete -c warpchain")])
def test_other_shells_have_scripts_with_every_command(capsys, shell, mark):
    pytest.importorskip("shtab")
    status, out, _ = command(capsys, "--completions", shell)
    text = "\n".join(out)
    assert status == 0 and mark in text and all(word in text for word in ("draw", "tensioner", "merge"))


def test_another_shell_or_no_shtab_is_one_line(capsys, monkeypatch):
    assert "invalid choice: 'cmd'" in refused(capsys, "--completions", "cmd")
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert "--completions: needs shtab; install it with: pip" in refused(capsys, "--completions", "bash")
