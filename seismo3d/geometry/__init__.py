"""Geometry that all sides share: axes and survey geometry, rotations and rigid motions."""
