"""Experiments that anyone can run: the paper's tables and figures, and the measurements behind the documentation."""
