"""Help, its examples and shell completion: what every command has."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys

import pytest
import typer

from seismo3d.cli import main
from seismo3d.cli.app import app

COMMANDS = sorted(typer.main.get_command(app).commands)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_examples(name, capsys):
    with pytest.raises(SystemExit) as left:
        main([name, "--help"])
    out = capsys.readouterr().out
    assert left.value.code == 0
    examples = out[out.index("Examples:") :].splitlines()[1:]
    assert examples
    assert all(line.startswith(f"    seismo3d {name} ") or line == f"    seismo3d {name}" for line in examples)


@pytest.mark.parametrize("name", COMMANDS)
def test_an_option_has_one_default(name, capsys):
    with pytest.raises(SystemExit):
        main([name, "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert re.findall(r"\[default: [^]]*\] \[default: [^]]*\]", said) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_are_command_lines_that_the_command_takes(name):
    command = typer.main.get_command(app).commands[name]
    for line in command.epilog.splitlines()[2:]:
        words = shlex.split(line.split(">")[0])
        with command.make_context(name, words[2:]) as context:
            assert context.params


@pytest.mark.parametrize("name", COMMANDS)
def test_what_is_written_is_named_alike(name):
    options = [p.opts for p in typer.main.get_command(app).commands[name].params if "-o" in p.opts]
    assert all("--out" in names for names in options)


@pytest.mark.parametrize(
    ("line", "wanted"),
    [("seismo3d fa", {"faults"}), ("seismo3d co", {"compare", "convert"}), ("seismo3d info --inl", {"--inline-byte"})],
)
def test_the_shell_completes(line, wanted):
    words = line.split()
    environment = {
        **os.environ,
        "_SEISMO3D_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
    }
    command = [sys.executable, "-c", "from seismo3d.cli import main; main()"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert set(done.stdout.split()) == wanted
    assert done.stderr == ""
