"""Attribute cubes that interpreters expect: dip, azimuth, dip-steered semblance, curvature.

All follow from the slopes of the reflectors, found with the structure tensor. Dips in time cubes, on bare arrays and
where no bin size is known are in index coordinates (samples over bins); in depth cubes on a map they are true.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Progress
from seismo3d._validate import as_number
from seismo3d.errors import ShapeError
from seismo3d.geometry.bearings import wrap_deg
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry
from seismo3d.seismic._kernels_attributes import stack_along_dip
from seismo3d.seismic.dip import DipSettings, estimate_slopes
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.preparing import Scale, balance_traces, find_scale, sampling_step, scale_amplitudes

# orientation is averaged over less than for faults, so that small bends stay
_DIP = DipSettings(lateral=2.0, vertical=4.0, steepest=5.0, rim=1e-4)
_CURVATURE = (2.0, 2.0, 2.0)  # sigmas of the slopes' smoothing before they are differentiated once more
_HALF_WINDOW = 4  # samples of semblance above and below


def compute_attributes(
    cube: Any, *, smooth_tv: float | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Compute the attribute cubes of a seismic cube or section.

    Parameters
    ----------
    cube : DataArray or ndarray of 2 or 3 axes
        Amplitudes; a lazy cube is read into memory, and some ten float32 arrays of its size are needed.
    smooth_tv : float, optional
        Weight of a total-variation smoothing [3]_ of slopes and semblance (scikit-image's), in their own units: 0.05
        evens out jitter, 0.5 leaves blocks with sharp borders. None is without.
    progress : callable, optional
        Called with the stage and the share done.

    Returns
    -------
    dict of str to DataArray (ndarray where the input was one), float32
        - ``dip``: degrees from level, 0 to 90; in a section signed, positive where reflectors go down with the trace
          number.
        - ``azimuth``: direction in which reflectors go down, degrees 0 to 360 from north (from the inline axis towards
          the crossline axis without a map); NaN where level. Cubes only.
        - ``semblance``: likeness [2]_ of up to 3 x 3 traces along the dip, over 9 samples; 0 to 1.
        - ``curvature_most_positive``, ``curvature_most_negative``: largest and smallest curvature of the reflector
          [1]_, positive on anticlines; 1/m in depth cubes on a map, else samples a bin a bin. A section has
          ``curvature``.

        NaN on traces that are not live, and where amplitudes are not finite.

    Raises
    ------
    ShapeError
        If the cube has neither 2 nor 3 axes.
    ParameterError
        If ``smooth_tv`` is not positive.

    References
    ----------
    .. [1] A. Roberts, First Break 19(2), 85-100, 2001. :doi:`10.1046/j.0263-5046.2001.00142.x`
    .. [2] K. J. Marfurt et al., Geophysics 63(4), 1150-1165, 1998. :doi:`10.1190/1.1444415`
    .. [3] A. Chambolle, J. Math. Imaging Vision 20, 89-97, 2004. :doi:`10.1023/B:JMIV.0000011325.36760.1e`
    """
    weight = None if smooth_tv is None else as_number(smooth_tv, "smooth_tv", low=0.0, high=1e6, strict=True)
    if np.ndim(cube) not in (2, 3):
        raise ShapeError(f"cube has shape {np.shape(cube)}; expected (inline, crossline, sample) or (trace, sample).")
    report = as_progress(progress)
    volume, valid = _fill(cube)
    report("dips", 0.0)
    slopes = np.stack(estimate_slopes(volume, valid, settings=_DIP))
    report("dips", 1.0)
    if weight is not None:
        slopes = np.stack([_denoise(slope, weight) for slope in slopes])
    report("semblance", 0.0)
    volume[~valid] = np.nan
    semblance = _measure_semblance(volume, np.asarray(valid.any(axis=2)), slopes, report)
    if weight is not None:
        semblance = _denoise(semblance, weight)
    report("curvature", 0.0)
    found = _section_attributes(slopes[1], cube) if np.ndim(cube) == 2 else _cube_attributes(slopes, cube)
    found["semblance"] = semblance
    report("curvature", 1.0)
    return {name: _wrap(values, valid, cube, name) for name, values in found.items()}


def _fill(cube: Any) -> tuple[Float32Array, BoolArray]:
    """Amplitudes of three axes, and where there are any: finite samples of live traces.

    Other traces are filled from the nearest live one, other samples with the level of all. Spikes are clipped.
    """
    from scipy.ndimage import distance_transform_edt

    values = np.array(cube.data if hasattr(cube, "dims") else cube, dtype=np.float32)
    values = values.reshape((1,) * (3 - values.ndim) + values.shape)
    finite = np.isfinite(values)
    live = (finite & (values != 0)).any(axis=2)
    if hasattr(cube, "coords") and "live" in cube.coords:
        live &= np.asarray(cube["live"].values, dtype=bool).reshape(live.shape)
    valid = finite & live[:, :, None]
    if not live.any():
        return np.zeros_like(values), valid
    if not live.all():
        i, j = distance_transform_edt(~live, return_distances=False, return_indices=True)
        values = values[i, j]
    known = np.isfinite(values)
    scale_amplitudes(values, known, _find_scale(values[live]))
    values[~known] = 0.0
    balance_traces(values, known)
    return values, valid


def _find_scale(traces: Float32Array) -> Scale:
    """Return the scale of traces (n, sample); where nearly all amplitudes are the level, that of the others."""
    some = traces.ravel()[:: sampling_step(traces.shape)]
    scale = find_scale(some[np.isfinite(some)])
    if scale.strength > 0.0:
        return scale
    off = np.abs(traces[np.isfinite(traces)] - np.float32(scale.level))
    return Scale(scale.level, find_scale(off[off > 0.0]).strength)


def _measure_semblance(volume: Float32Array, live: BoolArray, slopes: Float32Array, report: Progress) -> Float32Array:
    from scipy.ndimage import uniform_filter1d

    out = np.empty_like(volume)
    stack, energy = np.empty(volume.shape[1:], dtype=np.float64), np.empty(volume.shape[1:], dtype=np.float64)
    window = 2 * _HALF_WINDOW + 1
    for i in range(volume.shape[0]):
        stack_along_dip(volume, live, slopes[0], slopes[1], i, stack, energy)
        above = uniform_filter1d(stack, window, axis=-1, mode="nearest")
        below = uniform_filter1d(energy, window, axis=-1, mode="nearest")
        with np.errstate(invalid="ignore", divide="ignore"):
            # without energy there is nothing that could differ
            out[i] = np.where(below > 1e-20, np.clip(above / below, 0.0, 1.0), 1.0)
        report("semblance", (i + 1) / volume.shape[0])
    return out


def _cube_attributes(slopes: Float32Array, cube: Any) -> dict[str, AnyArray]:
    survey = SurveyGeometry.from_cube(cube)
    *sides, step = IndexFrame.of_survey(survey).steps
    bins = np.array(sides)
    p, q = (slopes[axis] * np.float32(step / bins[axis]) for axis in range(2))
    steepness = np.degrees(np.arctan(np.hypot(p, q)))
    positive, negative = _principal_curvatures(slopes, bins, step)
    return {
        "dip": steepness,
        "azimuth": _azimuth(slopes, survey),
        "curvature_most_positive": positive,
        "curvature_most_negative": negative,
    }


def _azimuth(slopes: Float32Array, survey: SurveyGeometry) -> Float32Array:
    """Dip direction inline by inline; slopes are covectors, so the survey's rule for normals does it."""
    out: Float32Array = np.empty_like(slopes[0])
    for i in range(out.shape[0]):
        normals = np.stack([slopes[0, i].ravel(), slopes[1, i].ravel(), np.full(out[i].size, -1.0)], axis=1)
        out[i] = wrap_deg(survey.strike_deg(normals) + 90.0).reshape(out[i].shape)
    return out


def _principal_curvatures(slopes: Float32Array, bins: AnyArray, step: float) -> tuple[AnyArray, AnyArray]:
    """Most-positive and most-negative curvature from second derivatives taken along the reflector."""
    zxx, zxy, zyx, zyy = (
        _along_reflector(slopes, axis, of) * np.float32(step / (bins[axis] * bins[of]))
        for axis, of in ((0, 0), (1, 0), (0, 1), (1, 1))
    )
    a, b, c = zxx / 2, zyy / 2, (zxy + zyx) / 2
    spread = np.sqrt((a - b) ** 2 + c**2)
    return a + b + spread, a + b - spread


def _along_reflector(slopes: Float32Array, axis: int, of: int) -> Float32Array:
    """Differentiate one slope along a lateral axis, following the reflector: d/dx + p d/dz."""
    from scipy.ndimage import gaussian_filter

    lateral = gaussian_filter(slopes[of], _CURVATURE, order=[int(k == axis) for k in range(3)], mode="nearest")
    vertical = gaussian_filter(slopes[of], _CURVATURE, order=[0, 0, 1], mode="nearest")
    derivative: Float32Array = lateral + slopes[axis] * vertical
    return derivative


def _section_attributes(slope: Float32Array, section: Any) -> dict[str, AnyArray]:
    geometry = SectionGeometry.from_cube(section)
    spacing, step = 1.0, 1.0
    if geometry.xy is not None and geometry.depth_scale is not None and len(geometry.xy) > 1:
        spacing = float(np.hypot(*np.diff(geometry.xy, axis=0).T).mean())
        step = abs(geometry.depth_scale * geometry.sample.step)
    slopes = np.stack([np.zeros_like(slope), slope])
    curvature = _along_reflector(slopes, 1, 1) * np.float32(step / spacing**2)
    return {"dip": np.degrees(np.arctan(slope * np.float32(step / spacing))), "curvature": curvature}


def _denoise(values: Float32Array, weight: float) -> Float32Array:
    from skimage.restoration import denoise_tv_chambolle

    return np.asarray(denoise_tv_chambolle(values, weight=weight), dtype=np.float32)


_UNITS = {"dip": "degrees", "azimuth": "degrees", "semblance": "1"}


def _wrap(values: AnyArray, valid: BoolArray, cube: Any, name: str) -> Any:
    """Bring a result to the input's shape and kind, NaN where there are no amplitudes."""
    out = np.where(valid, values, np.float32("nan")).astype(np.float32).reshape(np.shape(cube))
    if not hasattr(cube, "dims"):
        return out
    return cube.copy(data=out).rename(name).assign_attrs(units=_UNITS.get(name, "curvature"))
