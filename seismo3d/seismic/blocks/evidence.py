"""Slopes and misfit of blocks, and what of them holds for the whole cube."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.medians import BlockMedians
from seismo3d.seismic.blocks.plan import Box, bridge_reach, evidence_reach
from seismo3d.seismic.blocks.registering import read_sides
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.slopes import estimate_block
from seismo3d.seismic.fault_evidence import compare_sides
from seismo3d.seismic.levelling import (
    bridge_unknown,
    fill_absent,
    find_footprint,
    find_moments,
    level,
    level_mean,
    level_reach,
    mean_known,
    spread_laterally,
    take_out_lines,
    trace_medians,
    trace_moments,
)
from seismo3d.seismic.misfit import (
    compare_along,
    depth_energies,
    energy_floor,
    measure_ratios,
    shares_at_noise,
    trace_energies,
    weigh_logs,
)
from seismo3d.seismic.misfit_settings import find_noise, judge_noise, misfit_reach
from seismo3d.seismic.side_shifts import slice_floor


def thinned_shape(run: BlockRun) -> tuple[int, int, int]:
    """Return the shape of the evidence."""
    n0, n1, n2 = run.plan.shape
    return n0, n1, -(-n2 // run.settings.misfit.step)


def make_slope_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`dip` writes to."""
    for name in ("p", "q"):
        run.store.make(name, run.plan.shape, np.float32)


def dip(run: BlockRun, number: int) -> None:
    """Estimate a block's slopes."""
    box = run.plan.tiling("dip").box(number)
    volume, valid, slopes = estimate_block(run, box)
    for name, slope in zip(("p", "q"), slopes, strict=True):
        run.store.write(name, box, slope)
    found = {"energies": trace_energies(volume, valid), "depths": depth_energies(volume, valid)}
    run.write_part("dip", number, found)


def dip_facts(run: BlockRun) -> None:
    """Find what is added to the energy that divides misfits, and the derivative below which nothing is matched."""
    n_samples = run.plan.shape[2]
    energies, depths = (run.gather("dip", name, "dip") for name in ("energies", "depths"))
    run.write_fact(
        "dip",
        floor=energy_floor(depths, n_samples, run.settings.misfit),
        matching=float(slice_floor(energies, n_samples, run.settings.registration)),
    )


def ratio_names(attempt: str) -> tuple[str, str, str, str]:
    """Return the arrays of the misfit ratios of an attempt.

    The first way of carrying the sides is tried "near" by, and "far" off where the cube's noise asks for that; the
    "second" way then as far as that came to.
    """
    return f"ratio0_{attempt}", f"ratio1_{attempt}", f"known0_{attempt}", f"known1_{attempt}"


def make_ratio_arrays(run: BlockRun, attempt: str) -> None:
    """Make the arrays that :func:`misfit` writes to."""
    for k, name in enumerate(ratio_names(attempt)):
        run.store.make(name, thinned_shape(run), np.float32, packed=k > 1)


def attempt_reach(run: BlockRun, attempt: str) -> int:
    """Return how many traces are averaged on each side in an attempt."""
    return int(run.settings.misfit.reach[0] if attempt == "near" else run.fact("noise_near")["reach"])


def misfit(run: BlockRun, number: int, attempt: str) -> None:
    """Measure a block's misfit ratios."""
    settings = run.settings.misfit
    box = run.plan.tiling("misfit").box(number)
    reach = attempt_reach(run, attempt)
    halo = misfit_reach(reach, settings)
    wide = box.grown((halo, halo), run.plan.shape)
    volume, valid = read_clean(run, wide)
    if run.settings.evidence == "registration" or attempt == "second":
        way = compare_sides(volume, valid, read_sides(run, wide))
    else:
        way = compare_along(volume, valid, (run.store.read("p", wide), run.store.read("q", wide)))
    floor = run.fact("dip")["floor"]
    ratios, known = measure_ratios(volume.shape, way, reach, floor, settings, box.within(wide))
    for name, values in zip(ratio_names(attempt), ratios + known, strict=True):
        run.store.write(name, box, values)
    run.write_part(f"misfit_{attempt}", number, noise_median(attempt).count([_where_known(ratios, known)]))


def noise_median(attempt: str) -> BlockMedians:
    """Return what finds the median misfit ratio of both ways together."""
    return BlockMedians(f"misfit_{attempt}", f"noise_{attempt}", "misfit", partial(_read_known, attempt=attempt))


def _read_known(run: BlockRun, box: Box, attempt: str) -> list[list[Float32Array]]:
    found = [run.store.read(name, box) for name in ratio_names(attempt)]
    return [_where_known(found[:2], found[2:])]


def misfit_facts(run: BlockRun, attempt: str) -> None:
    """Find where the median misfit ratio lies, roughly."""
    run.write_fact(f"misfit_{attempt}", **noise_median(attempt).locate(run))


def noise(run: BlockRun, number: int, attempt: str) -> None:
    """Count a block's misfit ratios near the median."""
    noise_median(attempt).count_near(run, number)


def noise_facts(run: BlockRun, attempt: str) -> None:
    """Find the cube's median misfit ratio, and what follows from it."""
    ratio = find_noise(noise_median(attempt).find(run)[0], attempt_reach(run, attempt), run.settings.misfit)
    noisiness, reach = judge_noise(ratio, run.settings.misfit)
    if attempt != "near":
        noisiness = run.fact("noise_near")["noisiness"]
    run.write_fact(f"noise_{attempt}", noise=ratio, noisiness=noisiness, reach=reach)


def attempts(run: BlockRun) -> list[tuple[str, float]]:
    """Return the attempts at the misfit that count, with their shares: of one way of carrying the sides, or of both."""
    near = run.fact("noise_near")
    first = "near" if near["reach"] == run.settings.misfit.reach[0] else "far"
    if run.settings.evidence != "both":
        return [(first, 1.0)]
    registration = run.settings.registration
    shares = shares_at_noise(near["noise"], registration.share, registration.share_noises)
    return [(name, share) for name, share in zip((first, "second"), shares, strict=True) if share > 0.0]


def final_noise(run: BlockRun) -> tuple[float, float]:
    """Return the least median misfit ratio that counts, and how noisy the cube is."""
    noise = min(run.fact(f"noise_{attempt}")["noise"] for attempt, _ in attempts(run))
    return noise, run.fact("noise_near")["noisiness"]


def make_bridged_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`moments` writes to."""
    for name in ("bridged0", "bridged1"):
        run.store.make(name, thinned_shape(run), np.float32)
    run.store.make("known", thinned_shape(run), np.float32, packed=True)
    run.store.make("present", thinned_shape(run), bool, packed=True)


def moments(run: BlockRun, number: int) -> None:
    """Bridge a block's evidence where it is not known, sum it up, and find its traces' medians."""
    box = run.plan.tiling("moments").box(number)
    wide = box.grown((bridge_reach(), bridge_reach()), run.plan.shape)
    inner = box.within(wide)
    sums, medians = [], []
    known_best: Float32Array | None = None
    present: BoolArray | None = None
    for axis, (values, known) in enumerate(_log_ratios(run, wide)):
        sums.append(trace_moments(values[inner], known[inner]))
        bridged = bridge_unknown(values, known, within=inner)
        medians.append(trace_medians(bridged))
        run.store.write(f"bridged{axis}", box, bridged)
        told = np.isfinite(bridged)
        del bridged
        known_best = known[inner] if known_best is None else np.maximum(known_best, known[inner])
        present = told if present is None else present | told
    n_absent = 0
    if known_best is not None and present is not None:
        run.store.write("known", box, known_best)
        run.store.write("present", box, present)
        n_absent = int(np.count_nonzero(~present))
    run.write_part(
        "moments", number, {"sums": np.stack(sums), "medians": np.stack(medians), "absent": np.array(n_absent)}
    )


def moments_facts(run: BlockRun) -> None:
    """Find the mean and spread of the cube's evidence, and its acquisition footprint."""
    ratio, noisiness = final_noise(run)
    mean, spread = find_moments(list(run.gather("moments", "sums", "moments")), ratio, noisiness)
    medians = run.gather("moments", "medians", "moments")
    lines = [find_footprint(medians[axis], axis, ratio, run.settings.misfit) for axis in range(2)]
    found = {f"excess{axis}": line for axis, line in enumerate(lines) if line is not None}
    absent = int(run.add_up("moments", "absent", "moments"))
    means = [mean_known(sums) for sums in run.gather("moments", "sums", "moments")]
    run.write_fact("moments", mean=mean, spread=spread, means=means, absent=absent, **found)


def make_evidence_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`evidence` writes to."""
    for name in ("evidence0", "evidence1"):
        run.store.make(name, thinned_shape(run), np.float32)


def evidence(run: BlockRun, number: int) -> None:
    """Finish a block's evidence, but for what levelling gives back."""
    settings, facts = run.settings.misfit, run.fact("moments")
    box = run.plan.tiling("evidence").box(number)
    around = box.grown((level_reach(settings),) * 2, run.plan.shape)
    wide = box.grown((evidence_reach(settings),) * 2, run.plan.shape)
    sums = []
    for axis in range(2):
        filled = run.store.read(f"bridged{axis}", wide)
        fill_absent(filled, facts["means"][axis])
        excess = facts.get(f"excess{axis}")
        lines = slice(wide.i0, wide.i1) if axis == 0 else slice(wide.j0, wide.j1)
        take_out_lines(filled, None if excess is None else excess[lines], axis)
        filled = spread_laterally(filled, settings.lateral, within=around.within(wide))
        filled, given = level(filled, settings, within=box.within(around))
        run.store.write(f"evidence{axis}", box, filled)
        sums.append(given)
    run.write_part("evidence", number, {"sums": np.stack(sums)})


def evidence_facts(run: BlockRun) -> None:
    """Find what levelling gives back."""
    sums = run.gather("evidence", "sums", "evidence")
    shape, settings = thinned_shape(run), run.settings.misfit
    run.write_fact("evidence", given_back=[float(level_mean(part, shape, settings)) for part in sums])


def read_present(run: BlockRun, box: Box) -> BoolArray | None:
    """Tell where in a box there is evidence; None if there is everywhere in the cube."""
    return run.store.read("present", box) if run.fact("moments")["absent"] else None


def _read_evidence(run: BlockRun, box: Box) -> list[Iterable[Float32Array]]:
    """Return a box of the evidence, both ways, where there is any."""
    both, present = [read_levelled(run, axis, box) for axis in range(2)], read_present(run, box)
    if present is None:
        return list(both)
    return [[line[told] for line, told in zip(values, present, strict=True)] for values in both]


def read_levelled(run: BlockRun, axis: int, box: Box) -> Float32Array:
    """Return a box of the evidence of one way."""
    values = run.store.read(f"evidence{axis}", box)
    values += np.float32(run.fact("evidence")["given_back"][axis])
    return values


PRIOR = BlockMedians("prior", "medians", "evidence", _read_evidence)
"""The medians of the evidence, of either way."""


def prior(run: BlockRun, number: int) -> None:
    """Count a block's evidence."""
    run.write_part("prior", number, PRIOR.count(_read_evidence(run, run.plan.tiling("evidence").box(number))))


def prior_facts(run: BlockRun) -> None:
    """Find where the medians of the evidence lie, roughly."""
    run.write_fact("prior", **PRIOR.locate(run))


def medians_facts(run: BlockRun) -> None:
    """Find the medians of the evidence."""
    run.write_fact("medians", medians=PRIOR.find(run))


def _log_ratios(run: BlockRun, box: Box) -> Iterator[tuple[Float32Array, Float32Array]]:
    """Give, for both ways, a box's evidence, and how far it is known."""
    counted, settings = attempts(run), run.settings.misfit
    noises = [run.fact(f"noise_{attempt}")["noise"] for attempt, _ in counted]
    for axis in range(2):
        sums: list[Float32Array] = []
        for (attempt, share), noise in zip(counted, noises, strict=True):
            values, known = run.store.read(f"ratio{axis}_{attempt}", box), run.store.read(f"known{axis}_{attempt}", box)
            weigh_logs([values], [known], noise, share, settings)
            if not sums:
                sums = [values, known]
                continue
            sums[0] += values
            sums[1] += known
            del values, known
        yield sums[0], sums[1]


def _where_known(ratios: list[Float32Array], known: list[Float32Array]) -> list[Float32Array]:
    pairs = ((line, weight) for both in zip(ratios, known, strict=True) for line, weight in zip(*both, strict=True))
    return [line[weight > 0.5] for line, weight in pairs]
