"""Multiplication and addition in one rounding, so that a kernel is fast and yet gives the same bits wherever it runs.

Compilers that may contract or reorder sums ("fast maths") choose anew for every context: the same loop then differs in
the last bit between two array layouts, between a kernel just compiled and one from the cache, and between a loop's
vector part and its rest. Kernels here leave fast maths off and say where a product is fused with a sum.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic, overload


def multiply_add(a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once in compiled kernels, for three numbers of one floating type."""
    return a * b + c


@intrinsic
def _fused(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        del context, signature
        return builder.fma(*arguments)

    return (a(a, b, c), generate) if isinstance(a, types.Float) and a == b == c else None


@overload(multiply_add, inline="always")
def _compile_multiply_add(a, b, c):  # type: ignore[no-untyped-def]
    del a, b, c

    def fuse(a, b, c):  # type: ignore[no-untyped-def]
        return _fused(a, b, c)  # type: ignore[call-arg]

    return fuse
