"""Recipes of synthetic cubes: everything that a cube is made from, and the kinds of the benchmark suite."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from seismo3d._validate import as_kind, as_number, as_numbers, as_whole_number, as_whole_numbers, is_among, told
from seismo3d.errors import ParameterError
from seismo3d.synthetic.bodies import Channel
from seismo3d.synthetic.faulting import FaultPopulation, SyntheticFault


@dataclass(frozen=True, slots=True)
class CubeRecipe:
    """What a synthetic cube is made from; a pair is a range (lowest, highest) to draw from.

    Attributes
    ----------
    shape : tuple of int
        (inline, crossline, sample) size.
    wavelength : tuple of float
        Period at the peak of the Ricker wavelet's spectrum, in samples.
    layer_spacing : tuple of float
        Distance between layer boundaries, in layer time.
    fold_slope, tilt : tuple of float
        Steepest slope of the folds at the base of the cube, and slope of the regional tilt, in samples a trace.
    population : FaultPopulation or None
        Ranges of random faults; None for none.
    faults : tuple of SyntheticFault
        Faults given one by one; they come after the random ones in time. Buried ones need an unconformity.
    channels : tuple of Channel
        Channels given one by one.
    n_channels : int
        Number of random channels.
    unconformity : tuple of float or None
        Range of the depth of an angular unconformity, as a share of the cube; None for none.
    old_slope, old_tilt : tuple of float
        Folding and tilt of the layers below the unconformity, before it.
    noise : float
        Root mean square of the noise over that of the signal.
    noise_lateral : tuple of float
        Smoothing of the noise across traces, standard deviation in traces.
    lateral_resolution : float
        Smoothing of the signal across traces, as migration does, standard deviation in traces.
    smiles : int
        Number of migration smiles.
    smile_strength : float
        Their peak amplitude over the signal's root mean square.
    agc_window : float or None
        Length of an automatic gain control in samples; None for none.
    dead_traces : float
        Share of traces that are dead (zero).
    top_mute : int
        Number of samples at the top that are zero.
    missing_corner : float
        Share of each horizontal side that a triangle of missing traces (NaN) takes off one corner.
    reverse_polarity : bool
        True to change the sign of all amplitudes.
    n_horizons : int
        Number of horizons in the truth.
    least_throw : float
        Smallest absolute throw, in samples, at which a voxel on a fault's surface counts as a fault voxel.
    """

    shape: tuple[int, int, int] = (128, 128, 128)
    wavelength: tuple[float, float] = (12.0, 30.0)
    layer_spacing: tuple[float, float] = (0.8, 4.0)
    fold_slope: tuple[float, float] = (0.05, 0.25)
    tilt: tuple[float, float] = (0.0, 0.12)
    population: FaultPopulation | None = field(default_factory=FaultPopulation)
    faults: tuple[SyntheticFault, ...] = ()
    channels: tuple[Channel, ...] = ()
    n_channels: int = 0
    unconformity: tuple[float, float] | None = None
    old_slope: tuple[float, float] = (0.1, 0.3)
    old_tilt: tuple[float, float] = (0.15, 0.3)
    noise: float = 0.0
    noise_lateral: tuple[float, float] = (0.0, 1.0)
    lateral_resolution: float = 0.0
    smiles: int = 0
    smile_strength: float = 1.5
    agc_window: float | None = None
    dead_traces: float = 0.0
    top_mute: int = 0
    missing_corner: float = 0.0
    reverse_polarity: bool = False
    n_horizons: int = 5
    least_throw: float = 0.5

    def __post_init__(self) -> None:
        _check_kinds(self)
        if min(self.shape) < 1 or self.shape[2] < 8:
            raise ParameterError(f"shape is {self.shape}; expected (inline, crossline, sample) with 8 samples or more.")
        if not 4.0 <= self.wavelength[0] <= self.wavelength[1]:
            raise ParameterError(f"wavelength is {self.wavelength}; expected a range of 4 samples or more.")
        if not 0.0 < self.layer_spacing[0] <= self.layer_spacing[1]:
            raise ParameterError(f"layer_spacing is {self.layer_spacing}; expected a range of positive numbers.")
        buried = any(fault.buried for fault in self.faults) or (
            self.population is not None and self.population.buried > 0
        )
        if buried and self.unconformity is None:
            raise ParameterError(
                "some faults are buried but there is no unconformity. Give unconformity, e.g. (0.4, 0.5)."
            )
        if self.noise < 0.0 or not 0.0 <= self.dead_traces < 1.0 or not 0.0 <= self.missing_corner <= 1.0:
            raise ParameterError(
                "noise, dead_traces and missing_corner are shares: expected 0 or more, the last two below 1."
            )
        if not 0 <= self.top_mute < self.shape[2]:
            raise ParameterError(f"top_mute is {self.top_mute}; expected 0 to {self.shape[2] - 1} samples.")


def _check_kinds(recipe: CubeRecipe) -> None:
    """Refuse by name what is no number where one is needed, no range of two, or no fault."""
    as_whole_numbers(recipe.shape, "shape", n=3)
    for name in _RANGES:
        if name != "unconformity" or recipe.unconformity is not None:
            as_numbers(getattr(recipe, name), name, n=2)
    for name in _NUMBERS:
        if name != "agc_window" or recipe.agc_window is not None:
            as_number(getattr(recipe, name), name)
    for name in _COUNTS:
        as_whole_number(getattr(recipe, name), name, low=0)
    if recipe.population is not None:
        as_kind(recipe.population, FaultPopulation, "population", remedy="Give FaultPopulation(...), or None.")
    for name, kind in (("faults", SyntheticFault), ("channels", Channel)):
        held = getattr(recipe, name)
        if not isinstance(held, (tuple, list)) or not all(isinstance(one, kind) for one in held):
            raise ParameterError(f"{name} is {told(held)}; expected a tuple of {kind.__name__}.")


_RANGES = (
    "wavelength", "layer_spacing", "fold_slope", "tilt", "unconformity", "old_slope", "old_tilt", "noise_lateral",
)  # fmt: skip
_NUMBERS = (
    "noise", "lateral_resolution", "smile_strength", "agc_window", "dead_traces", "missing_corner", "least_throw",
)  # fmt: skip
_COUNTS = ("n_channels", "smiles", "top_mute", "n_horizons")

_EIGHT = FaultPopulation(
    count=(8, 8), families=2, strike_spread=20.0, conjugate=0.5, spacing=0.1, throw=(5.0, 25.0), reverse=0.1
)
KINDS: dict[str, CubeRecipe] = {
    "clean": CubeRecipe(),
    "folded": CubeRecipe(fold_slope=(0.5, 0.9), tilt=(0.05, 0.25)),
    "noise": CubeRecipe(noise=0.8),
    "small_throws": CubeRecipe(
        population=FaultPopulation(
            throw=(2.8, 5.3), profiles=(1.0, 0.0, 0.0), trend=(0.1, 0.15), reverse=0.25, oblique=0.0
        )
    ),
    "crossing": CubeRecipe(population=_EIGHT),
    "low_dips": CubeRecipe(
        population=FaultPopulation(count=(4, 6), dip_deg=(35.0, 60.0), listric=0.15, reverse=0.3, throw=(5.0, 30.0))
    ),
    "fault_free": CubeRecipe(population=None, fold_slope=(0.2, 0.8), noise=0.4),
    "channels": CubeRecipe(population=None, n_channels=5, unconformity=(0.35, 0.6), fold_slope=(0.05, 0.3)),
    "demo": CubeRecipe(
        shape=(128, 160, 192),
        wavelength=(15.0, 15.0),
        fold_slope=(0.2, 0.26),
        tilt=(0.05, 0.1),
        population=None,
        faults=(
            SyntheticFault((70, 40, 130), 80.0, 58.0, 16.0, "elliptic", (90, 90), drag=60, share=0.6, buried=True),
            SyntheticFault((60, 120, 125), 255.0, 62.0, 12.0, "elliptic", (70, 80), drag=60, share=0.5, buried=True),
            SyntheticFault(
                (50, 62, 70), 12.0, 62.0, 22.0, trend=(0.004, 0.0), listric=(34.0, 110.0), bend=(0.003, 0.0)
            ),
            SyntheticFault(
                (64, 112, 90), 194.0, 66.0, 14.0, "elliptic", (95, 130), bend=(-0.003, 0.001), drag=90, share=0.7
            ),
            SyntheticFault((84, 136, 80), 160.0, 70.0, 8.0, "gaussian", (55, 60), ripple=(1.5, 70.0, 0.4), share=0.5),
            SyntheticFault((40, 20, 120), 205.0, 48.0, -9.0, "elliptic", (70, 90), drag=60, share=0.8),
        ),
        n_channels=2,
        unconformity=(0.55, 0.56),
        old_slope=(0.12, 0.2),
        old_tilt=(0.28, 0.32),
        noise=0.22,
        lateral_resolution=0.7,
        smiles=5,
        smile_strength=0.8,
        dead_traces=0.002,
        n_horizons=6,
    ),
}


def recipe_of(kind: str, **overrides: object) -> CubeRecipe:
    """Return the recipe of a kind, with some settings replaced.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    **overrides
        Fields of :class:`CubeRecipe`.

    Raises
    ------
    ParameterError
        If the kind or a field is not known.
    """
    if not is_among(kind, KINDS):
        raise ParameterError(f"kind is {told(kind)}; expected one of {', '.join(KINDS)}.")
    unknown = sorted(set(overrides) - set(CubeRecipe.__dataclass_fields__))
    if unknown:
        raise ParameterError(
            f"recipe has no field {unknown[0]!r}; it has {', '.join(CubeRecipe.__dataclass_fields__)}."
        )
    return replace(KINDS[kind], **overrides)  # type: ignore[arg-type]
