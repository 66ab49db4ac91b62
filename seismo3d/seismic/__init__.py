"""Seismic interpretation: fault evidence, fault surfaces and their throws."""
