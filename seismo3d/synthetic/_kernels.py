"""Compiled loops of the synthetic cubes: undo faults and folds at every voxel, lay wavelets on the reflectors there.

One fault is one row of ``faulting.N_COLUMNS`` numbers, one folding one row of linear terms and a table of
Gaussians. All positions are fractional indices (inline, crossline, sample). Time runs backwards here: from where a
grain lies today, through the faults from the youngest to the oldest and the folding, to the layer in which it was
laid down.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

import numpy as np
from numba import njit

CI, CX, CS, DI, DX, COT, SHAPE, BEND_A, BEND_S, RIPPLE, RIPPLE_K, RIPPLE_P, TAN_DEEP, LENGTH, THROW = range(15)
PROFILE, SEMI_A, SEMI_S, TREND_A, TREND_S, DRAG, SHARE, RAKE, SIN_DIP = range(15, 24)
PLANE, LISTRIC = 0, 1
UNIFORM, GAUSSIAN, ELLIPTIC = 0, 1, 2
ERODED = 1 << 60


@njit(cache=True, nogil=True)
def _bend(a, f):
    value = 0.5 * f[BEND_A] * a * a
    if f[RIPPLE] != 0.0:
        value += f[RIPPLE] * math.sin(f[RIPPLE_K] * a + f[RIPPLE_P])
    return value


@njit(cache=True, nogil=True)
def _bend_slope(a, f):
    value = f[BEND_A] * a
    if f[RIPPLE] != 0.0:
        value += f[RIPPLE] * f[RIPPLE_K] * math.cos(f[RIPPLE_K] * a + f[RIPPLE_P])
    return value


@njit(cache=True, nogil=True)
def _ramp(h, f):
    """Depth of a listric surface below its centre, at horizontal distance h in the dip direction."""
    steep = 1.0 / f[COT]
    if h <= 0.0:
        return steep * h
    return f[TAN_DEEP] * h + (steep - f[TAN_DEEP]) * f[LENGTH] * (1.0 - math.exp(-h / f[LENGTH]))


@njit(cache=True, nogil=True)
def _ramp_slope(h, f):
    steep = 1.0 / f[COT]
    if h <= 0.0:
        return steep
    return f[TAN_DEEP] + (steep - f[TAN_DEEP]) * math.exp(-h / f[LENGTH])


@njit(cache=True, nogil=True)
def slip_profile(a, z, f):
    """Share of the maximal throw at strike distance a and depth z from the fault's centre."""
    if f[PROFILE] == UNIFORM:
        return min(max(1.0 + f[TREND_A] * a + f[TREND_S] * z, 0.0), 2.0)
    r2 = (a / f[SEMI_A]) ** 2
    if f[SHAPE] == PLANE:
        r2 += (z / f[SEMI_S]) ** 2
    if f[PROFILE] == GAUSSIAN:
        return math.exp(-0.5 * r2)
    if r2 >= 1.0:
        return 0.0
    r = math.sqrt(r2)
    return 2.0 * (1.0 - r) * math.sqrt(0.25 * (1.0 + r) ** 2 - r2)


@njit(cache=True, nogil=True)
def _slide(a, z, throw, f):
    """Motion along dip (horizontal) and along strike of a grain now at (a, z) that has dropped by throw on a plane."""
    along = f[RAKE] * throw
    z0 = z - throw
    down_dip = z * (f[COT] + 0.5 * f[BEND_S] * z) - z0 * (f[COT] + 0.5 * f[BEND_S] * z0)
    if along != 0.0:
        down_dip += _bend(a, f) - _bend(a - along, f)
    return down_dip, along


@njit(cache=True, nogil=True)
def undo_fault(i, x, s, f):
    """Return where the grain at (i, x, s) lay before the fault moved, and the fault's state there.

    State: side (positive in the hanging wall), the largest component of its gradient, vertical throw of the fault
    at the nearest point of its surface.
    """
    ui, ux, z = i - f[CI], x - f[CX], s - f[CS]
    a = ui * f[DX] - ux * f[DI]
    h = ui * f[DI] + ux * f[DX]
    slope = _bend_slope(a, f)
    bent = h - _bend(a, f)
    gi, gx = abs(f[DI] - slope * f[DX]), abs(f[DX] + slope * f[DI])
    if f[SHAPE] == LISTRIC:
        depth = _ramp(bent, f)
        side = depth - z
        grade = max(1.0, _ramp_slope(bent, f) * max(gi, gx))
        heave = f[THROW] * f[COT] * slip_profile(a, z, f)
        throw = depth - _ramp(bent - heave, f)
        if side > 0.0:
            i, x, s = i - heave * f[DI], x - heave * f[DX], s - throw
        return i, x, s, side, grade, throw
    side = bent - z * (f[COT] + 0.5 * f[BEND_S] * z)
    grade = max(abs(f[COT] + f[BEND_S] * z), gi, gx)
    throw = f[THROW] * slip_profile(a, z, f)
    moved = throw * f[SHARE] if side > 0.0 else throw * (f[SHARE] - 1.0)
    if f[DRAG] > 0.0:
        moved *= max(0.0, 1.0 - abs(side) * f[SIN_DIP] / f[DRAG]) ** 2
    if moved != 0.0:
        down_dip, along = _slide(a, z, moved, f)
        i -= down_dip * f[DI] + along * f[DX]
        x -= down_dip * f[DX] - along * f[DI]
        s -= moved
    return i, x, s, side, grade, throw


@njit(cache=True, nogil=True)
def slip_vector(i, x, s, throw, f):
    """Motion (inline, crossline, sample) of the hanging wall relative to the footwall at a point of the surface."""
    ui, ux, z = i - f[CI], x - f[CX], s - f[CS]
    a = ui * f[DX] - ux * f[DI]
    if f[SHAPE] == LISTRIC:
        down_dip, along = f[THROW] * f[COT] * slip_profile(a, z, f), 0.0
    else:
        down_dip, along = _slide(a, z, throw, f)
    return down_dip * f[DI] + along * f[DX], down_dip * f[DX] - along * f[DI], throw


@njit(cache=True, nogil=True)
def fold_shift(i, x, s, bumps, terms):
    """Vertical shift of the layers: sum of Gaussians scaled linearly with depth, plus a plane.

    terms: base and gain of the scale, constant, slope along inline and crossline, centre of the plane.
    """
    total = 0.0
    for k in range(bumps.shape[0]):
        r2 = ((i - bumps[k, 0]) ** 2 + (x - bumps[k, 1]) ** 2) * bumps[k, 2]
        if r2 < 20.0:
            total += bumps[k, 3] * math.exp(-r2)
    scale = max(terms[0] + terms[1] * s, 0.0)
    return scale * total + terms[2] + terms[3] * (i - terms[5]) + terms[4] * (x - terms[6])


@njit(cache=True, nogil=True)
def _side_today(i, x, s, m, faults, bumps, terms, old_faults):
    """Side of fault m (counted from the oldest) at a point of today's cube, after undoing all later faults."""
    n_old = old_faults.shape[0]
    for k in range(faults.shape[0] - 1, max(m - n_old, -1), -1):
        i, x, s = undo_fault(i, x, s, faults[k])[:3]
    if m >= n_old:
        return undo_fault(i, x, s, faults[m - n_old])[3]
    s += fold_shift(i, x, s, bumps, terms)
    for k in range(n_old - 1, m, -1):
        i, x, s = undo_fault(i, x, s, old_faults[k])[:3]
    return undo_fault(i, x, s, old_faults[m])[3]


@njit(cache=True, nogil=True)
def _is_on_surface(i, x, s, side, grade, m, faults, bumps, terms, old_faults):
    """Whether fault m passes within half a voxel, along the axis nearest to its normal, as it lies today.

    Later faults and folds strain the earlier surface, so that its gradient is taken through them; where a later fault
    passes right there, the gradient before it is used.
    """
    if abs(side) >= 1.25 * grade:
        return False
    step, steepest = 1e-3, 0.0
    here = _side_today(i, x, s, m, faults, bumps, terms, old_faults)
    for axis in range(3):
        there = _side_today(
            i + step * (axis == 0), x + step * (axis == 1), s + step * (axis == 2), m, faults, bumps, terms, old_faults
        )
        steepest = max(steepest, abs(there - here) / step)
    if steepest > 4.0 * grade:
        steepest = grade
    return -0.5 * steepest <= side < 0.5 * steepest


@njit(cache=True, nogil=True)
def trace_structure(
    i, x, first, faults, bumps, terms, erosion, old_faults, old_bumps, old_terms, offset, least,
    tau, sides, depth, origin, labels, throws, slips,
):  # fmt: skip
    """Fill one trace: layer time, sides of all faults, depth below the erosion surface, place of deposition, truth."""
    n_new, n_old = faults.shape[0], old_faults.shape[0]
    for k in range(tau.shape[0]):
        pi, px, ps = float(i), float(x), float(first + k)
        bits, label, throw, s0, s1, s2 = 0, 0, math.nan, 0.0, 0.0, 0.0
        for m in range(n_new - 1, -1, -1):
            f = faults[m]
            hi, hx, hs = pi, px, ps
            pi, px, ps, side, grade, t = undo_fault(hi, hx, hs, f)
            if side > 0.0:
                bits |= 1 << m
            if (
                label == 0
                and abs(t) >= least
                and _is_on_surface(i, x, first + k, side, grade, n_old + m, faults, bumps, terms, old_faults)
            ):
                label, throw = n_old + m + 1, t
                s0, s1, s2 = slip_vector(hi, hx, hs, t, f)
        now = ps + fold_shift(pi, px, ps, bumps, terms)
        depth[k] = -1.0
        if erosion.shape[0] > 0:
            depth[k] = now - fold_shift(pi, px, 0.0, erosion[1:, :4], erosion[0])
        if depth[k] > 0.0:
            bits |= ERODED
            stretch = 1.0 / (now - (ps - 1.0 + fold_shift(pi, px, ps - 1.0, bumps, terms)))
            ps = now
            for m in range(n_old - 1, -1, -1):
                f = old_faults[m]
                hi, hx, hs = pi, px, ps
                pi, px, ps, side, grade, t = undo_fault(hi, hx, hs, f)
                if side > 0.0:
                    bits |= 1 << (n_new + m)
                if (
                    label == 0
                    and abs(t * stretch) >= least
                    and _is_on_surface(i, x, first + k, side, grade, m, faults, bumps, terms, old_faults)
                ):
                    label, throw = m + 1, t * stretch
                    s0, s1, s2 = slip_vector(hi, hx, hs, t, f)
            now = ps + fold_shift(pi, px, ps, old_bumps, old_terms) + offset
        tau[k], sides[k] = now, bits
        origin[k, 0], origin[k, 1] = pi, px
        labels[k], throws[k] = label, throw
        slips[k, 0], slips[k, 1], slips[k, 2] = s0, s1, s2


@njit(cache=True, nogil=True)
def mark_breaks(tau, sides, depth, breaks):
    """Mark the intervals between samples k and k + 1 where layer time jumps: 1 at a fault, 2 at the erosion surface."""
    n = tau.shape[0]
    for k in range(n - 1):
        breaks[k] = 0
        changed = sides[k] ^ sides[k + 1]
        if changed & ERODED:
            breaks[k] = 2 if 0.0 < depth[k + 1] - depth[k] < 2.0 else 1
        elif changed:
            usual, count = 0.0, 0
            if k > 0 and sides[k - 1] == sides[k]:
                usual += tau[k] - tau[k - 1]
                count += 1
            if k + 2 < n and sides[k + 2] == sides[k + 1]:
                usual += tau[k + 2] - tau[k + 1]
                count += 1
            usual = usual / count if count else 1.0
            if abs(tau[k + 1] - tau[k] - usual) > 0.25:
                breaks[k] = 1


@njit(cache=True, nogil=True)
def lay_wavelet(out, place, strength, wavelet, steps):
    """Add a wavelet, tabulated ``steps`` times a sample, at a fractional sample."""
    half = (wavelet.shape[0] // 2) / steps
    low = max(0, math.ceil(place - half))
    high = min(out.shape[0] - 1, math.floor(place + half))
    for k in range(low, high + 1):
        u = (k - place + half) * steps
        j = int(u)
        if j >= wavelet.shape[0] - 1:
            continue
        out[k] += strength * (wavelet[j] + (u - j) * (wavelet[j + 1] - wavelet[j]))


@njit(cache=True, nogil=True)
def _channel_base(i, x, c):
    """Layer time of a channel's base at a place of deposition; below c[0] (its top) inside the channel only."""
    ui, ux = i - c[2], x - c[3]
    along, across = ui * c[4] + ux * c[5], ux * c[4] - ui * c[5]
    away = (across - c[6] * math.sin(c[7] * along + c[8])) / c[9]
    return c[0] + c[1] * (1.0 - away * away)


@njit(cache=True, nogil=True)
def _channel_at(i, x, t, channels):
    """Return the last channel that holds a grain laid down at (i, x, t), or -1."""
    for m in range(channels.shape[0] - 1, -1, -1):
        c = channels[m]
        if c[0] <= t < c[0] + c[1] and t < _channel_base(i, x, c):
            return m
    return -1


@njit(cache=True, nogil=True)
def _impedance_at(t, channel, times, impedance, channels):
    value = impedance[np.searchsorted(times, t)]
    if channel >= 0:
        value = channels[channel, 10] + channels[channel, 11] * value
    return value


@njit(cache=True, nogil=True)
def _channel_edge(t0, t1, o0, o1, c):
    """Return where between two samples a channel begins or ends, 0 to 1."""
    if t0 < c[0] <= t1:
        return (c[0] - t0) / (t1 - t0)
    d0, d1 = t0 - _channel_base(o0[0], o0[1], c), t1 - _channel_base(o1[0], o1[1], c)
    return min(max(d0 / (d0 - d1), 0.0), 1.0) if d0 != d1 else 0.5


@njit(cache=True, nogil=True)
def lay_trace(tau, breaks, depth, origin, first, times, impedance, channels, wavelet, steps, out):
    """Lay one wavelet on every step of impedance that the trace meets: layers, erosion surface, channels.

    The fault planes themselves reflect nothing. Where layers end at the erosion surface or a channel, that reflects the
    whole step of impedance across it, so that amplitudes fade into each other as they do in the Earth.
    """
    n = tau.shape[0]
    inside = _channel_at(origin[0, 0], origin[0, 1], tau[0], channels)
    for k in range(n - 1):
        t0, t1, before = tau[k], tau[k + 1], inside
        inside = _channel_at(origin[k + 1, 0], origin[k + 1, 1], t1, channels)
        if breaks[k] == 1:
            continue
        if breaks[k] == 2 or before != inside:
            step = _impedance_at(t1, inside, times, impedance, channels)
            step -= _impedance_at(t0, before, times, impedance, channels)
            if breaks[k] == 2:
                part = depth[k] / (depth[k] - depth[k + 1])
            else:
                part = _channel_edge(t0, t1, origin[k], origin[k + 1], channels[max(before, inside)])
            lay_wavelet(out, first + k + part, step, wavelet, steps)
            continue
        gain = channels[inside, 11] if inside >= 0 else 1.0
        j = np.searchsorted(times, t0)
        while j < times.shape[0] and times[j] < t1:
            place = first + k + (times[j] - t0) / (t1 - t0)
            lay_wavelet(out, place, gain * (impedance[j + 1] - impedance[j]), wavelet, steps)
            j += 1


@njit(cache=True, nogil=True)
def find_horizons(tau, breaks, wanted, n_samples, first, out):
    """Depth of each wanted layer time on one trace, the uppermost where a reverse fault repeats it."""
    for h in range(wanted.shape[0]):
        out[h] = np.nan
        for k in range(-first, n_samples - first - 1):
            if breaks[k] == 0 and tau[k] <= wanted[h] < tau[k + 1]:
                out[h] = first + k + (wanted[h] - tau[k]) / (tau[k + 1] - tau[k])
                break


@njit(cache=True, nogil=True)
def slab_structure(
    i, first, n_samples, faults, bumps, terms, erosion, old_faults, old_bumps, old_terms, offset, least,
    times, impedance, channels, wavelet, steps, wanted,
    seismic, tau_out, labels_out, throws_out, slips_out, horizons_out,
):  # fmt: skip
    """One inline of the cube: structure, truth, horizons and the noise-free seismic."""
    n = n_samples - 2 * first
    tau, depth, origin = np.empty(n), np.empty(n), np.empty((n, 2))
    sides, breaks = np.empty(n, np.int64), np.zeros(n, np.uint8)
    labels, throws, slips = np.empty(n, np.int32), np.empty(n), np.empty((n, 3))
    for x in range(seismic.shape[0]):
        trace_structure(
            i, x, first, faults, bumps, terms, erosion, old_faults, old_bumps, old_terms, offset, least,
            tau, sides, depth, origin, labels, throws, slips,
        )  # fmt: skip
        mark_breaks(tau, sides, depth, breaks)
        trace = np.zeros(n_samples)
        lay_trace(tau, breaks, depth, origin, first, times, impedance, channels, wavelet, steps, trace)
        find_horizons(tau, breaks, wanted, n_samples, first, horizons_out[:, x])
        for k in range(n_samples):
            seismic[x, k] = trace[k]
            tau_out[x, k] = tau[k - first]
            labels_out[x, k] = labels[k - first]
            throws_out[x, k] = throws[k - first]
            for d in range(3):
                slips_out[x, k, d] = slips[k - first, d]
