"""Errors that seismo3d raises on bad input, and its warnings: each says what came, what was needed, what to do."""

from __future__ import annotations


class Seismo3dError(Exception):
    """Root of all errors that seismo3d raises on purpose."""


class ShapeError(Seismo3dError, ValueError):
    """An array has the wrong number of axes, the wrong size, or the wrong type of elements."""


class ParameterError(Seismo3dError, ValueError):
    """A setting is outside the values that it can take."""


class GeometryError(Seismo3dError, ValueError):
    """The data's geometry does not allow the operation: too few points, all on one line, no common area."""


class FormatError(Seismo3dError, ValueError):
    """A file is not what its name says, is cut short, or holds values that cannot be."""


class FileAccessError(Seismo3dError, OSError):
    """A file or folder cannot be read or written."""


class MissingDependencyError(Seismo3dError, ImportError):
    """An optional package is needed and not installed."""


class RenderError(Seismo3dError, RuntimeError):
    """The machine has no way to draw a 3D scene."""


class Seismo3dWarning(UserWarning):
    """The data allow the operation, but its result may be empty or poor."""
