from __future__ import annotations

import os
import signal
import sys

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, MissingDependencyError, ParameterError
from seismo3d.seismic.blocks.plan import plan_blocks
from seismo3d.seismic.blocks.scheduling import OnCluster
from seismo3d.seismic.blocks.tracing import trace_in_blocks
from seismo3d.seismic.faults import FaultSettings, trace_faults
from seismo3d.synthetic import SyntheticFault, fault_cube

distributed = pytest.importorskip("distributed")


def test_a_cluster_gives_the_same_though_a_worker_dies(tmp_path):
    fault = SyntheticFault((26.0, 26.0, 32.0), 40.0, 65.0, 8.0)
    cube = fault_cube("clean", seed=7, shape=(52, 60, 64), wavelength=(14.0, 14.0), population=None, faults=(fault,))
    settings = FaultSettings()
    plan = plan_blocks(cube.seismic.shape, 10**9, settings, edge=32)
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    killed = []

    with distributed.LocalCluster(processes=True, **options) as local:
        with distributed.Client(local.scheduler_address, set_as_default=False) as client:
            workers = list(client.run(os.getpid).values())

        def kill_one(stage, share):
            if stage == "dip" and share > 0.0 and not killed:
                killed.append(workers[0])
                os.kill(workers[0], signal.SIGKILL)

        with OnCluster(local.scheduler_address) as cluster:
            assert cluster.n_workers == 2
            found = trace_in_blocks(
                cube.seismic, plan, settings, folder=tmp_path / "run", scheduler=cluster, progress=kill_one
            )
    assert killed
    wanted = trace_faults(cube.seismic)
    for name in ("likelihood", "labels", "throw"):
        np.testing.assert_array_equal(np.asarray(getattr(found, name)), getattr(wanted, name))


def test_a_cluster_that_does_not_answer_is_one_clear_error(monkeypatch):
    monkeypatch.setattr("seismo3d.seismic.blocks.scheduling._ANSWER_S", "1s")
    with pytest.raises(FileAccessError, match=r"no dask scheduler answers at tcp://127\.0\.0\.1:9"):
        OnCluster("tcp://127.0.0.1:9")


@pytest.mark.parametrize("address", ["node1", "tcp://node1", "htp://node1:8786", "", 8786])
def test_what_is_no_address_is_refused_before_a_client_is_made(address):
    with pytest.raises(ParameterError, match=r"scheduler is .*; expected an address such as tcp://node1:8786"):
        OnCluster(address)


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'seismo3d\[cluster\]'"):
        OnCluster("tcp://127.0.0.1:8786")
