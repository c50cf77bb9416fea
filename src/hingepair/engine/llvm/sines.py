"""LLVM functions for sines and cosines of vectors, and for functions that the C library computes lane by lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm.builder import LANES, NUMBER_BYTES, FunctionBuilder, hexadecimal, shared_name
from hingepair.numeric.blocks import VERSINE_SWITCH

SINES: Final = ("sin", "cos", "versine")  # operations, in the order in which the function `sines` stores them
DOUBLES: Final = f"<{LANES} x double>"  # LLVM's type of a vector of doubles

_REDUCIBLE: Final = 1e6  # rad, up to which the three parts of pi/2 reduce an angle without loss
_ROUNDER: Final = 6755399441055744.0  # 1.5 * 2^52: a sum with it is rounded to an integer, in the low bits
_HALF_PI: Final = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)  # whose sum is pi/2
_TWO_OVER_PI: Final = 0.6366197723675814
# Minimax polynomials in r^2 on [0, (pi/4)^2], highest power first.
_SIN_REST: Final = (  # (sin r - r) / r^3 with a relative error of 2e-17
    *(1.5918115263265974e-10, -2.505113165023518e-08, 2.7557316101617874e-06),
    *(-0.00019841269836756774, 0.008333333333330948, -0.16666666666666666),
)
_COS_REST: Final = (  # (cos r - 1 + r^2/2) / r^4 with one of 1.3e-18
    *(-1.1382623647474604e-11, 2.087614614655861e-09, -2.7557317271145144e-07),
    *(2.480158729876456e-05, -0.0013888888888887398, 0.041666666666666664),
)
_TABLE: Final = (*_HALF_PI, *_SIN_REST, *_COS_REST, _TWO_OVER_PI, _ROUNDER, 0.5, 1.0, _REDUCIBLE)  # in memory

SINE_FUNCTIONS: Final = {"sines": "ptr noalias %frame, ptr noalias %slots, i64 %count, ptr noalias %to"}
"""Parameters, by name, of the functions that kernels call for sine, cosine and 1 - cosine."""

# What the functions call.
_DECLARATIONS: Final = f"""
declare {DOUBLES} @llvm.fma.v{LANES}f64({", ".join(3 * [DOUBLES])})
declare {DOUBLES} @llvm.fabs.v{LANES}f64({DOUBLES})
declare double @llvm.fabs.f64(double)
declare double @sin(double)
declare double @cos(double)"""


def sine_functions(float_type: str) -> list[str]:
    """Return LLVM code that computes sine, cosine and 1 - cosine of vectors of type "double" or "float"."""
    numbers = ", ".join(f"double {hexadecimal(number)}" for number in _TABLE)
    # LLVM cannot know the content of a variable, and so loads each constant in the instruction that uses it. Of
    # constants in the code it would load the addresses first, keep all of them in registers, and spill.
    table = [
        f"@constants = internal constant [{len(_TABLE)} x double] [{numbers}], align 64",
        "@constants.address = internal global ptr @constants",
    ]
    return [_DECLARATIONS, *table, _sines(float_type), _large_angles()]


def _sines(float_type: str) -> str:
    """Return the function `sines`, which stores sine, cosine and 1 - cosine of each vector of angles [rad], one
    behind the other. Sine and cosine are right to 1.5 ulp, 1 - cosine to 3.5 ulp.

    The angles are the vectors of a frame whose slots are in `slots`. An angle is reduced by the nearest multiple of
    pi/2, in three parts; the quadrant selects polynomial and sign.
    """
    size, vector = NUMBER_BYTES[float_type], f"<{LANES} x {float_type}>"
    f = FunctionBuilder(f"void {shared_name('sines', float_type)}({SINE_FUNCTIONS['sines']})")
    scratch = f.put(f"alloca [4 x {DOUBLES}], align 64")
    f.do("%constants = load ptr, ptr @constants.address, align 8")
    with f.loop("%count") as k:
        place = f.pointer_at("%frame", f.multiply(f.load_entry("%slots", k), LANES * size))
        x = f.put(f"load {vector}, ptr {place}, align {LANES * size}")
        if size == 4:
            x = f.put(f"fpext {vector} {x} to {DOUBLES}")
        target = f.pointer_at("%to", f.multiply(k, len(SINES) * LANES * size))
        terms = _reduced_sines(f, x)
        _store_terms(f, float_type, terms, target)
        # A vector with an angle beyond what is reduced here, inf or NaN is computed again lane by lane.
        absolute = f.put(f"call {DOUBLES} @llvm.fabs.v{LANES}f64({DOUBLES} {x})")
        inside = f.put(f"fcmp ole {DOUBLES} {absolute}, {_constant(f, _REDUCIBLE)}")
        bits = f.put(f"bitcast <{LANES} x i1> {inside} to i{LANES}")
        with f.when(f.put(f"icmp ne i{LANES} {bits}, -1")):
            places = [f.pointer_at(scratch, 8 * LANES * j) for j in range(4)]
            for term, place in zip((x, *terms), places, strict=True):
                f.do(f"store {DOUBLES} {term}, ptr {place}, align 64")
            f.do(f"call void @far(ptr {scratch})")
            corrected = [f.put(f"load {DOUBLES}, ptr {place}, align 64") for place in places[1:]]
            _store_terms(f, float_type, corrected, target)
    f.do("ret void")
    return f.text()


def _store_terms(f: FunctionBuilder, float_type: str, terms: Sequence[str], target: str) -> None:
    """Store vectors of doubles one behind the other, as numbers of this type."""
    size, vector = NUMBER_BYTES[float_type], f"<{LANES} x {float_type}>"
    for j, term in enumerate(terms):
        one = term if size == 8 else f.put(f"fptrunc {DOUBLES} {term} to {vector}")
        f.do(f"store {vector} {one}, ptr {f.pointer_at(target, LANES * size * j)}, align {LANES * size}")


def _constant(f: FunctionBuilder, number: float) -> str:
    """Load a constant from the table into all lanes of a vector."""
    one = f.put(f"load double, ptr {f.pointer_at('%constants', 8 * _TABLE.index(number))}, align 8")
    return f.splat(DOUBLES, f"double {one}")


def _reduced_sines(f: FunctionBuilder, x: str) -> tuple[str, str, str]:
    """Compute sine, cosine and 1 - cosine of a vector of angles [rad] up to `_REDUCIBLE`."""
    put, integers = f.put, f"<{LANES} x i64>"

    def fma(a: str, b: str, c: str) -> str:
        return put(f"call {DOUBLES} @llvm.fma.v{LANES}f64({', '.join(f'{DOUBLES} {one}' for one in (a, b, c))})")

    def polynomial(z: str, coefficients: Sequence[float]) -> str:
        """Append Horner's scheme."""
        value = _constant(f, coefficients[0])
        for c in coefficients[1:]:
            value = fma(z, value, _constant(f, c))
        return value

    def bit(mask: int, quadrant: str) -> str:
        return put(f"icmp ne {integers} {put(f'and {integers} {quadrant}, splat (i64 {mask})')}, zeroinitializer")

    def pick(condition: str, a: str, b: str) -> str:
        return put(f"select <{LANES} x i1> {condition}, {DOUBLES} {a}, {DOUBLES} {b}")

    shifted = fma(x, _constant(f, _TWO_OVER_PI), _constant(f, _ROUNDER))
    quadrant = put(f"bitcast {DOUBLES} {shifted} to {integers}")
    back = put(f"fsub {DOUBLES} {_constant(f, _ROUNDER)}, {shifted}")
    r = x
    for part in _HALF_PI:
        r = fma(back, _constant(f, part), r)
    z = put(f"fmul {DOUBLES} {r}, {r}")
    small = fma(put(f"fmul {DOUBLES} {r}, {z}"), polynomial(z, _SIN_REST), r)
    square = put(f"fneg {DOUBLES} {put(f'fmul {DOUBLES} {z}, {z}')}")
    drop = fma(square, polynomial(z, _COS_REST), put(f"fmul {DOUBLES} {z}, {_constant(f, 0.5)}"))
    large = put(f"fsub {DOUBLES} {_constant(f, 1.0)}, {drop}")
    odd = bit(1, quadrant)
    sine, cosine = pick(odd, large, small), pick(odd, small, large)
    sine = pick(bit(2, quadrant), put(f"fneg {DOUBLES} {sine}"), sine)
    turned = put(f"add {integers} {quadrant}, splat (i64 1)")
    cosine = pick(bit(2, turned), put(f"fneg {DOUBLES} {cosine}"), cosine)
    rest = put(f"fsub {DOUBLES} {_constant(f, 1.0)}, {cosine}")
    return sine, cosine, pick(bit(3, quadrant), rest, drop)


def _large_angles() -> str:
    """Return the function `far`, which stores terms of large angles, inf and NaN, by the C library, behind them."""
    f = FunctionBuilder("internal void @far(ptr %angles) noinline cold")
    with f.loop(str(LANES)) as k:
        place = f.pointer_at("%angles", f.multiply(k, 8))
        x = f.put(f"load double, ptr {place}")
        absolute = f.put(f"call double @llvm.fabs.f64(double {x})")
        with f.when(f.put(f"fcmp ugt double {absolute}, {hexadecimal(_REDUCIBLE)}")):
            sine, cosine = (f.put(f"call double @{name}(double {x})") for name in ("sin", "cos"))
            # 1 - cosine as NumPy computes it: the square of a half angle's sine is less accurate near 1 - cosine = 2.
            square, above = f.put(f"fmul double {sine}, {sine}"), f.put(f"fadd double {cosine}, {hexadecimal(1.0)}")
            near, far = f.put(f"fdiv double {square}, {above}"), f.put(f"fsub double {hexadecimal(1.0)}, {cosine}")
            limit = hexadecimal(VERSINE_SWITCH)
            is_near = f.put(f"fcmp ogt double {cosine}, {limit}")
            versine = f.put(f"select i1 {is_near}, double {near}, double {far}")
            for j, term in enumerate((sine, cosine, versine), 1):
                f.do(f"store double {term}, ptr {f.pointer_at(place, 8 * LANES * j)}")
    f.do("ret void")
    return f.text()


def lanewise_function(name: str) -> str:
    """Return a function `lanes.NAME`, which applies one of the C library, of two doubles, to each lane."""
    f = FunctionBuilder(f"internal {DOUBLES} @lanes.{name}({DOUBLES} %a, {DOUBLES} %b) noinline")
    value = "poison"
    for k in range(LANES):
        x, y = (f.put(f"extractelement {DOUBLES} {v}, i32 {k}") for v in ("%a", "%b"))
        one = f.put(f"call double @{name}(double {x}, double {y})")
        value = f.put(f"insertelement {DOUBLES} {value}, double {one}, i32 {k}")
    f.do(f"ret {DOUBLES} {value}")
    return f"declare double @{name}(double, double)\n\n{f.text()}"
