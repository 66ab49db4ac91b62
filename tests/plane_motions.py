"""Motions of plane faults, whole and in parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seismo3d.seismic.fault_motion import FaultMotion, Frame, find_motion

ALONG_INLINES = Frame(np.array([0.0, 32.0]), np.array([0.0, 1.0]))
ALONG_CROSSLINES = Frame(np.array([32.0, 0.0]), np.array([1.0, 0.0]))


def plane_motion(frame, *, throw=10.0, cotangent=0.4, share=0.0, rows=64, samples=80, offset=None):
    """The motion of a plane that dips along `across`, its middle at sample 40; w is raised by an offset of its grid."""
    first_s = -63.0 if frame is ALONG_INLINES else 0.0
    w = np.broadcast_to(cotangent * (np.arange(samples) - 40.0), (rows, samples)).copy()
    if offset is not None:
        w += offset
    thin = np.full(w[::2, ::2].shape, throw, np.float32)
    return find_motion(
        frame, (first_s, 0.0), w, thin, np.ones_like(thin), hanging_side=1 if cotangent > 0 else -1, share=share,
        stiffness=300.0,
    )  # fmt: skip


def places(motion: FaultMotion, every: int = 2):
    rows, samples = (at.ravel() for at in np.meshgrid(*(np.arange(0, n, every) for n in motion.height.shape)))
    s = motion.first[0] + rows.astype(float)
    return motion.frame.place(s, motion.first[1] + samples, motion.height[rows, samples])


def in_parts(*, heave=6.0, cotangent=0.4):
    """One plane in two parts, along the strike one after the other, taken apart across it by a heave."""
    first = plane_motion(ALONG_INLINES, rows=30, cotangent=cotangent)
    moved = Frame(ALONG_INLINES.origin + np.array([0.0, heave]), ALONG_INLINES.across)
    second = plane_motion(moved, rows=30, cotangent=cotangent)
    return first, replace(second, first=(first.first[0] + 34.0, 0.0))


def beside(motion, traces):
    """The same fault, so many traces across."""
    return replace(motion, frame=Frame(motion.frame.origin + traces * motion.frame.across, motion.frame.across))


def taken_apart(young: FaultMotion, old: FaultMotion, *, overrun: float = 0.0):
    """The two parts of a plane that a fault of one throw has cut: the motion of each, and places on it.

    The part in the hanging wall goes on so many traces beyond the fault.
    """
    nodes = places(old)
    side = young.side(nodes)
    inner = nodes[side > 0.0]
    slip = (young.undo(inner) - inner).mean(axis=0)
    footwall, hanging = nodes[side <= 0.0], nodes[side > -overrun] - slip
    moved = replace(
        old, frame=Frame(old.frame.origin - slip[:2], old.frame.across), first=(old.first[0], old.first[1] - slip[2])
    )
    return (old, moved), (footwall, hanging)
