"""Blocks scanned for planes, and thinned to ridges: what is left is sparse enough for the whole cube's to be linked."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float32Array, IntArray
from seismo3d.seismic.blocks.evidence import final_noise, read_levelled, read_present, thinned_shape
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.results import write_result
from seismo3d.seismic.blocks.room import OnDisk
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.faults import score_at_noise
from seismo3d.seismic.rasterise import draw_ridges
from seismo3d.seismic.scan import (
    BESIDE,
    PlanarSupport,
    RidgePoints,
    ScanPlan,
    ScanRegion,
    find_offsets,
    find_prior,
    in_spreads,
    leave_layers,
    plan_scan,
    scan_region,
    thin_region,
)

# traces from a voxel to those that tell whether it is a crest
_FLANKS = 2


def find_plan(run: BlockRun) -> ScanPlan:
    """Return the planes that the cube is scanned for."""
    _, noisiness = final_noise(run)
    return plan_scan(thinned_shape(run), noisiness, run.settings.misfit.step, settings=run.settings.scan)


def make_support_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`scan` writes to."""
    run.store.make("score", thinned_shape(run), np.float32)
    run.store.make("orientation", thinned_shape(run), np.int16)


def scan(run: BlockRun, number: int) -> None:
    """Scan a block for planes."""
    plan = find_plan(run)
    box = run.plan.tiling("scan").box(number)
    moments, medians = run.fact("moments"), run.fact("medians")["medians"]
    prior, offsets = find_prior(medians, run.plan.shape), find_offsets(medians, run.plan.shape, final_noise(run)[0])

    def take(across: int) -> ScanRegion:
        reach = plan.reach if across == 0 else (plan.reach[1], plan.reach[0])
        wide = box.grown(reach, run.plan.shape)
        corner = (box.i0 - wide.i0, box.j0 - wide.j0)
        levelled = (_read_offset(run, axis, wide, offset) for axis, offset in enumerate(offsets))
        return ScanRegion.turned(levelled, read_present(run, wide), across, corner, box.shape)

    best, orientation = scan_region(take, plan, prior)
    run.store.write("score", box, in_spreads(best, moments["mean"], moments["spread"]))
    run.store.write("orientation", box, orientation)
    run.write_part("scan", number, {})


def _read_offset(run: BlockRun, axis: int, box: Box, offset: np.float32) -> Float32Array:
    values = read_levelled(run, axis, box)
    values += offset
    return values


def thin(run: BlockRun, number: int) -> None:
    """Find a block's ridges, keep the strong ones, and draw the likelihood."""
    plan = find_plan(run)
    box = run.plan.tiling("draw").box(number)
    # a ridge stands for `step` samples, over which its plane moves on
    drawn_from = 2 + int(np.ceil(float(np.abs(plan.cotangents).max()) * (plan.step - 1)))
    wide = box.grown((drawn_from + _FLANKS,) * 2, run.plan.shape)
    support = PlanarSupport(run.store.read("score", wide), run.store.read("orientation", wide), plan.planes)
    ridges = thin_region(support, run.store.read("known", wide), plan.step, least=0.0, corner=(wide.i0, wide.j0))
    ridges = ridges.select(_inside(ridges, box.grown((drawn_from,) * 2, run.plan.shape)))
    seen = box.grown((drawn_from + BESIDE + 1,) * 2, run.plan.shape)
    slopes = run.store.read("p", seen), run.store.read("q", seen)
    ridges = leave_layers(ridges, slopes, run.settings.scan, corner=(seen.i0, seen.j0))
    shape = (*box.shape, run.plan.shape[2])
    write_result(run, "likelihood", box, draw_ridges(ridges, plan.step, shape, corner=(box.i0, box.j0)))
    kept = ridges.select(_inside(ridges, box) & (ridges.score >= min(least_scores(run))))
    run.write_part(
        "thin", number,
        {"voxels": kept.voxels, "positions": kept.positions, "planes": kept.planes, "score": kept.score},
    )  # fmt: skip


def least_scores(run: BlockRun) -> tuple[float, float]:
    """Return the least support of strong ridges, and of those that sheets are followed along."""
    ratio, _ = final_noise(run)
    return score_at_noise(run.settings.least_score, ratio), run.settings.extend.weakest


def gather_ridges(run: BlockRun, room: OnDisk) -> list[RidgePoints]:
    """Return the whole cube's strong ridges, and those that sheets are followed along.

    They are in the order in which the cube in one piece has them.
    """
    blocks, shape, scores = range(len(run.plan.tiling("draw"))), thinned_shape(run), least_scores(run)
    keys: list[list[IntArray]] = [[] for _ in scores]
    for number in blocks:
        part, _ = run.read_part("thin", number)
        flat = np.ravel_multi_index(tuple(part["voxels"].T), shape)
        for found, least in zip(keys, scores, strict=True):
            found.append(flat[part["score"] >= least])
    places = [_places_in_order(np.concatenate(found)) for found in keys]
    del keys
    wholes = [
        RidgePoints(
            voxels=room.array((len(place), 3), np.int32), positions=room.array((len(place), 3), np.float32),
            planes=room.array((len(place), 3), np.float32), score=room.array((len(place),), np.float32),
        )
        for place in places
    ]  # fmt: skip
    first = [0] * len(scores)
    for number in blocks:
        part, _ = run.read_part("thin", number)
        for n, (whole, place, least) in enumerate(zip(wholes, places, scores, strict=True)):
            enough = part["score"] >= least
            at = place[first[n] : first[n] + int(enough.sum())]
            for name in ("voxels", "positions", "planes", "score"):
                getattr(whole, name)[at] = part[name][enough]
            first[n] += len(at)
        room.rest()
    return wholes


def _places_in_order(keys: IntArray) -> IntArray:
    """Return the place that each of some numbers has when they are sorted."""
    order = np.argsort(keys, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return place


def _inside(ridges: RidgePoints, box: Box):  # type: ignore[no-untyped-def]
    i, j, _ = ridges.voxels.T
    return (i >= box.i0) & (i < box.i1) & (j >= box.j0) & (j < box.j1)
