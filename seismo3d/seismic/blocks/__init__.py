"""Fault tracing in blocks: cubes larger than memory, in this process or on a cluster, resumed where they were stopped.

What follows from the whole cube (amplitudes, wavelet, noise, mean, spread and medians of the evidence) is found in
passes of its own, with sums and counts that no cut changes, so that blocks give the bits that one piece gives.

Held of the whole cube at a time, at most: about 25 bytes for each ridge point, strong or weak, that sheets are grown or
followed along, and a byte for every 32 voxels while surfaces are linked; about 700 bytes for each place (trace along
strike and sample) of the one surface whose throw is measured; and the surfaces themselves, which are the result.
"""
