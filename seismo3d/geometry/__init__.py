"""Axes and survey geometry: index space, line numbers, and metres on the map."""
