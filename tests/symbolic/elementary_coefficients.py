#!/usr/bin/python3
"""Prints the constants of firmware/numeric/elementary.hpp (needs mpmath): Chebyshev fits and split constants.

Every fit is in z = (argument)^2 and leaves the leading term of the function out, so that the last
operation of the evaluation adds a small correction to an exact value. The printed error is the
contribution to the result, relative to the result, before rounding of the coefficients.
"""
import struct

from mpmath import asin, atan, chebyfit, coth, cos, log, mp, mpf, pi, polyval, sin, sqrt, floor, frexp, ldexp

mp.dps = 60
ROUND = {"float": lambda v: struct.unpack("f", struct.pack("f", float(v)))[0], "double": float}
DIGITS = {"float": 24, "double": 53}
SLACK = mpf("1.001")  # the quotient that picks the interval is itself rounded

# name: (f(z), relative weight of an error of f(z), largest argument (of each, where they differ), terms for float, double)
FITS = {
    "sine": (lambda z: (1 - sin(sqrt(z)) / sqrt(z)) / z, lambda z: z, pi / 4 * SLACK, 3, 6),
    "cosine": (lambda z: (cos(sqrt(z)) - 1 + z / 2) / z**2, lambda z: z**2 * 1.42, pi / 4 * SLACK, 3, 6),
    "tanh": (lambda z: (sqrt(z) * coth(sqrt(z)) - 1) / z, lambda z: z, log(2) / 4 * SLACK, 2, 5),
    "atan": (lambda z: (1 - atan(sqrt(z)) / sqrt(z)) / z, lambda z: z, mpf(33) / 128, 4, 8),
    "asin": (lambda z: (asin(sqrt(z)) / sqrt(z) - 1) / z, lambda z: z, {"float": mpf("0.7072"), "double": mpf("0.26")}, 7, 8),
}


def truncate(value, bits):
    exponent = frexp(value)[1]
    return ldexp(floor(ldexp(value, bits - exponent)), exponent - bits)


def parts(value, bits):
    """Sum to value; all but the last have few bits, so that small integers times them are exact."""
    result = []
    for count in bits:
        result.append(truncate(value, count))
        value -= result[-1]
    return result + [value]


for kind, near in ROUND.items():
    def show(name, values, kind=kind, near=near):
        print(f"{kind} {name}: " + ", ".join(near(v).hex() for v in values))

    def head_tail(value, near=near):
        return near(value), value - near(value)

    for name, (f, weight, limit, few, many) in FITS.items():
        limit = limit[kind] if isinstance(limit, dict) else limit
        terms = chebyfit(f, [limit**2 / 10, limit**2],  # the weight vanishes at 0
                          few if kind == "float" else many)
        grid = [limit**2 * (i + mpf(1)) / 400 for i in range(400)]
        error = max(abs(polyval(terms, z) - f(z)) * weight(z) for z in grid)
        print(f"# {kind} {name}: error {float(error * 2 ** DIGITS[kind]):.3f} * 2^-{DIGITS[kind]}")
        show(name, reversed(terms))
    show("2/pi, 2/ln 2", [2 / pi, 2 / log(2)])
    show("pi/2", parts(pi / 2, [14, 14] if kind == "float" else [40, 40]))
    show("ln2/2", parts(log(2) / 2, [16] if kind == "float" else [44]))
    show("pi", head_tail(pi))
    for quadrant, base in [("x>0 ", lambda o: o), ("x>0 swapped", lambda o: pi / 2 - o),
                           ("x<0", lambda o: pi - o), ("x<0 swapped", lambda o: pi / 2 + o)]:
        for centre in (mpf(0), mpf(1) / 2, mpf(1)):
            show(f"atan2 base {quadrant} {centre}", head_tail(base(atan(centre))))
