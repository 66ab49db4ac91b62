from __future__ import annotations

import pytest

from seismo3d.errors import ParameterError
from seismo3d.experiments._command import run_command


def leave(main):
    with pytest.raises(SystemExit) as left:
        run_command(main)
    return left.value.code


def test_a_measurement_that_is_done_leaves_with_zero(capsys):
    assert leave(lambda: print("0.98")) == 0
    assert capsys.readouterr() == ("0.98\n", "")


def test_refused_input_is_one_line_and_two(capsys):
    def refuse():
        raise ParameterError("seeds is 0; expected 1 or more.")

    assert leave(refuse) == 2
    assert capsys.readouterr() == ("", "error: seeds is 0; expected 1 or more.\n")


def test_a_defect_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run_command(lambda: 1 // 0)
