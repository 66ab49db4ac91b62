"""Fault tracing, from a cube or section to surfaces: one straight line of steps.

slopes -> misfit -> planar support -> ridges -> sheets -> places -> throws -> surfaces, labels, likelihood
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._settings import Threshold, as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import BoolArray, Float32Array, Progress
from seismo3d._validate import freeze
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.choosing import ChoiceSettings, choose_faults, may_be_faults
from seismo3d.seismic.cut_offsets import CutSettings, offset_sheets
from seismo3d.seismic.dip import DipSettings, estimate_slopes
from seismo3d.seismic.doubles import part_doubles
from seismo3d.seismic.extending import ExtendSettings, extend_sheets
from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.fault_evidence import check_evidence, measure_evidence
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.flanks import FlankSettings, join_flanks
from seismo3d.seismic.layer_strain import LayerSlopes, sample_slopes
from seismo3d.seismic.leftovers import link_leftovers
from seismo3d.seismic.linking import Room, link_sheets
from seismo3d.seismic.misfit import Evidence
from seismo3d.seismic.misfit_settings import NOISES, MisfitSettings
from seismo3d.seismic.placing import PlaceSettings, place_sheet, read_profile
from seismo3d.seismic.preparing import as_volume, check_live, clean_volume
from seismo3d.seismic.rasterise import draw_ridges, draw_sheets, to_likelihood
from seismo3d.seismic.restored_throws import restore_throws
from seismo3d.seismic.scan import RidgePoints, ScanSettings, leave_layers, scan_planes, thin
from seismo3d.seismic.section_scores import (
    SectionScoreSettings,
    spread_likelihood,
    weigh_by_lines,
    weigh_crests,
    weigh_line,
)
from seismo3d.seismic.sheet_ends import end_along_layers, end_at_bends, end_in_mutes, end_where_still
from seismo3d.seismic.sheet_tips import continue_sheet, likeness_beyond, share_in_view
from seismo3d.seismic.sheets import Sheet, SheetSettings
from seismo3d.seismic.side_shifts import RegistrationSettings
from seismo3d.seismic.surfaces import build_surface, order_by_area
from seismo3d.seismic.throw import (
    SheetSides,
    SheetThrow,
    ThrowSettings,
    farther_off,
    gather_closer,
    gather_sides,
    match_sides,
    refine_throw,
    slopes_beside,
)


@dataclass(frozen=True, slots=True)
class FaultSettings:
    """Settings of fault tracing; the defaults are meant for every cube.

    Attributes
    ----------
    least_score : tuple of (float, float, float) in [0, inf]
        Support that a ridge needs, in standard deviations of the cube's own evidence: without noise, in the mild
        noise of a good survey, and in noise.
    end_score : tuple of (float, float, float) in [0, inf]
        The same, averaged over the surface nearby, below which a surface ends.
    evidence : {"semblance", "registration", "both"}
        How the sides of a voxel are carried to it.
    dip, misfit, registration, scan, section, link, extend, cut, choice, throw, history, place, flank
        Settings of the stages; `section` is that of a stage which cubes do without, `flank` that of one which sections
        do without.
    """

    least_score: tuple[Threshold, Threshold, Threshold] = (0.26, 0.26, 0.18)
    end_score: tuple[Threshold, Threshold, Threshold] = (0.26, 0.26, 0.18)
    evidence: str = "both"
    dip: DipSettings = field(default_factory=DipSettings)
    misfit: MisfitSettings = field(default_factory=MisfitSettings)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)
    scan: ScanSettings = field(default_factory=ScanSettings)
    section: SectionScoreSettings = field(default_factory=SectionScoreSettings)
    link: SheetSettings = field(default_factory=SheetSettings)
    extend: ExtendSettings = field(default_factory=ExtendSettings)
    cut: CutSettings = field(default_factory=CutSettings)
    choice: ChoiceSettings = field(default_factory=ChoiceSettings)
    throw: ThrowSettings = field(default_factory=ThrowSettings)
    history: HistorySettings = field(default_factory=HistorySettings)
    place: PlaceSettings = field(default_factory=PlaceSettings)
    flank: FlankSettings = field(default_factory=FlankSettings)

    @classmethod
    def for_section(cls) -> FaultSettings:
        """Return the settings of a section, which is one trace thick along the strike.

        Nothing is gained by sharing a window with neighbours along the strike, so slopes are averaged over more traces
        of the section; and what a cube's strike averages away, windows across the fault must not smear, so the sides
        are compared where they touch and the evidence is hardly smoothed. A line's mean scatters more than a plane's:
        it is taken over more of the dip, at dips so close that its ends are met too. Shifts have no neighbours
        along the strike to be averaged with: beside semblance registration counts in noise alone. Noise that no
        neighbours average out is smoothed along the trace, however little there is. Breaks that no move of their sides
        explains lose most of their score, and thresholds are lower for that. Sizes are lengths of lines.
        """
        return cls(
            least_score=(0.2, 0.2, 0.28),
            end_score=(0.2, 0.2, 0.25),
            dip=DipSettings(lateral=8.0),
            misfit=MisfitSettings(reach=(1, 6), vertical=(1.5, 1.5), lateral=0.5, background=(10.0, 16.0), floor=0.01),
            registration=RegistrationSettings(share=(0.0, 0.0, 1.0)),
            scan=ScanSettings(along_dip=(14.0, 16.0), n_dips=(61, 41), evenness=0.5),
            link=SheetSettings(fragment=6, contacts=5),
            extend=ExtendSettings(strength=np.inf),
            choice=ChoiceSettings.for_section(),
            throw=ThrowSettings(clear=8),
        )


def trace_faults(
    cube: Any,
    *,
    evidence: str | None = None,
    settings: FaultSettings | None = None,
    progress: Progress | None = None,
    memory: int | str | None = None,
    folder: str | Path | None = None,
    scheduler: str | None = None,
) -> FaultSet:
    """Trace the faults of a cube or section: surfaces with likelihood, strike, dip and throw.

    What does not fit across a voxel after both sides are carried to it is the evidence. They are carried along
    reflector slopes, which come from the structure tensor, and by the shifts that register neighbouring slices. Planes
    of all strikes and dips are scanned for the evidence [1]_. Its crests are thinned with sub-voxel position and grown
    into surfaces that pass through each other; certain ones are followed on along weaker crests. A surface is moved to
    where the layers on its two sides break. At every place of it the throw is the shift that matches these sides; those
    of faults that others have offset are matched as they lay before these moved.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample) or a section (trace, sample), as ``open_cube`` gives it or a bare array.
        NaN, dead traces and constant zones count as no data; what all amplitudes share, such as the 128 of unsigned
        bytes, is taken off.
    evidence : {"semblance", "registration", "both"}, optional
        How sides are carried: along their slopes, by registration, or by both ways. Of both, registration counts three
        quarters in a cube without noise, slopes alone in a section without it and in the mild noise of a good survey,
        and registration the more the more noise there is beyond. What the settings say if not given, which is both.
    settings : FaultSettings, optional
        Thresholds and windows; by default ``FaultSettings()`` for a cube and ``FaultSettings.for_section()`` for a
        section.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.
    memory : int or str, optional
        Bytes that a process may take, such as ``"2GB"``. A cube that needs more in one piece is worked on in blocks,
        with the same result, to the bit, and a section that does is refused; without it, always in one piece.
    folder : str or Path, optional
        Needed for work in blocks: gets the volumes as Zarr, and what it takes to go on after the run is killed; give
        the same call again for that.
    scheduler : str, optional
        Address of a dask cluster, which then works on the blocks; its workers must see the folder and the input.

    Returns
    -------
    FaultSet
        ``likelihood`` (float32), ``labels`` (int32) and ``throw`` (float32, samples) in the input's shape and, for a
        DataArray, with its coordinates; ``surfaces``, largest first.

    Raises
    ------
    ShapeError
        If the input has another number of axes than 2 or 3, is too small to hold a fault, or has no live trace.
    ParameterError
        If there is no such kind of evidence, `settings` are no FaultSettings, the memory is too little, there is no
        folder for work in blocks, or the folder holds a run of another input or with other settings.
    FileAccessError
        If the folder cannot be written, or the cluster does not answer.

    Warns
    -----
    Seismo3dWarning
        If fewer than half of the live traces have a live neighbour along an axis, as where every other line is dead; in
        one piece.

    Notes
    -----
    Memory at its peak, in one piece, is about eleven times the cube as float32, the cube itself included. In blocks,
    what is held of the whole cube is sparse: see :mod:`seismo3d.seismic.blocks`. Dips are true ones
    in a cube in depth on a map, else in samples a trace: those of a time cube need a velocity.

    References
    ----------
    .. [1] D. Hale, Geophysics 78(2), O33-O43, 2013. :doi:`10.1190/geo2012-0331.1`
    """
    report = as_progress(progress)
    if memory is not None or folder is not None or scheduler is not None:
        from seismo3d.seismic.blocks.tracing import asks_for_blocks, trace_larger

        if asks_for_blocks(cube, memory, folder=folder, scheduler=scheduler):
            asked = _with_evidence(as_settings(settings, FaultSettings), evidence)
            return trace_larger(cube, memory, folder=folder, scheduler=scheduler, settings=asked, progress=report)
    amplitudes, geometry, sampling = as_volume(cube)
    is_section = 1 in amplitudes.shape[:2]
    usual = FaultSettings.for_section() if is_section else FaultSettings()
    settings = _with_evidence(usual if settings is None else as_settings(settings, FaultSettings), evidence)
    volume, valid, *_ = clean_volume(amplitudes)
    check_live(np.asarray(valid.any(axis=2)), is_section=geometry is None)
    report("dip", 0.0)
    slopes = estimate_slopes(volume, valid, settings=settings.dip)
    report("misfit", 0.0)
    found = measure_evidence(
        volume, valid, slopes, kind=settings.evidence, misfit=settings.misfit, registration=settings.registration,
        farther=settings.section.farther if is_section else 0.0,
    )  # fmt: skip
    report("scan", 0.0)
    ridges = _find_ridges(found, (volume, valid), slopes, settings, report)
    strong = ridges.select(ridges.score >= score_at_noise(settings.least_score, found.noise))
    report("link", 0.0)
    sheets = find_candidates(strong, ridges, found.known.shape, found.noise, settings)
    if sheets:
        del slopes
        slopes = slopes_beside(volume, valid, sheets, dip=settings.dip, settings=settings.throw)
    layers = sample_slopes(slopes, valid, sheets, volume.shape)
    sheets = _place_sheets(sheets, (volume, valid), slopes, settings)
    if not is_section:
        sheets = join_flanks(sheets, settings.choice, settings=settings.flank)
    moving = _measure_sheets(sheets, (volume, valid), slopes, found.noise, settings, report)
    report("surfaces", 0.0)
    numbers = choose_faults(moving, settings.choice.for_size(volume.shape))
    chosen = [sheets[number] for number in numbers]
    sheets, today = [moving[number][0] for number in numbers], [moving[number][1] for number in numbers]
    today, throws = finish_throws(
        sheets,
        today,
        lambda n: gather_closer(volume, valid, slopes, chosen[n], settings=settings.throw),
        layers,
        settings,
        is_section=is_section,
    )
    if is_section:
        ridges = weigh_by_lines(
            ridges, found.known.shape, step=found.step, link=settings.link, settings=settings.section
        )
        sheets = [weigh_line(sheet, settings.section) for sheet in sheets]
    else:
        sheets, throws, today = part_doubles(sheets, throws, today, settings.choice)
    sheets, throws, today = largest_first(sheets, throws, today, volume.shape)
    surfaces = build_surfaces(sheets, throws, today, volume.shape, geometry, sampling)
    labels, throw = draw_sheets(sheets, throws, volume.shape)
    likelihood = draw_ridges(ridges, found.step, volume.shape)
    if is_section:
        likelihood = spread_likelihood(likelihood, settings=settings.section)
    report("surfaces", 1.0)
    return FaultSet(
        surfaces=surfaces,
        likelihood=_like(cube, likelihood, "likelihood"),
        labels=_like(cube, labels, "labels"),
        throw=_like(cube, throw, "throw"),
        settings=asdict(settings),
    )


def _with_evidence(settings: FaultSettings, evidence: str | None) -> FaultSettings:
    """Return settings with the evidence that is asked for, if there is such."""
    found = settings if evidence is None else replace(settings, evidence=evidence)
    check_evidence(found.evidence)
    return found


def score_at_noise(scores: tuple[float, float, float], noise: float) -> float:
    """Return the threshold between those without noise, in mild noise and in noise that a cube's own asks for."""
    return float(np.interp(noise, NOISES, scores))


def find_candidates(
    strong: RidgePoints,
    weak: RidgePoints,
    shape: tuple[int, ...],
    noise: float,
    settings: FaultSettings,
    *,
    room: Room | None = None,
) -> list[Sheet]:
    """Link the strong ridges of a cube, whose evidence has this shape and noise, into sheets that may be faults.

    Certain ones, and those beside them, are followed on along the weak ridges, among which the strong ones are once
    more; what these leave over is linked beside them; those that others cut are offset there.
    """
    least_area, step = min(settings.choice.company_area, settings.choice.least_area), settings.misfit.step
    least_points, grid = max(4, int(0.5 * least_area / step)), (shape[0], shape[1], shape[2])
    sheets = link_sheets(
        strong, grid, step=step, least_points=least_points, end_score=score_at_noise(settings.end_score, noise),
        settings=settings.link, room=room,
    )  # fmt: skip
    sheets = extend_sheets(sheets, weak, shape, settings=settings.extend, room=room)
    sheets = may_be_faults(sheets, 1 in shape[:2], settings.choice)
    leftovers = link_leftovers(
        sheets, weak, grid, step=step, least_points=least_points, link=settings.link, settings=settings.extend,
        room=room,
    )  # fmt: skip
    sheets += may_be_faults(leftovers, 1 in shape[:2], settings.choice)
    return offset_sheets(
        sheets, patch=(settings.scan.along_strike[0], settings.scan.along_dip[0]), settings=settings.cut
    )


def _find_ridges(
    found: Evidence,
    data: tuple[Float32Array, BoolArray],
    slopes: tuple[Float32Array, Float32Array],
    settings: FaultSettings,
    report: Progress,
) -> RidgePoints:
    """Scan the evidence of a cube in one piece, and thin it to crests that a fault may run along."""
    ridges = thin(scan_planes(found, settings=settings.scan, progress=report), found, least=0.0)
    if 1 in data[0].shape[:2]:
        return weigh_crests(*data, slopes, ridges, settings=settings.section)
    return leave_layers(ridges, slopes, settings.scan)


def _place_sheets(
    sheets: list[Sheet],
    data: tuple[Float32Array, BoolArray],
    slopes: tuple[Float32Array, Float32Array],
    settings: FaultSettings,
) -> list[Sheet]:
    """Move the sheets of a cube, of which amplitudes and where there are any are given, to where layers break."""
    return [
        place_sheet(
            sheet,
            *read_profile(*data, slopes, sheet, throw=settings.throw, settings=settings.place),
            settings=settings.place,
        )
        for sheet in sheets
    ]


def _measure_sheets(
    sheets: list[Sheet],
    data: tuple[Float32Array, BoolArray],
    slopes: tuple[Float32Array, Float32Array],
    noise: float,
    settings: FaultSettings,
    report: Progress,
) -> list[tuple[Sheet, SheetThrow]]:
    """Return what :func:`measure_moving` does for all sheets of a cube in one piece."""
    moving, shape = [], data[0].shape
    for number, sheet in enumerate(sheets):
        report("throw", number / len(sheets))
        off = farther_off(sheet, settings.throw)
        sides, beyond = (
            gather_sides(*data, slopes, part, settings=settings.throw, off=off)
            for part in (sheet, continue_sheet(sheet, shape[2]))
        )
        moving.append(measure_moving(sheet, sides, beyond, shape, noise, settings))
    return moving


def measure_moving(
    sheet: Sheet,
    sides: SheetSides,
    beyond: SheetSides,
    shape: tuple[int, ...],
    noise: float,
    settings: FaultSettings,
) -> tuple[Sheet, SheetThrow]:
    """Return what of a sheet moves its two sides, across their layers, and its throw, in a cube so large and noisy.

    Its sides are given, and what is read in the same way where it is continued beyond its ends.
    """
    measured = match_sides(sheet, sides.both, sides.known, settings=settings.throw)
    measured = replace(measured, runs_on=likeness_beyond(sheet, beyond))
    within = end_in_mutes(sheet, sides, shape)
    moving, throw = end_where_still(within, measured, sides, settings.choice, noise=noise)
    moving = end_along_layers(moving, throw, sides, settings.choice)
    moving = end_at_bends(moving, throw, sides, settings.choice)
    return moving, replace(throw, in_view=share_in_view(moving, throw.throw, shape))


def finish_throws(
    sheets: list[Sheet],
    found: list[SheetThrow],
    read_closer: Callable[[int], SheetSides],
    layers: LayerSlopes,
    settings: FaultSettings,
    *,
    is_section: bool,
) -> tuple[list[SheetThrow], list[SheetThrow]]:
    """Return the throws of faults as they seem today, refined, and when they moved; in a section the former alone.

    The sides of a fault are read by its number, close to it (:func:`~seismo3d.seismic.throw.gather_closer`).
    """
    today = [
        refine_throw(sheet, throw, read_closer(number), settings=settings.throw)
        for number, (sheet, throw) in enumerate(zip(sheets, found, strict=True))
    ]
    if is_section:
        return today, today
    return today, restore_throws(sheets, today, read_closer, layers, settings=settings.throw, history=settings.history)


def largest_first(
    sheets: list[Sheet], throws: list[SheetThrow], today: list[SheetThrow], shape: tuple[int, ...]
) -> tuple[list[Sheet], list[SheetThrow], list[SheetThrow]]:
    """Return sheets, their throws when they moved and what lies apart today in the order of their surfaces' areas."""
    order = order_by_area(sheets, shape)
    return [sheets[n] for n in order], [throws[n] for n in order], [today[n] for n in order]


def build_surfaces(
    sheets: list[Sheet],
    throws: list[SheetThrow],
    today: list[SheetThrow],
    shape: tuple[int, ...],
    geometry: SurveyGeometry | None,
    sampling: tuple[float, str],
) -> tuple[FaultSurface, ...]:
    """Turn sheets, with their throws when they moved and what lies apart today, into surfaces.

    Families are numbered from 1, in the order of their first surface.
    """
    first = dict.fromkeys(throw.family for throw in throws if throw.family >= 0)
    numbers = {-1: -1} | {family: number for number, family in enumerate(first, start=1)}
    throws = [replace(throw, family=numbers[throw.family]) for throw in throws]
    return tuple(
        build_surface(sheet, throw, now, to_likelihood(sheet.score), shape, geometry=geometry, sampling=sampling)
        for sheet, throw, now in zip(sheets, throws, today, strict=True)
    )


def _like(cube: Any, values: Any, name: str) -> Any:
    """Give a result the input's shape and, for a DataArray, its coordinates."""
    shaped = freeze(values.reshape(np.shape(cube)))
    if not hasattr(cube, "dims"):
        return shaped
    return cube.copy(data=shaped).rename(name)
