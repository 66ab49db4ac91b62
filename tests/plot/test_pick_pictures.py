from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
from fake_faults import make_cube, make_faults
from matplotlib.figure import Figure

from seismo3d.plot.pick_pictures import picked_faults_map
from seismo3d.seismic.pick_scores import score_sticks
from seismo3d.seismic.sticks import cut_sticks

mpl.use("Agg")


def test_sticks_of_faults_outside_the_cube_are_not_drawn() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = cut_sticks(faults, cube)
    below = [replace(stick, fault="below", points=stick.points + np.array([0.0, 0.0, 1000.0])) for stick in own]
    ax = picked_faults_map(faults, own + below, score_sticks(faults, own + below), ax=Figure().add_subplot())
    found, missed = ax.collections[-2:]
    assert (len(found.get_paths()), len(missed.get_paths())) == (len(own), 0)
