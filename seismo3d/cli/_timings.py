"""How long a command took, told at its end."""

from __future__ import annotations

from collections.abc import Mapping

import typer


def say_timings(seconds: Mapping[str, float]) -> None:
    """Write how long each stage took, and all of them, as one line on stderr."""
    stages = [f"{stage} {_words(taken)}" for stage, taken in seconds.items() if taken >= 0.05]
    total = f"time     {_words(sum(seconds.values()))}"
    typer.echo(total + (f" ({', '.join(stages)})" if len(stages) > 1 else ""), err=True)


def _words(seconds: float) -> str:
    """Seconds as a person reads them.

    Examples
    --------
    >>> _words(3.21), _words(75.4), _words(7384.0)
    ('3.2 s', '1 min 15 s', '2 h 3 min')
    """
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
