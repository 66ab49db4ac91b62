"""Reading and writing: SEG-Y, Zarr, NPY. Units are converted here and nowhere else."""
