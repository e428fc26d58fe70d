"""Fingerprints: the value of an expression at one random point of a finite field.

Two expressions that are equal as functions have equal fingerprints, and two that differ
have different ones but for a chance of about (degree / 2**127) (Schwartz and Zippel). The
graph identifies nodes by fingerprint, so cos(a)**2 + sin(a)**2 *is* the node 1, x*a - x*a
*is* 0, and the angular velocity written in Euler angles and their rates *is* the
quasi-velocity it was solved for, whatever path the derivation took to it.

Rational operations are done modulo the prime `PRIME`. The pair (cos a, sin a) is a point of
the unit circle over the field; an angle that is a sum gets the product of the points of its
terms, which makes the addition theorems exact. The four components of a unit quaternion are a
point of the unit sphere, so that their squares add up to 1. Every other function is a fresh value hashed
from its name and its arguments, so that nothing is claimed about it beyond what is known.
"""

from __future__ import annotations

import hashlib
from fractions import Fraction
from functools import lru_cache

from .node import Node

PRIME = 170141183460469231731687303715883999471
"""A 127-bit prime, 3 modulo 4, modulo which the primes up to 23 are squares."""

ANGLE_DENOMINATOR = 12
"""Angles are held as multiples of a twelfth of their atoms: halves, thirds, quarters and sixths are exact."""

RADIAN_PARTS = 126_000
"""Angles that are numbers are held as multiples of such a part of a radian where they are one."""

Circle = tuple[int, int]
"""A point (cos, sin) of the unit circle over the field."""


def hashed(*parts: object) -> int:
    """Return a field element drawn from `parts`, the same in every process."""
    digest = hashlib.sha256("\x1f".join(map(str, parts)).encode()).digest()
    return int.from_bytes(digest[:24], "big") % PRIME


@lru_cache(maxsize=4096)
def inverse(a: int) -> int:
    """Return 1 / a in the field; ``ValueError`` for a = 0. A derivation divides by the same few values many times."""
    return pow(a, -1, PRIME)


def of_fraction(value: Fraction) -> int:
    """Return the fingerprint of an exact rational number."""
    return value.numerator * inverse(value.denominator % PRIME) % PRIME


def circle_from(value: int) -> Circle:
    """Return the point of the circle that stands for a twelfth of the angle with fingerprint `value`."""
    tangent = hashed("circle", value)
    scale = inverse((1 + tangent * tangent) % PRIME)
    return (1 - tangent * tangent) * scale % PRIME, 2 * tangent * scale % PRIME


def sphere_point(value: str) -> tuple[int, int, int, int]:
    """Return the point of the unit sphere in four dimensions that stands for a unit quaternion drawn from `value`."""
    u = [hashed("sphere", value, i) for i in range(3)]
    square = sum(x * x for x in u) % PRIME
    scale = inverse((1 + square) % PRIME)
    x, y, z = (2 * component * scale % PRIME for component in u)
    return (square - 1) * scale % PRIME, x, y, z


def turn(a: Circle, b: Circle) -> Circle:
    """Return the point of the sum of two angles."""
    return (a[0] * b[0] - a[1] * b[1]) % PRIME, (a[0] * b[1] + a[1] * b[0]) % PRIME


def conjugate(a: Circle) -> Circle:
    """Return the point of the opposite angle."""
    return a[0], -a[1] % PRIME


def turns(a: Circle, count: int) -> Circle:
    """Return the point of `count` times an angle."""
    if count < 0:
        return turns(conjugate(a), -count)
    result: Circle = (1, 0)
    while count:
        if count & 1:
            result = turn(result, a)
        a = turn(a, a)
        count >>= 1
    return result


def square_root(number: int) -> int | None:
    """Return the fingerprint of the square root of a small positive integer; None where the field has no root.

    Each prime factor has one root, chosen once, so that sqrt(2) * sqrt(3) is sqrt(6).
    """
    if not 0 < number < 10_000:
        return None
    result, factor = 1, 2
    while number > 1:
        while number % factor:
            factor += 1
        number //= factor
        root = pow(factor, (PRIME + 1) // 4, PRIME)
        if root * root % PRIME != factor:
            return None
        result = result * root % PRIME
    return result


# Points of the circle over the field of fingerprints that stand for angles: addition theorems hold exactly.


def circle_of(a: Node) -> Circle:
    """Return the point of the circle, as (cosine, sine), that stands for the angle `a`."""
    return turns(_part_of(a), ANGLE_DENOMINATOR)


def _part_of(a: Node) -> Circle:
    """Return the point of the part of an angle of which `ANGLE_DENOMINATOR` are the angle; the node remembers it."""
    if a.circle is None:
        a.circle = _new_part(a)
    return a.circle


def _new_part(a: Node) -> Circle:
    if a.number is not None:
        return _part_of_number(a)
    if a.op == "add":
        return turn(_part_of(a.args[0]), _part_of(a.args[1]))
    if a.op == "sub":
        return turn(_part_of(a.args[0]), conjugate(_part_of(a.args[1])))
    if a.op == "neg":
        return conjugate(_part_of(a.args[0]))
    if a.op == "mul" and a.args[0].number is not None:
        count, atom = a.args[0].number, a.args[1]
        if count.denominator == 1 and count <= 64:
            return turns(_part_of(atom), count.numerator)
        parts = count * ANGLE_DENOMINATOR
        if parts.denominator == 1 and parts <= 64 and atom.op not in ("add", "sub", "mul", "neg"):
            return turns(circle_from(hashed("part", atom.fingerprint)), parts.numerator)
    if a.op in ("mul", "add", "sub"):
        return circle_from(a.fingerprint)
    return turns(circle_from(hashed("part", a.fingerprint)), ANGLE_DENOMINATOR)


def _part_of_number(a: Node) -> Circle:
    number = a.number
    assert number is not None
    parts = number * RADIAN_PARTS
    if parts.denominator == 1 and parts.numerator.bit_length() <= 64:
        return turns(circle_from(hashed("part", "radian")), parts.numerator)
    return conjugate(circle_from(-a.fingerprint % PRIME)) if number < 0 else circle_from(a.fingerprint)
