"""The list of commands, and the scripts with which shells complete them."""

import subprocess

import pytest

from foresee.__main__ import COMMANDS, FIRST, STUDIES, main
from foresee.completion import SHELLS
from foresee.completion import main as completion


def test_the_list_begins_with_the_first_commands_and_fits_on_a_screen(capsys):
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 40
    listed = [line.split()[0] for line in lines if line.startswith("  ")]
    assert tuple(listed[: len(FIRST)]) == FIRST
    assert set(COMMANDS) <= set(listed)
    assert not [name for name in STUDIES if name not in " ".join(lines)]


def test_the_version_is_told(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("foresee ")


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_of_a_shell_names_commands_and_options(shell, capsys):
    pytest.importorskip("shtab")
    assert completion([shell]) == 0
    script = capsys.readouterr().out
    assert "corridor" in script
    assert "pose-error" in script


def test_bash_completes_an_option(tmp_path, capsys):
    pytest.importorskip("shtab")
    completion(["bash"])
    file = tmp_path / "completion.sh"
    file.write_text(capsys.readouterr().out)
    ask = "COMP_WORDS=(foresee corridor --pose-e); COMP_CWORD=2; _shtab_foresee; echo $COMPREPLY"
    done = subprocess.run(
        ["bash", "-c", f"source {file}; {ask}"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "--pose-error"


def test_another_shell_is_refused(capsys):
    assert completion(["fish"]) == 2
    assert "bash, zsh or tcsh" in capsys.readouterr().err
