"""LLVM functions for sines and cosines of vectors, and for what the C library computes lane by lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm_writer import LANES, Function, hexadecimal, shared_name

SINES: Final = ("sin", "cos", "versine")  # in the order in which they are returned
DOUBLES: Final = f"<{LANES} x double>"

_MAX_ANGLE: Final = 1e6  # [rad] up to here the three parts of pi/2 reduce an angle without loss
_ROUNDING: Final = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to an integer, which stands in the low bits
_HALF_PI: Final = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
# Minimax polynomials in r^2 on [0, (pi/4)^2], highest power first: (sin r / r - 1) / r^2 with a relative error of
# 2e-17 and (cos r - 1 + r^2/2) / r^4 with one of 1.3e-18.
_SIN_COEFFS: Final = (
    *(1.5918115263265974e-10, -2.505113165023518e-08, 2.7557316101617874e-06),
    *(-0.00019841269836756774, 0.008333333333330948, -0.16666666666666666),
)
_COS_COEFFS: Final = (
    *(-1.1382623647474604e-11, 2.087614614655861e-09, -2.7557317271145144e-07),
    *(2.480158729876456e-05, -0.0013888888888887398, 0.041666666666666664),
)
_TWO_OVER_PI: Final = 0.6366197723675814
_CONSTANTS: Final = (*_HALF_PI, *_SIN_COEFFS, *_COS_COEFFS, _TWO_OVER_PI, _ROUNDING, 0.5, 1.0, _MAX_ANGLE)


SINE_PARAMETERS: Final = {"sines": "ptr noalias %frame, ptr noalias %slots, i64 %count, ptr noalias %to"}
"""Parameters of the functions that kernels call."""


def sine_functions(number: str) -> list[str]:
    """Return the functions that compute sines of vectors of a type, "double" or "float"."""
    return [_DECLARED, _constants(), _sines(number), _far()]


_DECLARED: Final = f"""declare {DOUBLES} @llvm.fma.v{LANES}f64({DOUBLES}, {DOUBLES}, {DOUBLES})
declare {DOUBLES} @llvm.fabs.v{LANES}f64({DOUBLES})
declare double @llvm.fabs.f64(double)
declare double @sin(double)
declare double @cos(double)"""


def _constants() -> str:
    """Return the table of the constants, and a variable that points to it.

    LLVM does not know what a variable holds, and so loads each constant where it is used, in the same instruction. Of
    constants in the code it would load the addresses first, and keep all of them in registers that there are not.
    """
    numbers = ", ".join(f"double {hexadecimal(number)}" for number in _CONSTANTS)
    table = f"@constants = internal constant [{len(_CONSTANTS)} x double] [{numbers}], align 64"
    return f"{table}\n@constants.address = internal global ptr @constants"


def _sines(number: str) -> str:
    """Write the function that computes sine, cosine and 1 - cosine of angles, to 1.5 ulp, the last to 2.5.

    The angles are the vectors of a frame whose numbers stand in `slots`; the results lie one behind the other. An
    angle is reduced by the nearest multiple of pi/2, in three parts; the quadrant picks polynomial and sign. Vectors
    with an angle past the largest one, or with none at all (inf, NaN), are computed again lane by lane.
    """
    size = 8 if number == "double" else 4
    vector = f"<{LANES} x {number}>"
    f = Function(f"void {shared_name('sines', number)}({SINE_PARAMETERS['sines']})")
    scratch = f.put(f"alloca [4 x {DOUBLES}], align 64")
    f.do("%constants = load ptr, ptr @constants.address, align 8")
    with f.loop("%count") as k:
        place = f.step("%frame", f.product(f.entry("%slots", k), LANES * size))
        x = f.put(f"load {vector}, ptr {place}, align {LANES * size}")
        if size == 4:
            x = f.put(f"fpext {vector} {x} to {DOUBLES}")
        target = f.step("%to", f.product(k, len(SINES) * LANES * size))
        terms = _near(f, x)
        _keep(f, number, terms, target)
        absolute = f.put(f"call {DOUBLES} @llvm.fabs.v{LANES}f64({DOUBLES} {x})")
        inside = f.put(f"fcmp ole {DOUBLES} {absolute}, {_constant(f, _MAX_ANGLE)}")
        bits = f.put(f"bitcast <{LANES} x i1> {inside} to i{LANES}")
        with f.when(f.put(f"icmp ne i{LANES} {bits}, -1")):
            places = [f.step(scratch, 8 * LANES * j) for j in range(4)]
            for term, place in zip((x, *terms), places, strict=True):
                f.do(f"store {DOUBLES} {term}, ptr {place}, align 64")
            f.do(f"call void @far(ptr {scratch})")
            corrected = [f.put(f"load {DOUBLES}, ptr {place}, align 64") for place in places[1:]]
            _keep(f, number, corrected, target)
    f.do("ret void")
    return f.text()


def _keep(f: Function, number: str, terms: Sequence[str], target: str) -> None:
    """Write the stores of vectors of double precision, one behind the other, as numbers of a type."""
    size, vector = (8 if number == "double" else 4), f"<{LANES} x {number}>"
    for j, term in enumerate(terms):
        one = term if size == 8 else f.put(f"fptrunc {DOUBLES} {term} to {vector}")
        f.do(f"store {vector} {one}, ptr {f.step(target, LANES * size * j)}, align {LANES * size}")


def _constant(f: Function, number: float) -> str:
    """Write the load of a constant into all lanes."""
    one = f.put(f"load double, ptr {f.step('%constants', 8 * _CONSTANTS.index(number))}, align 8")
    return f.splat(DOUBLES, f"double {one}")


def _near(f: Function, x: str) -> tuple[str, str, str]:
    """Write the computation of sine, cosine and 1 - cosine of angles that are not too large."""
    put = f.put
    integers = f"<{LANES} x i64>"

    def constant(number: float) -> str:
        return _constant(f, number)

    def fma(a: str, b: str, c: str) -> str:
        return put(f"call {DOUBLES} @llvm.fma.v{LANES}f64({DOUBLES} {a}, {DOUBLES} {b}, {DOUBLES} {c})")

    def polynomial(z: str, coefficients: Sequence[float]) -> str:
        value = constant(coefficients[0])
        for c in coefficients[1:]:
            value = fma(z, value, constant(c))
        return value

    def bit(mask: int, quadrant: str) -> str:
        return put(f"icmp ne {integers} {put(f'and {integers} {quadrant}, splat (i64 {mask})')}, zeroinitializer")

    def pick(condition: str, a: str, b: str) -> str:
        return put(f"select <{LANES} x i1> {condition}, {DOUBLES} {a}, {DOUBLES} {b}")

    shifted = fma(x, constant(_TWO_OVER_PI), constant(_ROUNDING))
    quadrant = put(f"bitcast {DOUBLES} {shifted} to {integers}")
    back = put(f"fsub {DOUBLES} {constant(_ROUNDING)}, {shifted}")
    r = x
    for part in _HALF_PI:
        r = fma(back, constant(part), r)
    z = put(f"fmul {DOUBLES} {r}, {r}")
    small = fma(put(f"fmul {DOUBLES} {r}, {z}"), polynomial(z, _SIN_COEFFS), r)
    square = put(f"fneg {DOUBLES} {put(f'fmul {DOUBLES} {z}, {z}')}")
    drop = fma(square, polynomial(z, _COS_COEFFS), put(f"fmul {DOUBLES} {z}, {constant(0.5)}"))
    large = put(f"fsub {DOUBLES} {constant(1.0)}, {drop}")
    odd = bit(1, quadrant)
    sine, cosine = pick(odd, large, small), pick(odd, small, large)
    sine = pick(bit(2, quadrant), put(f"fneg {DOUBLES} {sine}"), sine)
    turned = put(f"add {integers} {quadrant}, splat (i64 1)")
    cosine = pick(bit(2, turned), put(f"fneg {DOUBLES} {cosine}"), cosine)
    rest = put(f"fsub {DOUBLES} {constant(1.0)}, {cosine}")
    return sine, cosine, pick(bit(3, quadrant), rest, drop)


def _far() -> str:
    """Write the function that computes the lanes of large angles again by the C library: its results follow them."""
    f = Function("internal void @far(ptr %angles) noinline cold")
    with f.loop(str(LANES)) as k:
        place = f.step("%angles", f.product(k, 8))
        x = f.put(f"load double, ptr {place}")
        absolute = f.put(f"call double @llvm.fabs.f64(double {x})")
        with f.when(f.put(f"fcmp ugt double {absolute}, {hexadecimal(_MAX_ANGLE)}")):
            sine, cosine = (f.put(f"call double @{name}(double {x})") for name in ("sin", "cos"))
            half = f.put(f"call double @sin(double {f.put(f'fmul double {x}, {hexadecimal(0.5)}')})")
            square = f.put(f"fmul double {half}, {half}")
            for j, term in enumerate((sine, cosine, f.put(f"fadd double {square}, {square}")), 1):
                f.do(f"store double {term}, ptr {f.step(place, 8 * LANES * j)}")
    f.do("ret void")
    return f.text()


def lanewise_function(name: str) -> str:
    """Return a function that calls one of the C library, of two arguments, for each lane."""
    f = Function(f"internal {DOUBLES} @lanes.{name}({DOUBLES} %a, {DOUBLES} %b) noinline")
    value = "poison"
    for k in range(LANES):
        x, y = (f.put(f"extractelement {DOUBLES} {v}, i32 {k}") for v in ("%a", "%b"))
        one = f.put(f"call double @{name}(double {x}, double {y})")
        value = f.put(f"insertelement {DOUBLES} {value}, double {one}, i32 {k}")
    f.do(f"ret {DOUBLES} {value}")
    return f"declare double @{name}(double, double)\n\n{f.text()}"
