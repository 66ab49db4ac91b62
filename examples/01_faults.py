"""Trace the faults of a cube: open it, trace, look, and export.

Run it as a script, or cell by cell. It makes its own cube; give the name of a SEG-Y file to use that instead:
``python 01_faults.py CUBE.sgy``. Results go to the folder ``faults-example``.
"""

# %%
import sys
from pathlib import Path

import matplotlib.pyplot as plt

import seismo3d as s3
from seismo3d.errors import RenderError
from seismo3d.seismic.exports import write_faults
from seismo3d.seismic.fault_table import tabulate_faults

out = Path("faults-example")
out.mkdir(exist_ok=True)

# %% A cube to work on: a synthetic one with known faults, written to disk as SEG-Y like any other file.
if len(sys.argv) > 1:
    path = Path(sys.argv[1])
else:
    path = out / "cube.sgy"
    made = s3.synthetic.fault_cube("clean", seed=1, shape=(96, 112, 128))
    s3.write_segy(path, made.to_dataarray(), like=None, title="seismo3d example")

# %% Open it: dims inline, crossline and time; lazy where it is large.
cube = s3.open_cube(path)
print(cube.sizes, float(cube.time[0]), "to", float(cube.time[-1]), "ms")

# %% Trace. No setting needs tuning.
faults = s3.trace_faults(cube)
print(f"{len(faults.surfaces)} faults, {float((faults.labels > 0).mean()):.2%} of all voxels")

# %% The numbers of each fault.
for row in tabulate_faults(faults, cube):
    print(
        f"{row['fault']:3d}  strike {row['strike_deg']:5.0f}  dip {row['dip_deg']:3.0f}  "
        f"throw {row['throw_mean_samples']:6.1f} samples, {row['kind']}, confidence {row['confidence']:.2f}"
    )

# %% Look at a section and a time slice.
fig, (left, right) = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
middle = int(cube.inline[cube.sizes["inline"] // 2])
s3.plot.section(cube, inline=middle, faults=faults, colour="throw", ax=left)
s3.plot.time_slice(cube, faults=faults, ax=right)
fig.savefig(out / "slices.png", dpi=100)
plt.close(fig)

# %% The same in 3D, drawn without a window. In a notebook: s3.plot.cube(cube, faults=faults).show()
try:
    s3.plot.save_scene(out / "scene.png", cube, faults=faults)
except RenderError as error:
    print("no 3D picture:", error)

# %% Export for OpendTect, Petrel, GOCAD and ParaView, and keep everything for later.
for file in write_faults(faults, cube, directory=out):
    print(file)
faults.save(out)

# %% Likelihood as SEG-Y, on the geometry and headers of the input.
s3.write_segy(out / "likelihood.sgy", cube.copy(data=faults.likelihood.data))
