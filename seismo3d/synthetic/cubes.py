"""Synthetic seismic cubes with exact truth: folded, faulted layers under a Ricker wavelet.

Time runs as in the Earth: layers are laid down, folded, faulted by one fault after the other (later faults cut and
shift the earlier ones, and the earlier faults' truth with them), and only then seen through the wavelet, which is
therefore never distorted. Every voxel is mapped back through that history in closed form, so that nothing is
interpolated.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Int32Array, Progress
from seismo3d._validate import as_whole_number, freeze
from seismo3d.errors import ParameterError
from seismo3d.synthetic import noise as noises
from seismo3d.synthetic.bodies import Channel
from seismo3d.synthetic.earth import draw_earth, fill_cube
from seismo3d.synthetic.faulting import SyntheticFault, sample_faults
from seismo3d.synthetic.recipes import CubeRecipe, recipe_of


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticCube:
    """A cube (or section) and its truth. A section's arrays lack the inline axis.

    Attributes
    ----------
    seismic : ndarray of shape (n_inline, n_crossline, n_sample), float32
        Amplitudes; the noise-free signal has unit root mean square. Dead traces are zero, missing ones NaN.
    signal : ndarray of the same shape, float32
        The same before noise, smiles, gain, polarity and lost traces.
    faults : ndarray of the same shape, int32
        0, or the number of the fault (1 is the oldest) whose surface passes through the voxel: its distance from the
        voxel's centre, along the grid axis nearest to the surface's normal, is in [-0.5, 0.5) voxels. So a fault is
        one voxel thick along that axis. Only where its absolute throw is ``recipe.least_throw`` or more. The younger
        of two faults wins.
    throw : ndarray of the same shape, float32
        Vertical displacement in samples at fault voxels, positive where the hanging wall is down; NaN elsewhere.
    slip : ndarray of shape (m, 3), float32
        Motion (inline, crossline, sample) of the hanging wall relative to the footwall at the m fault voxels, in C
        order.
    layer_time : ndarray of the same shape as ``seismic``, float32
        Relative geologic time of each voxel, in samples. It increases down each trace within a fault block. Across a
        fault it jumps: by more than nothing at a normal one; backwards at a reverse one, which lays older layers on
        younger ones, and in places where a fault cuts an earlier one and lays its footwall on its hanging wall.
    horizon_times : ndarray of shape (k,), float32
        Layer times of the horizons.
    horizons : ndarray of shape (k, n_inline, n_crossline), float32
        Their depth in fractional samples; NaN where the layer is absent (outside the cube, faulted out, eroded).
        Where a reverse fault repeats it: the upper one.
    live : ndarray of shape (n_inline, n_crossline), bool
        False at dead and missing traces.
    fault_list : tuple of SyntheticFault
        Fault number n is entry n - 1: oldest first, those older than the unconformity before all others.
    channels : tuple of Channel
        The channels.
    wavelength : float
        Peak period of the wavelet in samples.
    recipe : CubeRecipe
        What it was made from.
    seed : int
        Seed of all that is random.
    """

    seismic: Float32Array
    signal: Float32Array
    faults: Int32Array
    throw: Float32Array
    slip: Float32Array
    layer_time: Float32Array
    horizon_times: Float32Array
    horizons: Float32Array
    live: BoolArray
    fault_list: tuple[SyntheticFault, ...]
    channels: tuple[Channel, ...]
    wavelength: float
    recipe: CubeRecipe
    seed: int

    def to_dataarray(
        self,
        *,
        first: tuple[int, int] = (1001, 2001),
        start_ms: float = 600.0,
        interval_ms: float = 4.0,
        origin_m: tuple[float, float] = (604_000.0, 6_080_000.0),
        bin_m: tuple[float, float] = (25.0, 12.5),
        azimuth_deg: float = 32.0,
    ) -> Any:
        """Return the amplitudes as a cube with coordinates, on a rotated survey.

        Parameters
        ----------
        first : tuple of int
            First inline and crossline number.
        start_ms, interval_ms : float
            Time of the first sample, and sample interval, in ms.
        origin_m : tuple of float
            Map position (x, y) of the first trace.
        bin_m : tuple of float
            Distance between inlines and between crosslines.
        azimuth_deg : float
            Direction of growing inline numbers, clockwise from north; crosslines grow 90 degrees clockwise from it.

        Returns
        -------
        xarray.DataArray
            Dimensions inline, crossline, time; coordinates ``cdp_x``, ``cdp_y`` and ``live`` a trace. Of a section:
            trace, time, and the same coordinates.
        """
        import xarray as xr

        shape = self.recipe.shape
        cube = self.seismic.ndim == 3
        i, x = np.meshgrid(np.arange(shape[0]) if cube else [shape[0] // 2], np.arange(shape[1]), indexing="ij")
        angle = np.deg2rad(azimuth_deg)
        east = origin_m[0] + i * bin_m[0] * np.sin(angle) + x * bin_m[1] * np.cos(angle)
        north = origin_m[1] + i * bin_m[0] * np.cos(angle) - x * bin_m[1] * np.sin(angle)
        dims = ("inline", "crossline") if cube else ("trace",)
        numbers = {"inline": first[0] + np.arange(shape[0]), "crossline": first[1] + np.arange(shape[1])}
        coords: dict[str, Any] = dict(numbers) if cube else {"trace": numbers["crossline"]}
        coords["time"] = start_ms + interval_ms * np.arange(shape[2])
        live = self.live.reshape(i.shape)
        for name, values in (("cdp_x", east), ("cdp_y", north), ("live", live)):
            coords[name] = (dims, values if cube else values[0])
        array = xr.DataArray(self.seismic.copy(), dims=(*dims, "time"), coords=coords, name="seismic")
        array["time"].attrs["units"] = "ms"
        return array


def fault_cube(
    kind: str = "clean", *, seed: int = 0, progress: Progress | None = None, **overrides: object
) -> SyntheticCube:
    """Make a cube of one of the kinds of the benchmark suite.

    Parameters
    ----------
    kind : str
        "clean", "folded", "noise", "small_throws", "crossing", "low_dips", "fault_free", "channels" or "demo".
    seed : int
        Seed of all that is random: same seed, same cube.
    progress : callable, optional
        Called with the stage's name and the share done.
    **overrides
        Fields of :class:`CubeRecipe` to replace, such as ``shape=(64, 64, 64)``.

    Returns
    -------
    SyntheticCube
        Amplitudes and truth.

    Raises
    ------
    ParameterError
        If the kind or a field is not known or a value is not possible.

    Examples
    --------
    >>> cube = fault_cube("clean", shape=(16, 16, 32), seed=3)
    >>> cube.seismic.shape, bool((cube.faults > 0).any())
    ((16, 16, 32), True)
    """
    recipe = recipe_of(kind, **overrides)
    return _make(recipe, seed, range(recipe.shape[0]), progress, stream=_stream(kind))


def fault_section(kind: str = "clean", *, seed: int = 0, **overrides: object) -> SyntheticCube:
    """Make the middle inline of a cube of one of the kinds, without making the cube.

    Takes what :func:`fault_cube` takes. Truth is the cube's own: fault voxels are those that the fault surface passes
    through in three dimensions.

    Returns
    -------
    SyntheticCube
        With arrays of shape (n_crossline, n_sample): trace, sample. ``horizons`` has shape (k, n_crossline).
    """
    recipe = recipe_of(kind, **overrides)
    middle = recipe.shape[0] // 2
    made = _make(recipe, seed, range(middle, middle + 1), None, stream=_stream(kind))
    flat: dict[str, Any] = {
        name: freeze(getattr(made, name)[0].copy())
        for name in ("seismic", "signal", "faults", "throw", "layer_time", "live")
    }
    return replace(made, **flat, horizons=freeze(made.horizons[:, 0].copy()))


def make_cube(recipe: CubeRecipe, *, seed: int = 0, progress: Progress | None = None) -> SyntheticCube:
    """Make a cube from a recipe.

    Parameters
    ----------
    recipe : CubeRecipe
        What to make it from.
    seed : int
        Seed of all that is random.
    progress : callable, optional
        Called with the stage's name and the share done.

    Returns
    -------
    SyntheticCube
        Amplitudes and truth.
    """
    if not isinstance(recipe, CubeRecipe):
        raise ParameterError(
            f"recipe is of type {type(recipe).__name__}; expected a CubeRecipe. See fault_cube for kinds."
        )
    return _make(recipe, seed, range(recipe.shape[0]), progress)


def _stream(kind: str) -> int:
    """Return the number of a kind's own random stream, so that two kinds of one seed share nothing."""
    return zlib.crc32(kind.encode())


def _make(
    recipe: CubeRecipe, seed: int, inlines: range, progress: Progress | None, *, stream: int = 0
) -> SyntheticCube:
    number = as_whole_number(seed, "seed", low=0)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence((number, stream)).spawn(4)]
    wavelength = float(streams[0].uniform(*recipe.wavelength))
    drawn = sample_faults(streams[1], recipe.shape, recipe.population) if recipe.population is not None else ()
    faults = tuple(sorted(drawn + recipe.faults, key=lambda fault: not fault.buried))
    earth = draw_earth(recipe, faults, streams[2])
    truth = fill_cube(recipe, earth, wavelength, inlines, progress)
    signal = truth.signal
    if recipe.lateral_resolution > 0.0:
        signal = _smooth_laterally(signal, recipe.lateral_resolution)
    signal /= max(noises.root_mean_square(signal), 1e-12)
    seismic, live = _record(recipe, signal, wavelength, streams[3], inlines)
    return SyntheticCube(
        seismic=freeze(seismic),
        signal=freeze(signal),
        faults=freeze(truth.labels),
        throw=freeze(truth.throw),
        slip=freeze(truth.slip),
        layer_time=freeze(truth.layer_time),
        horizon_times=freeze(earth.horizon_times.astype(np.float32)),
        horizons=freeze(truth.horizons),
        live=freeze(live),
        fault_list=faults,
        channels=earth.channels,
        wavelength=wavelength,
        recipe=recipe,
        seed=number,
    )


def _smooth_laterally(signal: Float32Array, sigma: float) -> Float32Array:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(signal, (sigma if signal.shape[0] > 1 else 0.0, sigma, 0.0), mode="nearest"))


def _record(
    recipe: CubeRecipe, signal: Float32Array, wavelength: float, rng: np.random.Generator, inlines: range
) -> tuple[Float32Array, BoolArray]:
    """Add what recording and processing add, and lose what they lose."""
    seismic = signal.copy()
    frequency = 1.0 / wavelength
    if recipe.smiles:
        bowls = noises.migration_smiles(rng, recipe.shape, frequency, count=recipe.smiles)
        seismic += recipe.smile_strength * bowls[inlines.start : inlines.stop]
    if recipe.noise > 0.0:
        seismic += recipe.noise * noises.coloured_noise(
            rng, signal.shape, frequency, lateral=rng.uniform(*recipe.noise_lateral)
        )
    if recipe.agc_window is not None:
        seismic = noises.apply_agc(seismic, window=recipe.agc_window)
    if recipe.reverse_polarity:
        seismic = -seismic
    seismic[..., : recipe.top_mute] = 0.0
    dead = rng.random(recipe.shape[:2])[inlines.start : inlines.stop] < recipe.dead_traces
    seismic[dead] = 0.0
    i, x = np.meshgrid(np.array(inlines), np.arange(recipe.shape[1]), indexing="ij")
    missing = i / recipe.shape[0] + x / recipe.shape[1] < recipe.missing_corner
    seismic[missing] = np.nan
    return seismic, ~(dead | missing)
