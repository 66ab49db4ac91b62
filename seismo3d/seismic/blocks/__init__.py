"""Fault tracing in blocks: cubes larger than memory, in threads or on a cluster, resumed where they were stopped."""
