"""What the compiled kernels are made of below the equations: memory, fused multiply-add, sine and cosine.

Imported with Numba, that is only when the first compiled kernel is asked for.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from hingepair.evaluation.kernel_rows import LANES

FLAGS = {"contract", "nsz"}
"""Fast-math flags: a * b + c may be fused, and -0 may be 0. Nothing may be reordered, and NaN stays NaN."""

_REACH = 1e6  # up to here the three parts of pi/2 reduce an angle without loss
_TO_QUADRANTS = 0.6366197723675814  # 2/pi
_MAGIC = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to an integer, which then stands in the low bits
_PART1, _PART2, _PART3 = 1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33  # pi/2

# Minimax polynomials in r^2 on [0, (pi/4)^2], highest power first: (sin r / r - 1) / r^2 with a relative error of
# 2e-17 and (cos r - 1 + r^2/2) / r^4 with one of 1.3e-18.
_S6, _S5, _S4 = 1.5918115263265974e-10, -2.505113165023518e-08, 2.7557316101617874e-06
_S3, _S2, _S1 = -0.00019841269836756774, 0.008333333333330948, -0.16666666666666666
_C6, _C5, _C4 = -1.1382623647474604e-11, 2.087614614655861e-09, -2.7557317271145144e-07
_C3, _C2, _C1 = 2.480158729876456e-05, -0.0013888888888887398, 0.041666666666666664


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """The sum a * b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


def _float_bits(typing_context: Any, x: Any) -> Any:
    """The bits of a float64 as an int64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


fma: Any = intrinsic(_fma)
float_bits: Any = intrinsic(_float_bits)


@njit(fastmath=FLAGS, forceinline=True)
def sines(s: Any, angle: int, out: int) -> None:
    """Sine, cosine and 1 - cosine of one row of angles, in three rows; to 1.5 ulp, the last to 2.5.

    The angle is reduced by the nearest multiple of pi/2, in three parts; the quadrant picks polynomial and sign.
    Lanes with an angle past 1e6, or none at all (inf, NaN), are computed again one by one.
    """
    far = False
    for k in range(LANES):
        x = types.float64(s[angle + k])
        shifted = x * _TO_QUADRANTS + _MAGIC
        quadrant = float_bits(shifted)
        multiple = shifted - _MAGIC
        r = fma(-multiple, _PART3, fma(-multiple, _PART2, fma(-multiple, _PART1, x)))
        z = r * r
        p = fma(z, fma(z, fma(z, fma(z, fma(z, _S6, _S5), _S4), _S3), _S2), _S1)
        q = fma(z, fma(z, fma(z, fma(z, fma(z, _C6, _C5), _C4), _C3), _C2), _C1)
        small = fma(r * z, p, r)
        drop = fma(-z * z, q, 0.5 * z)
        large = 1.0 - drop
        odd = (quadrant & 1) != 0
        sin = large if odd else small
        cos = small if odd else large
        sin = -sin if (quadrant & 2) != 0 else sin
        cos = -cos if ((quadrant + 1) & 2) != 0 else cos
        s[out + k] = sin
        s[out + LANES + k] = cos
        s[out + 2 * LANES + k] = drop if (quadrant & 3) == 0 else 1.0 - cos
        far |= not abs(x) <= _REACH
    if far:
        for k in range(LANES):
            x = types.float64(s[angle + k])
            if not abs(x) <= _REACH:
                half = math.sin(0.5 * x)
                s[out + k] = math.sin(x)
                s[out + LANES + k] = math.cos(x)
                s[out + 2 * LANES + k] = 2.0 * half * half
