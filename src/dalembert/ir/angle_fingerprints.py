"""Points of the circle over the field of fingerprints that stand for angles: addition theorems hold exactly."""

from __future__ import annotations

from . import fingerprint as fp
from .node import Node

__all__ = ["circle_of"]


def circle_of(a: Node) -> fp.Circle:
    """Return the point of the circle, as (cosine, sine), that stands for the angle `a`."""
    return fp.turns(_part_of(a), fp.ANGLE_DENOMINATOR)


def _part_of(a: Node) -> fp.Circle:
    """Return the point of the part of an angle of which `ANGLE_DENOMINATOR` are the angle; the node remembers it."""
    if a.circle is None:
        a.circle = _new_part(a)
    return a.circle


def _new_part(a: Node) -> fp.Circle:
    if a.number is not None:
        return _part_of_number(a)
    if a.op == "add":
        return fp.turn(_part_of(a.args[0]), _part_of(a.args[1]))
    if a.op == "sub":
        return fp.turn(_part_of(a.args[0]), fp.conjugate(_part_of(a.args[1])))
    if a.op == "neg":
        return fp.conjugate(_part_of(a.args[0]))
    if a.op == "mul" and a.args[0].number is not None:
        count, atom = a.args[0].number, a.args[1]
        if count.denominator == 1 and count <= 64:
            return fp.turns(_part_of(atom), count.numerator)
        parts = count * fp.ANGLE_DENOMINATOR
        if parts.denominator == 1 and parts <= 64 and atom.op not in ("add", "sub", "mul", "neg"):
            return fp.turns(fp.circle_from(fp.hashed("part", atom.fingerprint)), parts.numerator)
    if a.op in ("mul", "add", "sub"):
        return fp.circle_from(a.fingerprint)
    return fp.turns(fp.circle_from(fp.hashed("part", a.fingerprint)), fp.ANGLE_DENOMINATOR)


def _part_of_number(a: Node) -> fp.Circle:
    number = a.number
    assert number is not None
    parts = number * fp.RADIAN_PARTS
    if parts.denominator == 1 and parts.numerator.bit_length() <= 64:
        return fp.turns(fp.circle_from(fp.hashed("part", "radian")), parts.numerator)
    return fp.conjugate(fp.circle_from(-a.fingerprint % fp.PRIME)) if number < 0 else fp.circle_from(a.fingerprint)
