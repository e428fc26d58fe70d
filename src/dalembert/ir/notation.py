"""Text form of names, numbers and operations of programs: printers, and a reader of tokens.

A line is one statement; a line that ends in a comma continues in the next. ``#`` begins a comment, indentation has no
meaning. Names that are no plain words, such as labels of constraints, are in double quotes with escapes of Python.
Numbers are printed by ``repr``, so that they are read as the same doubles; ``inf`` and ``nan`` are numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NoReturn, TypeVar, final

from ..errors import ProgramTextError, list_names
from .ops import ALL_OPERATIONS

T = TypeVar("T")

_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "pow": "**", "less": "<", "less_equal": "<="}
_BY_SIGN = {sign: op for op, sign in _INFIX.items()}

_WORD = r"[^\W\d]\w*"
_PLAIN = re.compile(_WORD)
_NUMBERS = {"inf": math.inf, "nan": math.nan}
_TOKEN = re.compile(
    rf"""(?P<newline>\n)|(?P<blank>[ \t\r]+|\#[^\n]*)|(?P<word>{_WORD})"""
    r"""|(?P<number>[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?)"""
    r"""|(?P<quoted>"(?:[^"\\\n]|\\.)*")|(?P<sign>\*\*|<=|[-+*/<=()\[\],:])"""
)
_ESCAPE = re.compile(r"\\(?:x([0-9a-f]{2})|u([0-9a-f]{4})|U([0-9a-f]{8})|(.))")
_ESCAPED = {"n": "\n", "t": "\t", "r": "\r", '"': '"', "\\": "\\"}


def one_line(text: str) -> str:
    """Return `text` with escapes in place of the characters that cannot be printed, such as ends of lines."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@lru_cache(maxsize=8192)
def word(name: str) -> str:
    """Return a name as it stands in text: plain, or in double quotes."""
    plain = name.isidentifier() if name.isascii() else _PLAIN.fullmatch(name)
    if plain and name not in _NUMBERS:
        return name
    return '"' + one_line(name.replace("\\", "\\\\").replace('"', '\\"')) + '"'


def literal_text(value: float) -> str:
    """Return a number as it stands in text."""
    return repr(float(value))


def operand_text(operand: str | float) -> str:
    """Return an operand as it stands in text."""
    return word(operand) if isinstance(operand, str) else literal_text(operand)


def operation_text(op: str, args: Sequence[str | float]) -> str:
    """Return an operation on operands: ``a + b``, ``-a``, ``sin(a)``."""
    if op in _INFIX and len(args) == 2:
        left, right = args
        before = word(left) if isinstance(left, str) else _enclosed(left) if op == "pow" else literal_text(left)
        return f"{before} {_INFIX[op]} {word(right) if isinstance(right, str) else _enclosed(right)}"
    if op == "neg" and len(args) == 1:
        return f"-{word(args[0]) if isinstance(args[0], str) else _enclosed(args[0])}"
    return f"{word(op)}({', '.join(map(operand_text, args))})"


def _enclosed(value: float) -> str:
    """Return a number as it is written after a sign: a negative one in parentheses."""
    text = literal_text(value)
    return f"({text})" if text.startswith("-") else text


@final
class Reader:
    """The tokens of a text, read one after another.

    Parameters
    ----------
    text : str
        In the notation of this module.

    Raises
    ------
    ProgramTextError
        From any method that does not find what it requires; the message has the line and what was expected.
    """

    def __init__(self, text: str) -> None:
        self._tokens: list[tuple[str, str, int]] = []
        self._place = 0
        line, place = 1, 0
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                quoted = text[place] == '"'
                expected = "a closing double quote in the same line" if quoted else "a name, a number or an operation"
                raise ProgramTextError(line, expected, text[place:].split("\n", 1)[0])
            kind, found = str(match.lastgroup), match.group()
            place = match.end()
            if kind == "newline":
                self._end_line(line)
                line += 1
            elif kind != "blank":
                self._tokens.append((kind, found, line))
        self._end_line(line)
        self._tokens.append(("end", "", line))

    def _end_line(self, line: int) -> None:
        if self._tokens and self._tokens[-1][0] != "newline" and self._tokens[-1][1] != ",":
            self._tokens.append(("newline", "", line))

    def fail(self, expected: str) -> NoReturn:
        """Raise an error that names the expected token and the position."""
        kind, found, line = self._token()
        raise ProgramTextError(line, expected, {"newline": "the end of the line", "end": "the end"}.get(kind, found))

    @property
    def done(self) -> bool:
        """Whether nothing is left."""
        return self._token()[0] == "end"

    def sees(self, sign: str, ahead: int = 0) -> bool:
        """Return whether a sign or plain word comes next, or `ahead` tokens later."""
        return self._token(ahead)[1] == sign

    def sees_word(self, ahead: int = 0) -> bool:
        """Return whether a name comes next, or `ahead` tokens later."""
        return self._token(ahead)[0] in ("word", "quoted")

    def take(self, sign: str) -> bool:
        """Pass a sign or plain word, if it comes next; return whether it did."""
        found = self.sees(sign)
        self._place += found
        return found

    def require(self, *signs: str) -> None:
        """Pass signs or plain words, which must come next."""
        for sign in signs:
            if not self.take(sign):
                self.fail(repr(sign))

    def ends(self, ahead: int = 0) -> bool:
        """Return whether the line ends here, or `ahead` tokens later."""
        return self._token(ahead)[0] in ("newline", "end")

    def end_line(self, expected: str = "the end of the line") -> None:
        """Pass the end of a line, which must come next."""
        if not self.ends():
            self.fail(expected)
        self._place += not self.done

    def word(self, expected: str = "a name") -> str:
        """Return the name that comes next."""
        kind, found, _ = self._token()
        if kind not in ("word", "quoted") or found in _NUMBERS:
            self.fail(expected)
        name = found if kind == "word" else self._unquoted(found[1:-1])
        self._place += 1
        return name

    def _unquoted(self, text: str) -> str:
        def character(match: re.Match[str]) -> str:
            *codes, single = match.groups()
            code = next((code for code in codes if code is not None), None)
            if code is not None and int(code, 16) <= 0x10FFFF:
                return chr(int(code, 16))
            if single not in _ESCAPED:
                self.fail(f"an escape of {list_names(sorted(_ESCAPED))}, or x, u, U with 2, 4, 8 digits")
            return _ESCAPED[single]

        return _ESCAPE.sub(character, text)

    def whole(self, expected: str = "a whole number") -> int:
        """Return the whole number that comes next."""
        sign = -1 if self.take("-") else 1
        kind, found, _ = self._token()
        if kind != "number" or not found.isdigit():
            self.fail(expected)
        self._place += 1
        return sign * int(found)

    def number(self, expected: str = "a number") -> float:
        """Return the number that comes next, which may stand in parentheses."""
        inside = self.take("(")
        negative = self.take("-")
        _, found, _ = self._token()
        if not self._sees_number():
            self.fail(expected)
        value = _NUMBERS[found] if found in _NUMBERS else float(found)
        self._place += 1
        if inside:
            self.require(")")
        return -value if negative else value

    def _sees_number(self, ahead: int = 0) -> bool:
        kind, found, _ = self._token(ahead)
        return kind == "number" or found in _NUMBERS

    def _token(self, ahead: int = 0) -> tuple[str, str, int]:
        return self._tokens[min(self._place + ahead, len(self._tokens) - 1)]

    def operand(self) -> str | float:
        """Return the name or number that comes next."""
        kind, found, _ = self._token()
        if kind in ("word", "quoted") and found not in _NUMBERS:
            return self.word()
        return self.number("a name or a number")

    def operation(self) -> tuple[str, tuple[str | float, ...]]:
        """Return the operation that the rest of the line is, with its operands."""
        if self.sees("-") and not self._negative_left():
            self.require("-")
            return "neg", (self.operand(),)
        if self.sees_word() and self.sees("(", 1):
            return self._function()
        left = self.operand()
        op = next((op for sign, op in _BY_SIGN.items() if self.sees(sign)), None)
        if op is None:
            self.fail(f"an operation: {list_names(_BY_SIGN)}")
        self._place += 1
        return op, (left, self.operand())

    def _negative_left(self) -> bool:
        """Return whether a minus sign here belongs to a number that is the left operand of an operation."""
        return self._sees_number(1) and any(self.sees(sign, 2) for sign in _BY_SIGN)

    def _function(self) -> tuple[str, tuple[str | float, ...]]:
        if self._token()[1] not in ALL_OPERATIONS:
            self.fail(f"one of the functions {list_names(ALL_OPERATIONS)}")
        op = self.word()
        self.require("(")
        args = tuple(self.listed(self.operand, ")"))
        if len(args) != ALL_OPERATIONS[op].arity:
            self.fail(f"{ALL_OPERATIONS[op].arity} operands of {op}, not {len(args)},")
        self.require(")")
        return op, args

    def listed(self, item: Callable[[], T], end: str = "") -> list[T]:
        """Return items with commas between them, up to the sign `end`, or to the end of the line."""
        items: list[T] = []
        while not (self.sees(end) if end else self.ends()):
            if items:
                self.require(",")
            items.append(item())
        return items
