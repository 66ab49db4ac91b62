"""Recipes of synthetic cubes: everything that a cube is made from, and the kinds of the benchmark suite."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeAlias

from seismo3d._settings import Amount, Many, Share, Side, Smoothing, check_fields
from seismo3d._validate import is_among, told
from seismo3d.errors import ParameterError
from seismo3d.synthetic.bodies import Channel
from seismo3d.synthetic.faulting import FaultPopulation, SyntheticFault

_Wavelength: TypeAlias = Annotated[float, "[4, 1000]"]
_Spacing: TypeAlias = Annotated[float, "[0.01, inf)"]
_Slope: TypeAlias = Annotated[float, "[-100, 100]"]


@dataclass(frozen=True, slots=True)
class CubeRecipe:
    """What a synthetic cube is made from; a pair is a range (lowest, highest) to draw from.

    Attributes
    ----------
    shape : tuple of int in [1, 100000] and, of samples, [8, 100000]
        (inline, crossline, sample) size.
    wavelength : tuple of float in [4, 1000], not falling
        Period at the peak of the Ricker wavelet's spectrum, in samples.
    layer_spacing : tuple of float in [0.01, inf), not falling
        Distance between layer boundaries, in layer time.
    fold_slope, tilt : tuple of float in [-100, 100]
        Steepest slope of the folds at the base of the cube, and slope of the regional tilt, in samples a trace.
    population : FaultPopulation or None
        Ranges of random faults; None for none.
    faults : tuple of SyntheticFault
        Faults given one by one; they come after the random ones in time. Buried ones need an unconformity.
    channels : tuple of Channel
        Channels given one by one.
    n_channels : int in [0, 10000]
        Number of random channels.
    unconformity : tuple of float or None in [0, 1]
        Range of the depth of an angular unconformity, as a share of the cube; None for none.
    old_slope, old_tilt : tuple of float in [-100, 100]
        Folding and tilt of the layers below the unconformity, before it.
    noise : float in [0, inf)
        Root mean square of the noise over that of the signal.
    noise_lateral : tuple of float in [0, 1000]
        Smoothing of the noise across traces, standard deviation in traces.
    lateral_resolution : float in [0, 1000]
        Smoothing of the signal across traces, as migration does, standard deviation in traces.
    smiles : int in [0, 10000]
        Number of migration smiles.
    smile_strength : float in (-inf, inf)
        Their peak amplitude over the signal's root mean square.
    agc_window : float or None in [2, inf)
        Length of an automatic gain control in samples; None for none.
    dead_traces : float in [0, 1)
        Share of traces that are dead (zero).
    top_mute : int in [0, inf)
        Number of samples at the top that are zero.
    missing_corner : float in [0, 1]
        Share of each horizontal side that a triangle of missing traces (NaN) takes off one corner.
    reverse_polarity : bool
        True to change the sign of all amplitudes.
    n_horizons : int in [0, 10000]
        Number of horizons in the truth.
    least_throw : float in [0, inf)
        Smallest absolute throw, in samples, at which a voxel on a fault's surface counts as a fault voxel.
    """

    shape: tuple[Side, Side, Annotated[int, "[8, 100000]"]] = (128, 128, 128)
    wavelength: Annotated[tuple[_Wavelength, _Wavelength], "not falling"] = (12.0, 30.0)
    layer_spacing: Annotated[tuple[_Spacing, _Spacing], "not falling"] = (0.8, 4.0)
    fold_slope: tuple[_Slope, _Slope] = (0.05, 0.25)
    tilt: tuple[_Slope, _Slope] = (0.0, 0.12)
    population: FaultPopulation | None = field(default_factory=FaultPopulation)
    faults: tuple[SyntheticFault, ...] = ()
    channels: tuple[Channel, ...] = ()
    n_channels: Many = 0
    unconformity: tuple[Share, Share] | None = None
    old_slope: tuple[_Slope, _Slope] = (0.1, 0.3)
    old_tilt: tuple[_Slope, _Slope] = (0.15, 0.3)
    noise: Amount = 0.0
    noise_lateral: tuple[Smoothing, Smoothing] = (0.0, 1.0)
    lateral_resolution: Smoothing = 0.0
    smiles: Many = 0
    smile_strength: Annotated[float, "(-inf, inf)"] = 1.5
    agc_window: Annotated[float, "[2, inf)"] | None = None
    dead_traces: Annotated[float, "[0, 1)"] = 0.0
    top_mute: Annotated[int, "[0, inf)"] = 0
    missing_corner: Share = 0.0
    reverse_polarity: bool = False
    n_horizons: Many = 5
    least_throw: Amount = 0.5

    def __post_init__(self) -> None:
        check_fields(self)
        _check_held(self.faults, "faults", SyntheticFault)
        _check_held(self.channels, "channels", Channel)
        buried = any(fault.buried for fault in self.faults) or (
            self.population is not None and self.population.buried > 0
        )
        if buried and self.unconformity is None:
            raise ParameterError(
                "some faults are buried but there is no unconformity. Give unconformity, e.g. (0.4, 0.5)."
            )
        if not 0 <= self.top_mute < self.shape[2]:
            raise ParameterError(f"top_mute is {self.top_mute}; expected 0 to {self.shape[2] - 1} samples.")


def _check_held(held: Any, name: str, kind: type) -> None:
    """Refuse by name what holds anything but faults, or channels."""
    if not isinstance(held, (tuple, list)) or not all(isinstance(one, kind) for one in held):
        raise ParameterError(f"{name} is {told(held)}; expected a tuple of {kind.__name__}.")


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
