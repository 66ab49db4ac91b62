"""Time lapse: a monitor cube aligned with its base cube, with the shifts and their uncertainty as cubes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from scipy import fft, ndimage

from seismo3d._settings import Positive, Smoothing, as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Progress
from seismo3d._validate import as_strong, freeze
from seismo3d.errors import GeometryError, ParameterError, Seismo3dWarning, ShapeError
from seismo3d.registration.register import register
from seismo3d.registration.result import Registration
from seismo3d.seismic.cube_checks import check_order, differing_axis
from seismo3d.seismic.local_shifts import carry, measure_unevenness, refine_shifts
from seismo3d.seismic.preparing import balance_traces, find_scale, mark_data, scale_amplitudes
from seismo3d.seismic.whole_shift import settle_whole

# how many times as like a monitor is with its sign changed where its polarity is reversed, how like it is then, and how
# like it must be for that to be told at all: half a wavelength off, any cube is somewhat like itself reversed
_OPPOSED, _REVERSED, _TOLD = 1.25, 0.6, 0.2
# what tells another cube: a correlation with the base, shifted as a whole, below the first, and a median standard
# deviation in samples above the second or a correlation after the fit below the third. Windows fit other layers to 0.7,
# but unevenly: by 1 sample and more. Noise of three times the amplitudes leaves a true monitor 0.28 and 0.6 samples
_UNLIKE, _UNEVEN, _UNFIT = 0.27, 0.9, 0.2
# widths of a smoothing within which it takes what lies beyond an end
_ENDS = 2.0
# share of the base's data that must have a counterpart at a shift of the whole
_OVERLAP = 0.5


@dataclass(frozen=True, slots=True)
class TimeLapseSettings:
    """How two cubes are aligned; lengths in traces and samples.

    Attributes
    ----------
    levels : tuple of float in [0, 1000], not empty
        Widths of the smoothing of the amplitudes down the samples, from coarse to fine; within twice a width of an end
        or a gap they do not count.
    passes : int in [1, 20]
        Least-squares steps a level.
    lateral, vertical : float in (0, 100], (0, 200]
        Widths of the Gaussian window over which the cubes are compared.
    prior : (float, float) in (0, inf)
        Standard deviations that are expected: of the lateral shift from that of the whole, in traces, and of the
        vertical one from its surroundings. Where the data say less than these, they are what is left.
    largest : float in [1000, inf]
        Most cells that the coarse registration works on; larger cubes are thinned first.
    """

    levels: Annotated[tuple[Smoothing, ...], "not empty"] = (6.0, 2.5, 0.0)
    passes: Annotated[int, "[1, 20]"] = 3
    lateral: Annotated[float, "(0, 100]"] = 4.0
    vertical: Annotated[float, "(0, 200]"] = 10.0
    prior: tuple[Positive, Positive] = (0.5, 4.0)
    largest: Annotated[float, "[1000, inf]"] = 2e6


@dataclass(frozen=True, slots=True, eq=False)
class CubeAlignment:
    """Shifts from a base cube to a monitor cube.

    Attributes
    ----------
    shift : array of the base's shape, float32
        How far what is at a place of the base lies deeper in the monitor, in the base's ms, m or ft (samples of bare
        arrays); NaN on traces that both cubes lack. A DataArray where the base was one.
    shift_std : array of the same shape, float32
        Its standard deviation: of the amplitudes' misfit, taken as a tenth of them at least, the prior, the shift of
        the whole, and the unevenness of the shifts in a window.
    inline_shift, crossline_shift : arrays of the same shape, float32
        The same along the inline and the crossline axis, in traces.
    inline_std, crossline_std : arrays of the same shape, float32
        Their standard deviations: as large as the prior's or larger where nothing is to be told, as along level layers
        and where one lateral shift and vertical shifts of parts of the cube look alike.
    aligned : array of the same shape, float32
        The monitor carried to the base; 0 where it has no data for a place, NaN there on traces that it lacks.
    coarse : Registration
        What :func:`seismo3d.register` found for the whole.
    start : tuple of float
        The shift of the whole, in traces and samples, that local windows started from: what it found, or the best
        vertical shift where that fits about as well. The lateral one is settled anew from there.
    """

    shift: Any
    shift_std: Any
    inline_shift: Any
    crossline_shift: Any
    inline_std: Any
    crossline_std: Any
    aligned: Any
    coarse: Registration
    start: tuple[float, float, float]


def align_cubes(
    base: Any, monitor: Any, *, settings: TimeLapseSettings | None = None, progress: Progress | None = None
) -> CubeAlignment:
    r"""Align a monitor cube with its base: local shifts in all three directions, with their uncertainty.

    :func:`seismo3d.register` gives the shift of the whole. Local windows then minimise
    :math:`\sum w\,(b(x) - m(x + s))^2` by least squares, coarse to fine (Lucas and Kanade's fit [1]_ in three
    dimensions), with a Gaussian prior on the lateral shift about that of the whole, and on the vertical one about its
    surroundings. Noise, told by what the cubes do not share, counts as no structure. Along layers of one dip the
    lateral shift is not observable: there the prior is what remains, and the standard deviation says so. The lateral
    shift of the whole is settled between levels: where it is wrong, vertical shifts look like the dip. Dead and missing
    traces of either cube have no weight; windows reach over them.

    Parameters
    ----------
    base, monitor : DataArray or array_like
        Cubes (inline, crossline, sample) on the same traces and samples. Their overall strengths may differ.
    settings : TimeLapseSettings, optional
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    CubeAlignment

    Raises
    ------
    ShapeError
        If they are not cubes of real numbers of one shape.
    GeometryError
        If their coordinates or places on the map differ, or no trace is live in both.
    ParameterError
        If the monitor's polarity is reversed, amplitudes are too large or too small for single precision, or `settings`
        are no TimeLapseSettings.

    Warns
    -----
    Seismo3dWarning
        If the monitor is no more like the base than another cube would be.

    References
    ----------
    .. [1] B. D. Lucas, T. Kanade, Proc. 7th IJCAI, 674-679, 1981.
    """
    settings = as_settings(settings, TimeLapseSettings)
    report = as_progress(progress)
    _check(base, monitor)
    report("register", 0.0)
    target, known_target = _prepare(base, "base")
    source, known_source = _prepare(monitor, "monitor")
    if not (known_target.any(axis=2) & known_source.any(axis=2)).any():
        raise GeometryError("base and monitor have no live trace in common; expected the same survey.")
    known = known_target & known_source
    correlation = _correlate_lags(target, source) / max(float(known.mean()), 1e-6)
    coarse = _register(target, source, settings)
    start = _choose_start(target, source, known_target, known_source, coarse, _best_lag(correlation))
    shift = _uniform(start, target.shape)
    whole = _likeness(target, source, known_target, known_source, shift)
    alike, opposed = float(correlation[1:-1].max()), -float(correlation[1:-1].min())
    if whole > opposed:  # farther off than the lags reach
        alike = max(alike, whole)
    _check_polarity(alike, opposed)
    shift, variance = _fit_windows((target, source), (known_target, known_source), start, settings, report)
    fitted = _likeness(target, source, known_target, known_source, shift)
    spread = np.sqrt(variance[2][known]) if known.any() else np.inf
    _warn_unlike((alike, opposed), (whole, fitted, float(np.median(spread))))
    return _pack(base, monitor, shift, variance, (coarse, start), (known_target, known_source))


def _check(base: Any, monitor: Any) -> None:
    check_order(base, "base")
    check_order(monitor, "monitor")
    for name, cube in (("base", base), ("monitor", monitor)):
        if np.ndim(cube) != 3:
            raise ShapeError(
                f"{name} has shape {np.shape(cube)}; expected a cube (inline, crossline, sample). Give cubes: "
                "lines are not aligned."
            )
    if np.shape(base) != np.shape(monitor):
        raise ShapeError(
            f"base has shape {np.shape(base)} and monitor {np.shape(monitor)}; expected two cubes of one shape. Cut or "
            "interpolate the monitor onto the base's traces and samples."
        )
    for name, cube in (("base", base), ("monitor", monitor)):
        kind = cube.dtype if hasattr(cube, "dtype") else np.asarray(cube).dtype
        if kind.kind not in "fiub":
            raise ShapeError(f"{name} has elements of type {kind}; expected real numbers. Convert it first.")
    if min(np.shape(base)) < 8:
        raise ShapeError(f"base has shape {np.shape(base)}; expected at least 8 traces each way and 8 samples.")
    axis = differing_axis(base, monitor)
    if axis is not None:
        raise GeometryError(
            f"base and monitor differ in their {axis} coordinates; expected the same lines and samples. Cut or "
            "interpolate the monitor onto the base's."
        )


def _prepare(cube: Any, name: str) -> tuple[Float32Array, BoolArray]:
    """Amplitudes of unit strength with 0 where there are none and spikes clipped, and where there are some."""
    values = as_strong(np.asarray(getattr(cube, "values", cube)), name)
    known, _ = mark_data(values)
    scale_amplitudes(values, known, find_scale(values[known]))
    balance_traces(values, known)
    strength = float(np.sqrt(np.mean(np.square(values[known], dtype=np.float64)))) if known.any() else 1.0
    return values / np.float32(strength or 1.0), known


def _register(target: Float32Array, source: Float32Array, settings: TimeLapseSettings) -> Registration:
    """Shift of the whole; large cubes are thinned along all axes alike, after smoothing."""
    step = max(1, int(np.ceil((target.size / settings.largest) ** (1.0 / 3.0))))
    if step == 1:
        return register(target, source, model="translation")
    thin = [ndimage.gaussian_filter(v, 0.5 * step)[::step, ::step, ::step].copy() for v in (target, source)]
    found = register(thin[0], thin[1], model="translation")
    moved = found.T_target_source.copy()
    moved[:3, 3] *= step
    return replace(found, T_target_source=freeze(moved))


def _choose_start(
    target: Float32Array, source: Float32Array, known_target: BoolArray, known_source: BoolArray, coarse: Registration,
    lag: float,
) -> Float64Array:  # fmt: skip
    """Shift of the whole: that of the registration where it fits clearly better than the best vertical one, `lag`."""
    vertical = np.array([0.0, 0.0, lag])
    if coarse.state not in ("converged", "ambiguous"):  # layers that repeat are ambiguous, and the misfit tells
        return vertical

    def misfit(shift: Float64Array) -> float:
        carried, weight = carry(source, known_source, _uniform(shift, target.shape))
        weight *= known_target
        seen = float(weight.sum())
        if seen <= _OVERLAP * known_target.sum():
            return np.inf
        return float((weight * (target - carried) ** 2).sum() / seen)

    found = -coarse.T_target_source[:3, 3]
    # along layers of one dip a lateral shift costs next to nothing: it must pay
    return found if misfit(found) < 0.8 * misfit(vertical) else vertical


def _correlate_lags(target: Float32Array, source: Float32Array) -> Float64Array:
    """Correlation of the traces of two cubes at vertical shifts from -(n // 4 + 1) to n // 4 + 1 of their n samples."""
    n = target.shape[2]
    length = fft.next_fast_len(2 * n)
    product = np.zeros(length)
    for a, b in zip(target, source, strict=True):
        product += fft.irfft(np.conj(fft.rfft(a, length, axis=1)) * fft.rfft(b, length, axis=1), length).sum(axis=0)
    reach = n // 4 + 1
    return np.asarray(product[np.arange(-reach, reach + 1)] / target.size, np.float64)


def _likeness(
    target: Float32Array, source: Float32Array, known_target: BoolArray, known_source: BoolArray, shift: Float32Array
) -> float:
    """Correlation of the base with the shifted monitor, where both have data."""
    carried, weight = carry(source, known_source, shift)
    weight *= known_target
    both, first, second = (
        float((weight * a * b).sum(dtype=np.float64))
        for a, b in ((target, carried), (target, target), (carried, carried))
    )
    return both / max(float(np.sqrt(first * second)), 1e-30)


def _check_polarity(alike: float, opposed: float) -> None:
    """Refuse a monitor that is much like its base with its sign changed, and less as it is."""
    if opposed > max(_OPPOSED * alike, _REVERSED):
        raise ParameterError(
            f"monitor is more like base with its sign changed (correlation {opposed:.2f}, {alike:.2f} as it is): its "
            "polarity is reversed. Give -monitor."
        )


def _warn_unlike(signs: tuple[float, float], fit: tuple[float, float, float]) -> None:
    """Warn where a monitor is hardly like its base: more so with its sign changed, or as another cube would be."""
    (alike, opposed), (whole, fitted, spread) = signs, fit
    if opposed > max(_OPPOSED * alike, _TOLD):
        problem = f"monitor is more like base with its sign changed, and not much: correlation {opposed:.2f}, "
        problem += f"{alike:.2f} as it is; expected {_REVERSED} either way"
    elif whole < _UNLIKE and (spread > _UNEVEN or fitted < _UNFIT):
        problem = f"monitor is no more like base than another cube is: correlation {whole:.2f} shifted as a whole, "
        problem += f"{fitted:.2f} fitted to {spread:.1f} samples; expected {_UNLIKE} or more as a whole"
    else:
        return
    warnings.warn(
        f"{problem}. Shifts and their standard deviations tell nothing if they are of other surveys, of reversed "
        "polarity, or farther apart than a quarter of a trace: check that.",
        Seismo3dWarning,
        stacklevel=3,
    )


def _best_lag(correlation: Float64Array) -> float:
    """Vertical shift, in samples, of the best correlation."""
    best = 1 + int(np.argmax(correlation[1:-1]))
    before, peak, after = correlation[best - 1 : best + 2]
    bend = before - 2.0 * peak + after  # the peak of the parabola through three samples lies between them
    offset = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return best - len(correlation) // 2 + float(np.clip(offset, -0.5, 0.5))


def _uniform(shift: Float64Array, shape: tuple[int, ...]) -> Float32Array:
    return np.broadcast_to(shift.astype(np.float32)[:, None, None, None], (len(shift), *shape))


def _fit_windows(
    cubes: tuple[Float32Array, Float32Array], known: tuple[BoolArray, BoolArray], start: Float64Array,
    settings: TimeLapseSettings, report: Progress,
) -> tuple[Float32Array, Float32Array]:  # fmt: skip
    """Shifts in all windows, coarse to fine, and their variances; between levels the shift of the whole is settled."""
    window = (settings.lateral, settings.lateral, settings.vertical)
    both = known[0] & known[1]
    whole, shift = start.copy(), _uniform(start, cubes[0].shape).copy()
    last, steps = len(settings.levels) - 1, len(settings.levels) * settings.passes
    for number, width in enumerate(settings.levels):
        smooth = _smooth_down(cubes[0], width), _smooth_down(cubes[1], width)
        off_ends = _off_the_ends(known[0], width), _off_the_ends(known[1], width)
        for k in range(settings.passes):
            report("local shifts", (number * settings.passes + k) / steps)
            fit = refine_shifts(smooth, off_ends, shift, whole, window=window, prior=settings.prior)
            shift = fit.shift
        lateral, covariance = settle_whole(shift[2], fit.dip, both, whole[:2])
        if number < last:
            move = (lateral - whole[:2]).astype(np.float32)
            shift[:2] += move[:, None, None, None]
            shift[2] -= np.tensordot(move, fit.dip, axes=1)
            whole[:2] = lateral
    report("local shifts", 1.0)
    variance = fit.variance + measure_unevenness(shift, window)
    follow, spread = fit.follow, covariance.astype(np.float32)
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
        variance += spread[a, b] * follow[:, a] * follow[:, b]
    return shift, variance


def _smooth_down(volume: Float32Array, width: float) -> Float32Array:
    return volume if width <= 0.0 else np.asarray(ndimage.gaussian_filter1d(volume, width, axis=2, mode="nearest"))


def _off_the_ends(known: BoolArray, width: float) -> BoolArray:
    """Return what is known so far off the ends of its traces, and gaps in them, that smoothing takes nothing beyond."""
    size = 2 * round(_ENDS * width) + 1
    return np.asarray(ndimage.minimum_filter1d(known, size, axis=2, mode="constant"))


def _pack(
    base: Any,
    monitor: Any,
    shift: Float32Array,
    variance: Float32Array,
    whole: tuple[Registration, Float64Array],
    known: tuple[BoolArray, BoolArray],
) -> CubeAlignment:
    """Put shifts into the base's units and coordinates."""
    interval = 1.0
    if hasattr(base, "dims") and base.dims[2] in base.coords:
        times = base[base.dims[2]].values
        interval = float(times[1] - times[0])
    values = np.asarray(getattr(monitor, "values", monitor), dtype=np.float32)
    aligned, weight = carry(np.where(np.isfinite(values), values, np.float32(0.0)), known[1], shift)
    aligned[weight == 0.0] = 0.0
    aligned[(weight == 0.0) & ~np.isfinite(values).any(axis=2, keepdims=True)] = np.nan
    lost = ~(known[0] | known[1]).any(axis=2)

    def like(array: AnyArray, name: str, scale: float = 1.0) -> Any:
        made = np.asarray(array * np.float32(scale), dtype=np.float32)
        made[lost] = np.nan
        return base.copy(data=freeze(made)).rename(name) if hasattr(base, "dims") else freeze(made)

    spread = np.sqrt(variance)
    return CubeAlignment(
        shift=like(shift[2], "shift", interval),
        shift_std=like(spread[2], "shift_std", interval),
        inline_shift=like(shift[0], "inline_shift"),
        crossline_shift=like(shift[1], "crossline_shift"),
        inline_std=like(spread[0], "inline_std"),
        crossline_std=like(spread[1], "crossline_std"),
        aligned=like(aligned, "aligned"),
        coarse=whole[0],
        start=(float(whole[1][0]), float(whole[1][1]), float(whole[1][2])),
    )
