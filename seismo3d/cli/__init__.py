"""The command line: one file a command, and one place where errors become exit codes.

To add a command ``faults``, write ``cli/faults.py`` with a function ``run`` whose docstring is its help and whose typed
parameters are its options, and with ``EXAMPLES``, command lines that its help shows: :mod:`seismo3d.cli.app` finds it.
Import heavy modules inside ``run``. Print results to stdout by :func:`typer.echo`, progress by
:func:`seismo3d.cli.app.shown_progress`, and let errors fly.
"""

from __future__ import annotations

import signal
import sys
import threading
import warnings
from collections.abc import Sequence
from types import FrameType
from typing import Any, NoReturn, TextIO

BAD_INPUT = 2
INTERRUPTED = 130
TERMINATED = 143


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run one command and leave with its exit code: 0; 2 on bad input; 130 when interrupted, 143 when terminated."""
    words = list(sys.argv[1:] if args is None else args)
    debug = "--debug" in words
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _terminate)
    sys.exit(_run([word for word in words if word != "--debug"], debug=debug))


def _run(words: list[str], *, debug: bool) -> int:
    """Run a command and turn what is known to go wrong into one line on stderr and an exit code."""
    import typer

    from seismo3d.cli.app import app
    from seismo3d.errors import Seismo3dError

    usage_error: type[BaseException] = typer.BadParameter.__bases__[0]
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _warn
            code = app(words or ["--help"], prog_name="seismo3d", standalone_mode=False)
        sys.stdout.flush()
    except usage_error as error:
        return _say(getattr(error, "format_message", error.__str__)(), BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # whoever reads our output has gone: nothing is left to say
        return 1
    except (Seismo3dError, OSError, MemoryError) as error:
        if debug:
            raise
        return _say(_words_of(error), BAD_INPUT)
    if code == INTERRUPTED:
        return _say("interrupted; nothing half-written was left", INTERRUPTED)
    return code if isinstance(code, int) else 0


def _words_of(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}. Give a smaller cube, or convert it to Zarr, which is read in blocks."
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'the system'}: {error.strerror}."
    return str(error)


def _say(message: str, code: int) -> int:
    line = " ".join(message.split())
    sys.stderr.write(f"seismo3d: {line}\n")
    return code


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Turn a warning of our own into one line on stderr; show others as Python does."""
    from seismo3d.errors import Seismo3dWarning

    if issubclass(category, Seismo3dWarning):
        _say(str(message), 0)
    else:
        (file or sys.stderr).write(warnings.formatwarning(message, category, filename, lineno, line))


def _terminate(number: int, frame: FrameType | None) -> Any:  # noqa: ARG001 - the signature of a signal handler
    """Unwind as on Ctrl-C, so that nothing half-written stays."""
    raise SystemExit(TERMINATED)
