"""LLVM functions for sines and cosines of vectors, and for functions that the C library computes lane by lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm_builder import LANE_COUNT, FunctionBuilder, hexadecimal, shared_name
from hingepair.numeric.blocks import MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE

SINE_OPERATION_NAMES: Final = ("sin", "cos", "versine")  # in the order in which the function stores its results
DOUBLE_VECTOR_TYPE: Final = f"<{LANE_COUNT} x double>"  # LLVM's type of a vector of doubles, one for each lane

_MAX_REDUCIBLE_ANGLE_RAD: Final = 1e6  # [rad] up to which the three parts of pi/2 reduce an angle without loss
_ADDEND_THAT_ROUNDS_DOUBLE_TO_INTEGER: Final = 6755399441055744.0  # 1.5 * 2^52; the integer is in the low bits
_HALF_PI_SUMMANDS: Final = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)  # their sum is pi/2
# Minimax polynomials in r^2 on [0, (pi/4)^2], highest power first: (sin r - r) / r^3 with a relative error of 2e-17
# and (cos r - 1 + r^2/2) / r^4 with one of 1.3e-18.
_SIN_CUBIC_REMAINDER_COEFFS_HIGHEST_FIRST: Final = (
    *(1.5918115263265974e-10, -2.505113165023518e-08, 2.7557316101617874e-06),
    *(-0.00019841269836756774, 0.008333333333330948, -0.16666666666666666),
)
# Coefficients of the second polynomial, highest power first.
_COS_QUARTIC_REMAINDER_COEFFS_HIGHEST_FIRST: Final = (
    *(-1.1382623647474604e-11, 2.087614614655861e-09, -2.7557317271145144e-07),
    *(2.480158729876456e-05, -0.0013888888888887398, 0.041666666666666664),
)
_TWO_OVER_PI: Final = 0.6366197723675814  # quarter turns per radian
_SINE_FUNCTION_CONSTANTS: Final = (
    *_HALF_PI_SUMMANDS,
    *_SIN_CUBIC_REMAINDER_COEFFS_HIGHEST_FIRST,
    *_COS_QUARTIC_REMAINDER_COEFFS_HIGHEST_FIRST,
    _TWO_OVER_PI,
    _ADDEND_THAT_ROUNDS_DOUBLE_TO_INTEGER,
    0.5,
    1.0,
    _MAX_REDUCIBLE_ANGLE_RAD,
)
"""All constants of the generated sines, in the order of their table in memory."""


LLVM_PARAMETER_LIST_BY_SINE_FUNCTION_NAME: Final = {
    "sines": "ptr noalias %frame, ptr noalias %slots, i64 %count, ptr noalias %to"
}
"""Parameter list (LLVM IR) of each sine function that kernels call, by its name."""


def sine_functions(float_type: str) -> list[str]:
    """Return a list of LLVM code, declarations and functions, that computes sine, cosine and 1 - cosine of vectors of
    type "double" or "float".
    """
    return [
        _LLVM_DECLARATIONS_FOR_SINE_FUNCTIONS,
        _constants_table(),
        _sines_function(float_type),
        _large_angles_function(),
    ]


# Declarations of the functions that the generated sines call.
_LLVM_DECLARATIONS_FOR_SINE_FUNCTIONS: Final = f"""
declare {DOUBLE_VECTOR_TYPE} @llvm.fma.v{LANE_COUNT}f64({", ".join(3 * [DOUBLE_VECTOR_TYPE])})
declare {DOUBLE_VECTOR_TYPE} @llvm.fabs.v{LANE_COUNT}f64({DOUBLE_VECTOR_TYPE})
declare double @llvm.fabs.f64(double)
declare double @sin(double)
declare double @cos(double)"""


def _constants_table() -> str:
    """Return the LLVM definitions, as text, of the table of constants that the sines use and of a global variable
    that points to the table.

    LLVM cannot know the content of a variable, and so loads each constant in the instruction that uses it. For
    constants in the code, LLVM would load the addresses first and keep all of them in registers, which would spill.
    """
    numbers = ", ".join(f"double {hexadecimal(number)}" for number in _SINE_FUNCTION_CONSTANTS)
    table = f"@constants = internal constant [{len(_SINE_FUNCTION_CONSTANTS)} x double] [{numbers}], align 64"
    return f"{table}\n@constants.address = internal global ptr @constants"


def _sines_function(float_type: str) -> str:
    """Return the LLVM code of the function `sines`, which stores sine, cosine and 1 - cosine of each vector of angles
    [rad], one behind the other, for numbers of type "double" or "float".

    Sine and cosine are right to 1.5 ulp, 1 - cosine to 3.5 ulp.

    The angles are the vectors of a frame whose slot numbers are in `slots`. An angle is reduced by the nearest
    multiple of pi/2, in three parts; the quadrant selects polynomial and sign. Vectors with an angle beyond
    `_MAX_REDUCIBLE_ANGLE_RAD`, inf or NaN are computed again lane by lane.
    """
    size = 8 if float_type == "double" else 4
    vector = f"<{LANE_COUNT} x {float_type}>"
    f = FunctionBuilder(
        f"void {shared_name('sines', float_type)}({LLVM_PARAMETER_LIST_BY_SINE_FUNCTION_NAME['sines']})"
    )
    scratch = f.put(f"alloca [4 x {DOUBLE_VECTOR_TYPE}], align 64")
    f.do("%constants = load ptr, ptr @constants.address, align 8")
    with f.loop("%count") as k:
        place = f.pointer_at("%frame", f.multiply(f.load_entry("%slots", k), LANE_COUNT * size))
        x = f.put(f"load {vector}, ptr {place}, align {LANE_COUNT * size}")
        if size == 4:
            x = f.put(f"fpext {vector} {x} to {DOUBLE_VECTOR_TYPE}")
        target = f.pointer_at("%to", f.multiply(k, len(SINE_OPERATION_NAMES) * LANE_COUNT * size))
        terms = _write_reduced_sines(f, x)
        _store_terms(f, float_type, terms, target)
        absolute = f.put(f"call {DOUBLE_VECTOR_TYPE} @llvm.fabs.v{LANE_COUNT}f64({DOUBLE_VECTOR_TYPE} {x})")
        inside = f.put(f"fcmp ole {DOUBLE_VECTOR_TYPE} {absolute}, {_load_constant(f, _MAX_REDUCIBLE_ANGLE_RAD)}")
        bits = f.put(f"bitcast <{LANE_COUNT} x i1> {inside} to i{LANE_COUNT}")
        with f.when(f.put(f"icmp ne i{LANE_COUNT} {bits}, -1")):
            places = [f.pointer_at(scratch, 8 * LANE_COUNT * j) for j in range(4)]
            for term, place in zip((x, *terms), places, strict=True):
                f.do(f"store {DOUBLE_VECTOR_TYPE} {term}, ptr {place}, align 64")
            f.do(f"call void @far(ptr {scratch})")
            corrected = [f.put(f"load {DOUBLE_VECTOR_TYPE}, ptr {place}, align 64") for place in places[1:]]
            _store_terms(f, float_type, corrected, target)
    f.do("ret void")
    return f.text()


def _store_terms(f: FunctionBuilder, float_type: str, terms: Sequence[str], target: str) -> None:
    """Append to the function `f` stores of the vectors of doubles named in `terms`, one behind the other from the
    address `target` on. If float_type is "float", the vectors are rounded to float32 first.
    """
    size, vector = (8 if float_type == "double" else 4), f"<{LANE_COUNT} x {float_type}>"
    for j, term in enumerate(terms):
        one = term if size == 8 else f.put(f"fptrunc {DOUBLE_VECTOR_TYPE} {term} to {vector}")
        f.do(f"store {vector} {one}, ptr {f.pointer_at(target, LANE_COUNT * size * j)}, align {LANE_COUNT * size}")


def _load_constant(f: FunctionBuilder, number: float) -> str:
    """Append the load of a constant from the table into all lanes of a vector, and return the name of the vector."""
    one = f.put(f"load double, ptr {f.pointer_at('%constants', 8 * _SINE_FUNCTION_CONSTANTS.index(number))}, align 8")
    return f.splat(DOUBLE_VECTOR_TYPE, f"double {one}")


def _write_reduced_sines(f: FunctionBuilder, x: str) -> tuple[str, str, str]:
    """Append to the function `f` the computation of sine, cosine and 1 - cosine of a vector of angles [rad] up to
    `_MAX_REDUCIBLE_ANGLE_RAD`, and return the names of the three vectors. `x` is the name of the vector of angles.
    """
    put = f.put
    integers = f"<{LANE_COUNT} x i64>"

    def constant(number: float) -> str:
        return _load_constant(f, number)

    def fma(a: str, b: str, c: str) -> str:
        factors = ", ".join(f"{DOUBLE_VECTOR_TYPE} {factor}" for factor in (a, b, c))
        return put(f"call {DOUBLE_VECTOR_TYPE} @llvm.fma.v{LANE_COUNT}f64({factors})")

    def polynomial(z: str, coefficients: Sequence[float]) -> str:
        """Append the evaluation of a polynomial of the vector z by Horner's scheme, and return the name of the
        result. The coefficients are numbers from the table of constants, highest power first.
        """
        value = constant(coefficients[0])
        for c in coefficients[1:]:
            value = fma(z, value, constant(c))
        return value

    def bit(mask: int, quadrant: str) -> str:
        return put(f"icmp ne {integers} {put(f'and {integers} {quadrant}, splat (i64 {mask})')}, zeroinitializer")

    def pick(condition: str, a: str, b: str) -> str:
        return put(f"select <{LANE_COUNT} x i1> {condition}, {DOUBLE_VECTOR_TYPE} {a}, {DOUBLE_VECTOR_TYPE} {b}")

    shifted = fma(x, constant(_TWO_OVER_PI), constant(_ADDEND_THAT_ROUNDS_DOUBLE_TO_INTEGER))
    quadrant = put(f"bitcast {DOUBLE_VECTOR_TYPE} {shifted} to {integers}")
    back = put(f"fsub {DOUBLE_VECTOR_TYPE} {constant(_ADDEND_THAT_ROUNDS_DOUBLE_TO_INTEGER)}, {shifted}")
    r = x
    for part in _HALF_PI_SUMMANDS:
        r = fma(back, constant(part), r)
    z = put(f"fmul {DOUBLE_VECTOR_TYPE} {r}, {r}")
    small = fma(
        put(f"fmul {DOUBLE_VECTOR_TYPE} {r}, {z}"), polynomial(z, _SIN_CUBIC_REMAINDER_COEFFS_HIGHEST_FIRST), r
    )
    square = put(f"fneg {DOUBLE_VECTOR_TYPE} {put(f'fmul {DOUBLE_VECTOR_TYPE} {z}, {z}')}")
    drop = fma(
        square,
        polynomial(z, _COS_QUARTIC_REMAINDER_COEFFS_HIGHEST_FIRST),
        put(f"fmul {DOUBLE_VECTOR_TYPE} {z}, {constant(0.5)}"),
    )
    large = put(f"fsub {DOUBLE_VECTOR_TYPE} {constant(1.0)}, {drop}")
    odd = bit(1, quadrant)
    sine, cosine = pick(odd, large, small), pick(odd, small, large)
    sine = pick(bit(2, quadrant), put(f"fneg {DOUBLE_VECTOR_TYPE} {sine}"), sine)
    turned = put(f"add {integers} {quadrant}, splat (i64 1)")
    cosine = pick(bit(2, turned), put(f"fneg {DOUBLE_VECTOR_TYPE} {cosine}"), cosine)
    rest = put(f"fsub {DOUBLE_VECTOR_TYPE} {constant(1.0)}, {cosine}")
    return sine, cosine, pick(bit(3, quadrant), rest, drop)


def _large_angles_function() -> str:
    """Return the LLVM code of the function `far`, which recomputes sine, cosine and 1 - cosine of the angles above
    `_MAX_REDUCIBLE_ANGLE_RAD`, of inf and of NaN by the C library.

    The results are stored behind the angles.
    """
    f = FunctionBuilder("internal void @far(ptr %angles) noinline cold")
    with f.loop(str(LANE_COUNT)) as k:
        place = f.pointer_at("%angles", f.multiply(k, 8))
        x = f.put(f"load double, ptr {place}")
        absolute = f.put(f"call double @llvm.fabs.f64(double {x})")
        with f.when(f.put(f"fcmp ugt double {absolute}, {hexadecimal(_MAX_REDUCIBLE_ANGLE_RAD)}")):
            sine, cosine = (f.put(f"call double @{name}(double {x})") for name in ("sin", "cos"))
            # 1 - cosine as NumPy computes it: the square of a half angle's sine is less accurate near 1 - cosine = 2.
            square, above = f.put(f"fmul double {sine}, {sine}"), f.put(f"fadd double {cosine}, {hexadecimal(1.0)}")
            near, far = f.put(f"fdiv double {square}, {above}"), f.put(f"fsub double {hexadecimal(1.0)}, {cosine}")
            limit = hexadecimal(MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE)
            is_near = f.put(f"fcmp ogt double {cosine}, {limit}")
            versine = f.put(f"select i1 {is_near}, double {near}, double {far}")
            for j, term in enumerate((sine, cosine, versine), 1):
                f.do(f"store double {term}, ptr {f.pointer_at(place, 8 * LANE_COUNT * j)}")
    f.do("ret void")
    return f.text()


def lanewise_function(name: str) -> str:
    """Return LLVM code, as text, that declares the function of the C library called `name`, which takes two doubles,
    and defines a function that calls it for each lane of two vectors.
    """
    f = FunctionBuilder(
        f"internal {DOUBLE_VECTOR_TYPE} @lanes.{name}({DOUBLE_VECTOR_TYPE} %a, {DOUBLE_VECTOR_TYPE} %b) noinline"
    )
    value = "poison"
    for k in range(LANE_COUNT):
        x, y = (f.put(f"extractelement {DOUBLE_VECTOR_TYPE} {v}, i32 {k}") for v in ("%a", "%b"))
        one = f.put(f"call double @{name}(double {x}, double {y})")
        value = f.put(f"insertelement {DOUBLE_VECTOR_TYPE} {value}, double {one}, i32 {k}")
    f.do(f"ret {DOUBLE_VECTOR_TYPE} {value}")
    return f"declare double @{name}(double, double)\n\n{f.text()}"
