"""The kinds of fault evidence: sides carried along their dips, sides carried by registration, and both."""

from __future__ import annotations

from collections.abc import Sequence

from seismo3d._typing import BoolArray, Float32Array
from seismo3d._validate import is_among, told
from seismo3d.errors import ParameterError
from seismo3d.seismic._kernels_registration import registered_misfit
from seismo3d.seismic.misfit import Compare, Evidence, compare_along, fuse_misfits
from seismo3d.seismic.misfit_settings import MisfitSettings
from seismo3d.seismic.side_shifts import RegistrationSettings, SideShifts, carry_sides, register_slices

EVIDENCE = ("semblance", "registration", "both")


def check_evidence(kind: str) -> None:
    """Refuse a kind of evidence that there is not.

    Raises
    ------
    ParameterError
        If `kind` is none of :data:`EVIDENCE`.
    """
    if not is_among(kind, EVIDENCE):
        raise ParameterError(f"evidence is {told(kind)}; expected one of {', '.join(map(repr, EVIDENCE))}. Choose one.")


def measure_evidence(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    *,
    kind: str = "both",
    misfit: MisfitSettings | None = None,
    registration: RegistrationSettings | None = None,
    farther: float = 0.0,
) -> Evidence:
    """Measure how badly the two sides of every voxel fit, under one way of carrying them there or both.

    Semblance carries each side along reflector slopes, from the structure tensor. Registration carries it by shifts
    found by matching: every slice is registered with the next, coarse to fine, shifts that disagree with their
    surroundings are rejected, and each side follows its own. Where both are used, the mean of their log ratios counts:
    registration three quarters without noise, slopes alone in the mild noise of a good survey, and registration the
    more the noisier the cube is beyond that.

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
    farther : float
        Share of what is measured over one trace more a side: see :func:`~seismo3d.seismic.misfit.fuse_misfits`.

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
        comparisons.append(compare_registered(volume, valid, settings=registration))
    return fuse_misfits(
        volume, valid, comparisons, share=registration.share, share_noises=registration.share_noises,
        farther=farther, settings=misfit,
    )  # fmt: skip


def compare_registered(
    volume: Float32Array, valid: BoolArray, *, settings: RegistrationSettings | None = None
) -> Compare:
    """Return what compares the two sides of every voxel after each is carried by the shifts of its own side.

    The slices are registered when it is first called.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    settings : RegistrationSettings, optional
        Windows.

    Returns
    -------
    callable
        As :func:`~seismo3d.seismic.misfit.compare_along` returns it.
    """
    sides: list[SideShifts] = []

    def compare(axis: int, reach: int, corner: tuple[int, int], difference: Float32Array, energy: Float32Array) -> None:
        if not sides:
            sides.extend(carry_sides(f, settings=settings) for f in register_slices(volume, valid, settings=settings))
        compare_sides(volume, valid, sides)(axis, reach, corner, difference, energy)

    return compare


def compare_sides(volume: Float32Array, valid: BoolArray, sides: Sequence[SideShifts]) -> Compare:
    """Return what :func:`compare_registered` does, for sides that are known, one of each axis."""

    def compare(axis: int, reach: int, corner: tuple[int, int], difference: Float32Array, energy: Float32Array) -> None:
        side = sides[axis]
        registered_misfit(volume, valid, side.behind, side.ahead, axis, reach, side.step, corner, difference, energy)

    return compare
