"""Arithmetic on hash-consed values."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from . import fingerprint as fp
from .fingerprint import circle_of
from .interning import Interning, as_float
from .node import Node

_P = fp.PRIME


class Algebra(Interning):
    """An arena of values with their operations. `dalembert.ir.graph.Graph` adds traversals."""

    def add(self, a: Node, b: Node) -> Node:
        """Return a + b."""
        if a.fingerprint == 0:
            return b
        if b.fingerprint == 0:
            return a
        x, y = a.number, b.number
        if x is not None and y is not None:
            return self._number(x + y, (a.fingerprint + b.fingerprint) % _P, self._size(a) + self._size(b))
        if b.op == "neg":
            return self.sub(a, b.args[0])
        if a.op == "neg":
            return self.sub(b, a.args[0])
        return self._intern("add", (a, b), (a.fingerprint + b.fingerprint) % _P)

    def sub(self, a: Node, b: Node) -> Node:
        """Return a - b."""
        if b.is_zero:
            return a
        if a.is_zero:
            return self.neg(b)
        x, y = a.number, b.number
        if x is not None and y is not None:
            return self._number(x - y, (a.fingerprint - b.fingerprint) % _P, self._size(a) + self._size(b))
        if b.op == "neg":
            return self.add(a, b.args[0])
        if a.op == "neg":
            return self.neg(self.add(a.args[0], b))
        return self._intern("sub", (a, b), (a.fingerprint - b.fingerprint) % _P)

    def neg(self, a: Node) -> Node:
        """Return -a."""
        if a.op == "neg":
            return a.args[0]
        if a.number is not None:
            return self._number(-a.number, -a.fingerprint % _P, self._size(a))
        if a.op == "sub":
            return self.sub(a.args[1], a.args[0])
        return self._intern("neg", (a,), -a.fingerprint % _P)

    def mul(self, a: Node, b: Node) -> Node:
        """Return a * b."""
        left, right = a.fingerprint, b.fingerprint
        if left == 0 or right == 0:
            return self.zero
        if left == 1:
            return b
        if right == 1:
            return a
        x, y = a.number, b.number
        if x is not None and y is not None:
            size = abs(as_float(x)) * self._size(b) + abs(as_float(y)) * self._size(a) if self.decimals else 0.0
            return self._number(x * y, left * right % _P, size)
        if a.op == "neg":
            return self.neg(self.mul(a.args[0], b))
        if b.op == "neg":
            return self.neg(self.mul(a, b.args[0]))
        if x is not None and x < 0:
            return self.neg(self.mul(self.neg(a), b))
        if y is not None and y < 0:
            return self.neg(self.mul(a, self.neg(b)))
        if y is not None:
            a, b = b, a
        return self._intern("mul", (a, b), left * right % _P)

    def div(self, a: Node, b: Node) -> Node:
        """Return a / b; ``ZeroDivisionError`` where b is identically zero."""
        if b.is_zero:
            raise ZeroDivisionError("division by an expression that is identically zero")
        if a.is_zero or b.is_one:
            return a
        x, y = a.number, b.number
        if y is not None:
            if x is None:
                return self.mul(self.div(self.one, b), a)
            return self._number(x / y, a.fingerprint * fp.inverse(b.fingerprint) % _P, self._size_of_quotient(a, b))
        if a.op == "neg":
            return self.neg(self.div(a.args[0], b))
        if b.op == "neg":
            return self.neg(self.div(a, b.args[0]))
        return self._intern("div", (a, b), a.fingerprint * fp.inverse(b.fingerprint) % _P)

    def power(self, a: Node, exponent: Fraction) -> Node:
        """Return a raised to a rational number, by products and square roots where possible."""
        if exponent < 0:
            return self.div(self.one, self.power(a, -exponent))
        whole, rest = divmod(exponent, 1)
        result, square = self.one, a
        while whole:
            if whole & 1:
                result = self.mul(result, square)
            whole >>= 1
            if whole:
                square = self.mul(square, square)
        if rest == Fraction(1, 2):
            return self.mul(result, self.call("sqrt", a))
        return self.mul(result, self.call("pow", a, self.const(rest))) if rest else result

    def call(self, op: str, *args: Node) -> Node:
        """Return the named operation applied to `args`."""
        simple = getattr(self, op, None) if op in ("add", "sub", "mul", "div", "neg") else None
        if simple is not None:
            return simple(*args)  # type: ignore[no-any-return]
        if op in ("sin", "cos", "tan"):
            return self._trigonometric(op, args[0])
        if op == "sqrt":
            return self._square_root(args[0])
        if op == "select" and args[1] is args[2]:
            return args[1]
        return self._intern(op, args, fp.hashed(op, *(a.fingerprint for a in args)))

    def sin(self, a: Node) -> Node:
        """Return the sine of a."""
        return self._trigonometric("sin", a)

    def cos(self, a: Node) -> Node:
        """Return the cosine of a."""
        return self._trigonometric("cos", a)

    def sum(self, terms: Iterable[Node]) -> Node:
        """Return the sum of `terms`, added in order."""
        total = self.zero
        for term in terms:
            total = self.add(total, term)
        return total

    def _trigonometric(self, op: str, a: Node) -> Node:
        if a.is_zero:
            return self.one if op == "cos" else self.zero
        if a.op == "neg":
            inner = self._trigonometric(op, a.args[0])
            return inner if op == "cos" else self.neg(inner)
        cosine, sine = circle_of(a)
        if op == "tan":
            return self._intern(op, (a,), sine * fp.inverse(cosine) % _P)
        return self._intern(op, (a,), cosine if op == "cos" else sine)

    def _square_root(self, a: Node) -> Node:
        number = a.number
        if number is not None and number >= 0:
            if number == 0:
                return a
            top, bottom = fp.square_root(number.numerator), fp.square_root(number.denominator)
            if top is not None and bottom is not None:
                root = Fraction(round(number.numerator**0.5), round(number.denominator**0.5))
                if root * root == number:
                    return self.const(root)
                return self._intern("sqrt", (a,), top * fp.inverse(bottom) % _P)
        return self._intern("sqrt", (a,), fp.hashed("sqrt", a.fingerprint))
