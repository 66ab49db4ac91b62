"""The kinds of fault evidence: sides carried along their dips, sides carried by registration, and both."""

from __future__ import annotations

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.errors import ParameterError
from seismo3d.seismic._kernels_registration import registered_misfit
from seismo3d.seismic.misfit import Compare, Evidence, MisfitSettings, compare_along, fuse_misfits
from seismo3d.seismic.side_shifts import RegistrationSettings, SideShifts, carry_sides, register_slices

EVIDENCE = ("semblance", "registration", "both")


def check_evidence(kind: str) -> None:
    """Refuse a kind of evidence that there is not.

    Raises
    ------
    ParameterError
        If `kind` is none of :data:`EVIDENCE`.
    """
    if kind not in EVIDENCE:
        raise ParameterError(f"evidence is {kind!r}; expected one of {', '.join(map(repr, EVIDENCE))}. Choose one.")


def refuse_in_blocks(kind: str) -> None:
    """Refuse what takes the cube in one piece, where that is worked on in blocks.

    Raises
    ------
    ParameterError
        If `kind` is not "semblance": slices are registered whole.
    """
    if kind != "semblance":
        raise ParameterError(
            f"evidence is {kind!r}, which takes the cube in one piece, and that needs more memory. Use 'semblance'."
        )


def measure_evidence(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    *,
    kind: str = "semblance",
    misfit: MisfitSettings | None = None,
    registration: RegistrationSettings | None = None,
) -> Evidence:
    """Measure how badly the two sides of every voxel fit, under one way of carrying them there or both.

    Semblance carries each side along reflector slopes, from the structure tensor. Registration carries it by shifts
    found by matching: every slice is registered with the next, coarse to fine, shifts that disagree with their
    surroundings are rejected, and each side follows its own. Where both are used, their log ratios add up: slopes fail
    where they differ from trace to trace, matching where layers repeat, and a fault shows in both.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, finite everywhere, and where there are any.
    slopes : tuple of ndarray of the same shape, float32
        Reflector slopes along inlines and crosslines; not used by registration alone.
    kind : {"semblance", "registration", "both"}
        Which evidence.
    misfit : MisfitSettings, optional
        Windows of the misfit.
    registration : RegistrationSettings, optional
        Windows of the registration.

    Returns
    -------
    Evidence

    Raises
    ------
    ParameterError
        If there is no such kind.
    """
    check_evidence(kind)
    registration = registration or RegistrationSettings()
    comparisons = []
    if kind != "registration":
        comparisons.append(compare_along(volume, valid, slopes))
    if kind != "semblance":
        fields = register_slices(volume, valid, settings=registration)
        sides = [carry_sides(field, settings=registration) for field in fields]
        comparisons.append(compare_registered(volume, valid, sides))
    return fuse_misfits(volume, valid, comparisons, share=registration.share, settings=misfit)


def compare_registered(volume: Float32Array, valid: BoolArray, sides: list[SideShifts]) -> Compare:
    """Return what compares the two sides of every voxel after each is carried by the shifts of its own side.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    sides : list of SideShifts
        Along inlines and along crosslines.

    Returns
    -------
    callable
        As :func:`~seismo3d.seismic.misfit.compare_along` returns it.
    """

    def compare(lines: slice, axis: int, reach: int, difference: Float32Array, energy: Float32Array) -> None:
        side = sides[axis]
        registered_misfit(
            volume[lines], valid[lines], side.behind[lines], side.ahead[lines], axis, reach, side.step,
            difference, energy,
        )  # fmt: skip

    return compare
