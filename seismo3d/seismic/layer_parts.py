"""The parts of a layer that faults bound, told apart and placed by their waveforms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from seismo3d._settings import Amount, Correlation, Steps
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_tracks import match_waveforms, sum_parts
from seismo3d.seismic.layer_pieces import LayerVolumes, Waves, neighbours, read_along, read_around

# thicknesses that are tried to either side of the usual one
_STRETCHES = 10
# a step between traces, in samples, that is none of one part
_STEP = 6.0
# half-length of the waveforms by which neighbours are compared, and share of their usual correlation that is too little
_ALIKE_HALF, _ALIKE = 10, 0.65
# share of a window that must be known for it to be compared
_LEAST_KNOWN = 0.3
# share of either side of it that must be known for thicknesses to be compared
_BOTH_SIDES = 0.5
# how far a part is moved for whatever it gains
_NEARBY = 3
# traces that a part must have
_LEAST_TRACES = 4
# share of its largest amplitude below which a wavelet's spectrum is no more restored
_FAINT = 0.05
# links side by side that a part must be wide, or it hangs together by a neck; and traces that what it joins must have
_NECK, _LEAST_CORE = 5, 50


@dataclass(frozen=True, slots=True)
class PartSettings:
    """How the parts of a layer are placed; lengths in samples and traces.

    Attributes
    ----------
    window : int in [1, 100]
        Half-length of the waveform by which parts are recognised across faults.
    farthest : int in [1, 100]
        Farthest that a part is moved to where its waveform fits.
    stretch : float in [0, 1)
        Largest share by which layers may be thicker or thinner than elsewhere.
    price : float in [0, inf)
        Correlation that it must be worth.
    gain : float in [0, inf)
        How much better the correlation of a part must become for it to be moved.
    wary : float in [0, inf)
        The gain is divided by this power of the share of its waveform that is known: what is cut short fits anywhere.
    surely : float in [-1, 1]
        Correlation that a part must reach to be moved by a cycle: among as many places one or the other fits by chance.
    trusted : float in [-1, 1]
        Correlation of parts whose waveforms others are compared with.
    least : float in [-1, 1]
        Correlation below which a part is left out.
    """

    window: Steps = 32
    farthest: Steps = 12
    stretch: Annotated[float, "[0, 1)"] = 0.2
    price: Amount = 0.1
    gain: Amount = 0.15
    wary: Amount = 0.0
    surely: Correlation = 0.0
    trusted: Correlation = 0.75
    least: Correlation = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class PartWaves:
    """Waveforms of the parts of a layer, read along the layer time, and once more sample by sample.

    The first holds where layers thicken within a part, the second where the layer time is off on its side of a fault.

    Attributes
    ----------
    sums, counts : ndarray of shape (2, part, sample), float64
        Amplitudes of all traces of a part added up, and how many are known; the middle sample is at the layer.
    size : ndarray of shape (part,), int
        Crossings of each part.
    spectrum : ndarray of shape (n,), float64, or None
        As in :func:`stretched`.
    """

    sums: Float64Array
    counts: Float64Array
    size: IntArray
    spectrum: Float64Array | None = None

    def known(self, half: int) -> Float64Array:
        """Return which share of the waveform, up to so many samples from the layer, is known of each part."""
        middle = self.counts.shape[2] // 2
        inner = self.counts[:, :, middle - half : middle + half + 1]
        return np.asarray(inner.max(axis=0).mean(axis=1) / np.maximum(self.size, 1))


def find_shapes(layers: LayerVolumes, crossings: Float64Array) -> Float32Array:
    """Return the waveform about every crossing, of unit length; zero where less than half of it is known."""
    shapes = np.zeros((*crossings.shape, 2 * _ALIKE_HALF + 1), np.float32)
    for depth, shape in zip(crossings, shapes, strict=True):
        if not np.isfinite(depth).any():
            continue
        waves, known = read_around(layers, depth, _ALIKE_HALF)
        waves *= known.mean(axis=2, keepdims=True) > 0.5
        shape[:] = waves / np.maximum(np.linalg.norm(waves, axis=2, keepdims=True), 1e-6)
    return shapes


def label_parts(crossings: Float64Array, cuts: AnyArray, shapes: Float32Array | None = None) -> IntArray:
    """Give numbers to the parts of a layer that faults bound, from 0; -1 where there is no crossing.

    A fault may end too early, or be missed. Layer time then leads from one side to the other over a few traces, where
    waveforms of neighbours along it are far less alike than they are elsewhere: parts end there too. So they do where
    nothing but a few traces side by side joins two large ones.

    Parameters
    ----------
    crossings : ndarray of shape (n, inline, crossline), float64
        Fractional samples, NaN where there is none.
    cuts : ndarray of shape (inline, crossline, sample), uint8
        Bits 0 and 1: a fault passes before the next inline or crossline.
    shapes : ndarray of shape (n, inline, crossline, m), float32, optional
        Waveform about every crossing, of unit length; zero where it is not known. Without them faults alone are bounds.
    """
    known = np.isfinite(crossings)
    numbers = np.arange(crossings.size).reshape(crossings.shape)
    k: AnyArray = np.clip(np.rint(np.nan_to_num(crossings)).astype(np.int64), 0, cuts.shape[2] - 1)
    i, j = np.meshgrid(*(np.arange(n) for n in crossings.shape[1:]), indexing="ij")
    first, second, wide = [], [], []
    for axis in range(2):
        a, b = neighbours(axis)
        for one, other in np.ndindex(len(crossings), len(crossings)):
            both = known[one][a] & known[other][b]
            if not both.any():
                continue
            rows, columns, ka, kb = (values[both] for values in (i[a], j[a], k[one][a], k[other][b]))
            cut = are_cut(cuts, rows, columns, ka, kb, axis)
            step = np.abs(crossings[one][a][both] - crossings[other][b][both])
            free = np.zeros(both.shape, bool)
            free[both] = (step < _STEP) & ~cut
            broad = ndimage.binary_opening(free, np.ones((1, _NECK) if axis == 0 else (_NECK, 1), bool))
            if shapes is not None:
                free[free] = _are_alike(shapes[one][a][free], shapes[other][b][free])
            first.append(numbers[one][a][free])
            second.append(numbers[other][b][free])
            wide.append(broad[free])
    parts = np.full(crossings.shape, -1, np.int64)
    if not first:
        return parts
    ends, is_wide = np.stack([np.concatenate(first), np.concatenate(second)]), np.concatenate(wide)
    graphs = graph_of(ends, crossings.size), graph_of(ends[:, is_wide], crossings.size)
    labels = _part_at_necks(*graphs).reshape(crossings.shape)
    # what is no crossing is labelled too, each by itself: far more labels than parts
    parts[known] = np.unique(labels[known], return_inverse=True)[1]
    return parts


def are_cut(
    cuts: AnyArray, rows: AnyArray, columns: AnyArray, here: AnyArray, there: AnyArray, axis: int
) -> BoolArray:  # fmt: skip
    """Tell where a fault passes between a layer's sample on a trace and that on the next along an axis."""
    cut = np.zeros(np.shape(here), np.bool_)
    for sample in (here, (here + there) // 2, there):
        cut |= (cuts[rows, columns, sample] & (1 << axis)) > 0
    return cut


def graph_of(ends: IntArray, size: int) -> Any:
    """Return the graph of links between some of as many places, of which `ends` are the numbers."""
    return coo_matrix((np.ones(ends.shape[1], np.float32), tuple(ends)), shape=(size, size)).tocsr()


def _part_at_necks(links: Any, wide: Any) -> IntArray:
    """Label what is linked; where necks alone join large pieces, each place as the nearest of these."""
    whole = connected_components(links, directed=False)[1].astype(np.int64)
    cores = connected_components(wide, directed=False)[1]
    large = np.bincount(cores) >= _LEAST_CORE
    members = np.flatnonzero(large[cores])
    # only wholes that hold several cores are parted
    pairs = np.unique(np.column_stack([whole[members], cores[members]]), axis=0)
    several = np.bincount(pairs[:, 0], minlength=int(whole.max()) + 1) > 1
    members = members[several[whole[members]]]
    if not len(members):
        return whole
    _, _, sources = dijkstra(
        links, directed=False, indices=members, unweighted=True, min_only=True, return_predecessors=True
    )
    reached = sources >= 0
    labels = whole.copy()
    labels[reached] = whole.max() + 1 + cores[sources[reached]]
    return labels


def _are_alike(one: Float32Array, other: Float32Array) -> BoolArray:
    """Tell which waveforms of shape (n, m) are as alike as most are, or one of two is not known."""
    alike = np.einsum("ij,ij->i", one, other)
    told = one.any(axis=1) & other.any(axis=1)
    usual = float(np.median(alike[told])) if told.any() else 0.0
    return np.asarray(~told | (alike >= _ALIKE * usual))


def read_parts(layers: LayerVolumes, crossings: Float64Array, parts: IntArray, settings: PartSettings) -> PartWaves:
    """Read the waveforms of parts, as far as they are compared. Samples beyond a fault count for nothing."""
    reach, n = settings.window + 2 * settings.farthest, int(parts.max(initial=-1)) + 1
    sums, counts = np.zeros((2, n, 2 * reach + 1)), np.zeros((2, n, 2 * reach + 1))
    for depth, part in zip(crossings, parts, strict=True):
        inside = np.flatnonzero(part.ravel() >= 0)
        if not len(inside):
            continue
        order = inside[np.argsort(part.ravel()[inside], kind="stable")]
        labels, begin = np.unique(part.ravel()[order], return_index=True)
        begin = np.append(begin, len(order))
        readings: tuple[Callable[..., Waves], ...] = (read_along, read_around)
        for number, read in enumerate(readings):
            waves, known = (a.reshape(part.size, -1) for a in read(layers, depth, reach))
            sum_parts(waves, known, order, begin, labels, sums[number], counts[number])
    return PartWaves(sums, counts, np.bincount(parts[parts >= 0], minlength=n), layers.spectrum)


def _match_parts(waves: PartWaves, moves: Float64Array, scores: Float32Array, settings: PartSettings) -> Float32Array:
    """Correlation of every part's mean waveform with that of the trusted parts, at every lag about its move.

    Each part goes by the reading that fits better; -1 where too little is known.
    """
    along, deep = (
        _match_reading(sums, counts, moves, scores, waves.spectrum, settings)
        for sums, counts in zip(waves.sums, waves.counts, strict=True)
    )
    return np.where((deep.max(axis=1) > along.max(axis=1))[:, None], deep, along)


def _match_reading(
    sums: Float64Array, counts: Float64Array, moves: Float64Array, scores: Float32Array,
    spectrum: Float64Array | None, settings: PartSettings,
) -> Float32Array:  # fmt: skip
    means = sums / np.maximum(counts, 1e-6)
    inner = slice(settings.farthest, sums.shape[1] - settings.farthest)
    if moves.any():
        rows, samples = np.indices(sums.shape, dtype=np.float64)[:, :, inner]
        at = rows, samples + moves[:, None]
        means = ndimage.map_coordinates(means, at, order=3, mode="nearest")
        counts = ndimage.map_coordinates(counts, at, order=1, mode="nearest")
    else:
        means, counts = means[:, inner], counts[:, inner]
    share = (counts / np.maximum(counts.max(axis=1, keepdims=True, initial=0.0), 1.0)).astype(np.float32)
    trust = np.where(scores >= settings.trusted, scores, 0.0)[:, None]
    total = (trust * counts).sum(axis=0)
    reference = ((trust * counts * means).sum(axis=0) / np.maximum(total, 1e-6)).astype(np.float32)
    in_reference = (total / max(float(total.max(initial=0.0)), 1e-6)).astype(np.float32)
    return _match_stretched(means.astype(np.float32), share, reference, in_reference, spectrum, settings)


def _match_stretched(
    means: Float32Array, share: Float32Array, reference: Float32Array, known: Float32Array,
    spectrum: Float64Array | None, settings: PartSettings,
) -> Float32Array:  # fmt: skip
    """Correlation of every part's mean waveform with a reference, as thick as fits best, at every lag."""
    far, half = settings.farthest, settings.window
    taper = np.hanning(2 * half + 3)[1:-1].astype(np.float32)
    shares = np.linspace(-settings.stretch, settings.stretch, 2 * _STRETCHES + 1)
    waves, seen = stretched(reference, half, shares, spectrum), np.clip(stretched(known, half, shares), 0.0, 1.0)
    scores = np.empty((len(shares), len(means), 2 * far + 1), np.float32)
    match_waveforms(means, share, waves, seen, taper, np.float32(_LEAST_KNOWN), scores)
    # where a fault or an end of the cube takes one side, layers may as well be thicker as lie elsewhere
    seen_of = (share[:, far:-far] * known[far:-far])[:, 1:].reshape(len(means), 2, half).mean(axis=2).min(axis=1)
    price = np.where(seen_of > _BOTH_SIDES, settings.price, 100.0) * np.abs(shares)[:, None]
    best = (scores.max(axis=2) - price).argmax(axis=0)
    return scores[best, np.arange(len(means))]


def stretched(
    waveform: Float32Array, half: int, shares: Float64Array, spectrum: Float64Array | None = None
) -> Float32Array:
    r"""Return the middle of a waveform where layers are thicker by shares.

    Thicker layers are seen through the same wavelet: stretched with them by :math:`1 + s`, its amplitude spectrum
    :math:`A(f)` has become :math:`A_s(f) = A((1 + s) f)`, and is made :math:`A` again by
    :math:`A A_s / (A_s^2 + \epsilon^2 \max A^2)`. Without that thin layers, whose reflections the wavelet mixes, are
    matched up to a sample off.

    Parameters
    ----------
    waveform : ndarray of shape (m,), float32
        Its middle sample is where the stretch is centred.
    half : int
        Half-length of what is returned.
    shares : ndarray of shape (k,), float64
    spectrum : ndarray of shape (n,), float64, optional
        :math:`A` at frequencies evenly spread from 0 to half a cycle a sample. By default there is no wavelet.

    Returns
    -------
    ndarray of shape (k, 2 half + 1), float32
    """
    middle = len(waveform) // 2
    beyond = half if spectrum is None else max(half, int(np.ceil(middle * (1.0 + shares.max()))))
    at = middle + np.arange(-beyond, beyond + 1) / (1.0 + shares[:, None])
    found = ndimage.map_coordinates(waveform.astype(np.float64), at[None], order=3)
    if spectrum is not None:
        n = 2 * found.shape[1]
        frequency, known = np.arange(n // 2 + 1) / n, np.linspace(0.0, 0.5, len(spectrum))
        usual = np.interp(frequency, known, spectrum)
        now = np.interp(frequency * (1.0 + shares[:, None]), known, spectrum, right=0.0)
        response = usual * now / np.maximum(now**2 + (_FAINT * usual.max()) ** 2, 1e-30)
        found = np.fft.irfft(np.fft.rfft(found, n) * response, n)[:, beyond - half : beyond + half + 1]
    return np.asarray(found, np.float32)


def place_once(
    waves: PartWaves, moves: Float64Array, scores: Float32Array, fixed: IntArray, settings: PartSettings
) -> tuple[Float64Array, Float32Array]:
    """Move every part to where its mean waveform fits that of the trusted parts.

    Parameters
    ----------
    waves : PartWaves
    moves : ndarray of shape (part,), float64
        How far each part is moved already; NaN counts as nothing, and more than `farthest` as that.
    scores : ndarray of shape (part,), float32
        How far each is trusted, 0 to 1.
    fixed : ndarray of int
        Parts that stay; what their waveforms seem to be off by is taken from all.
    settings : PartSettings

    Returns
    -------
    moves : ndarray of shape (part,), float64
        How far in all; NaN where a part fits nowhere.
    scores : ndarray of the same shape, float32
        Correlation there, 0 to 1.
    """
    moves = np.clip(np.nan_to_num(moves), -settings.farthest, settings.farthest)
    lags = _match_parts(waves, moves, scores, settings)
    far, every, size = settings.farthest, np.arange(len(lags)), waves.size
    near = slice(far - _NEARBY, far + _NEARBY + 1)
    best, close = lags.argmax(axis=1), lags[:, near].argmax(axis=1) + near.start
    gain = settings.gain / np.maximum(waves.known(settings.window), 1e-6) ** settings.wary
    fit = lags[every, best]
    best = np.where((fit > lags[every, close] + gain) & (fit >= settings.surely), best, close)
    scores = lags[every, best]
    steps = find_vertices(lags, best) - far
    steps -= np.average(steps[fixed], weights=size[fixed]) if len(fixed) else 0.0
    dropped = (size < _LEAST_TRACES) | (scores < settings.least)
    steps[fixed], dropped[fixed] = 0.0, False
    # near an end of the cube too little of a layer's surroundings is known to be compared
    scores[fixed] = np.maximum(scores[fixed], settings.trusted)
    return np.where(dropped, np.nan, moves + steps), np.clip(scores, 0.0, 1.0).astype(np.float32)


def find_vertices(scores: Float32Array, best: IntArray) -> Float64Array:
    """Places of the maxima next to the best entries, by parabolas."""
    every, last = np.arange(len(scores)), scores.shape[1] - 1
    inner = np.clip(best, 1, last - 1)
    before, here, after = (scores[every, inner + d].astype(np.float64) for d in (-1, 0, 1))
    bend = before - 2.0 * here + after
    part = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return np.where((best == inner), best + part, best.astype(np.float64))
