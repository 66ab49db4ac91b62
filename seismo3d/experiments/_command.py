"""Measurements as commands: the one place where what is known to go wrong becomes a line and an exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

from seismo3d.errors import Seismo3dError


def run_command(main: Callable[[], None]) -> NoReturn:
    """Run a measurement and leave with its exit code: 0, or 2 and one line on stderr where its input is refused."""
    try:
        main()
    except Seismo3dError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
    sys.exit(0)
