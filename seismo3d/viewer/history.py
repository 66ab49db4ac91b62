"""Undo and redo over states that never change."""

from __future__ import annotations

from seismo3d.viewer.interpretation import Interpretation


class History:
    """The states of a session, and where in them it stands.

    Parameters
    ----------
    state : Interpretation
        The first state; it counts as saved.
    """

    def __init__(self, state: Interpretation) -> None:
        self._states = [state]
        self._words = [""]
        self._at = 0
        self._saved: Interpretation | None = state

    @property
    def state(self) -> Interpretation:
        """The present state."""
        return self._states[self._at]

    @property
    def is_saved(self) -> bool:
        """Whether the present state is the one that was saved last."""
        return self.state is self._saved

    @property
    def undo_words(self) -> str:
        """What undo would take back; empty where there is nothing."""
        return self._words[self._at]

    @property
    def redo_words(self) -> str:
        """What redo would do again; empty where there is nothing."""
        return self._words[self._at + 1] if self._at + 1 < len(self._states) else ""

    def do(self, state: Interpretation, words: str) -> None:
        """Go on to a new state; what had been undone is gone.

        Parameters
        ----------
        state : Interpretation
            The new state.
        words : str
            What was done, such as "delete fault 3".
        """
        del self._states[self._at + 1 :], self._words[self._at + 1 :]
        self._states.append(state)
        self._words.append(words)
        self._at += 1

    def undo(self) -> str:
        """Go back one state, and return what was taken back; nothing happens at the first."""
        words = self.undo_words
        if words:
            self._at -= 1
        return words

    def redo(self) -> str:
        """Go on one state, and return what was done again; nothing happens at the last."""
        words = self.redo_words
        if words:
            self._at += 1
        return words

    def mark_saved(self) -> None:
        """Remember the present state as the one that was saved."""
        self._saved = self.state
