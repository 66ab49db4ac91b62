"""Progress of a run: how long each stage takes, or nothing."""

from __future__ import annotations

import time

from seismo3d._typing import Progress
from seismo3d._validate import told
from seismo3d.errors import ParameterError


def as_progress(progress: Progress | None) -> Progress:
    """Return a callback as it is, one that does nothing for none, or refuse what cannot be called.

    Raises
    ------
    ParameterError
        If it is no function.
    """
    if progress is None:
        return no_progress
    if not callable(progress):
        raise ParameterError(
            f"progress is {told(progress)}; expected a function of a stage's name and the share of it that is done. "
            "Give one, or leave it out."
        )
    return progress


def no_progress(stage: str, share: float) -> None:
    """Take reports of progress where nobody asked for them."""


class StageClock:
    """A progress callback that adds up the seconds of each stage and passes everything on.

    The time between two calls belongs to the stage of the first; :meth:`stop` closes the last one.

    Parameters
    ----------
    show : callable
        The progress callback to pass on to.
    """

    def __init__(self, show: Progress) -> None:
        self._show = show
        self._stage: str | None = None
        self._since = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, share: float) -> None:
        self._book(stage)
        self._show(stage, share)

    def stop(self) -> dict[str, float]:
        """Close the running stage and return the seconds by stage, rounded to milliseconds, in order of first call."""
        self._book(None)
        return {stage: round(seconds, 3) for stage, seconds in self.seconds.items()}

    def _book(self, stage: str | None) -> None:
        now = time.perf_counter()
        if self._stage is not None:
            self.seconds[self._stage] += now - self._since
        self._stage, self._since = stage, now
        if stage is not None:
            self.seconds.setdefault(stage, 0.0)
