"""Cubes, sections and RGB-D sequences whose faults, horizons, surfaces and poses are known exactly."""

from __future__ import annotations

from seismo3d.synthetic.bodies import Channel
from seismo3d.synthetic.cubes import SyntheticCube, fault_cube, fault_section, make_cube
from seismo3d.synthetic.cutoffs import exact_displacement, places_before, present_slip
from seismo3d.synthetic.faulting import FaultPopulation, SyntheticFault, sample_faults
from seismo3d.synthetic.folding import Folding, sample_folding
from seismo3d.synthetic.noise import apply_agc, coloured_noise, migration_smiles
from seismo3d.synthetic.recipes import KINDS, CubeRecipe, recipe_of
from seismo3d.synthetic.rgbd import DepthNoise, RgbdFrame, RgbdSequence, rgbd_sequence
from seismo3d.synthetic.wavelets import ricker

__all__ = [
    "KINDS",
    "Channel",
    "CubeRecipe",
    "DepthNoise",
    "FaultPopulation",
    "Folding",
    "RgbdFrame",
    "RgbdSequence",
    "SyntheticCube",
    "SyntheticFault",
    "apply_agc",
    "coloured_noise",
    "exact_displacement",
    "fault_cube",
    "fault_section",
    "make_cube",
    "migration_smiles",
    "places_before",
    "present_slip",
    "recipe_of",
    "rgbd_sequence",
    "ricker",
    "sample_faults",
    "sample_folding",
]
