"""Statements and functions of the compiled subset as C."""

from __future__ import annotations

import ast
import re
from typing import Any, final

from ...subset.compiled_subset import INTEGER, NUMBER, Array, Fields, Group, Kind, Scalar
from ..subset.definitions import Names, definition_of, leaves_of, names_of, read_in, result_of
from ..subset.target import Value, by_reference
from ..subset.translation import UNKNOWN
from .expressions import TYPES, Expressions, Functions, is_atom, literal_of
from .printing import Code, Fixed, Known, Pointer, bare, c_name, names_in, tidied


@final
class Function:
    """A translated function.

    Attributes
    ----------
    lines : list of str
        Its text.
    kept : tuple of int
        Which of the words of its arguments, one after the other, it takes; the others have no influence.
    takes_run : bool
        Whether it takes the arguments of the loop.
    kind : Kind
        Of its result.
    constant : Value or None
        Its result, where that is all that it computes.
    """

    def __init__(self, lines: list[str], kept: tuple[int, ...], takes_run: bool, kind: Kind) -> None:
        self.lines, self.kept, self.takes_run, self.kind = lines, kept, takes_run, kind
        self.constant: Value | None = None
        self.empty = False


def translated(module: Functions, function: Any, name: str, given: list[Value]) -> Function:
    """Return a function for arguments; literals, and names of kernels, among their words are put in.

    Raises
    ------
    TypeError
        For statements that have no translation; the message names the line.
    """
    return _Statements(module, function).function(definition_of(function), name, given)


def _pointer(kind: Kind, word: Pointer) -> str:
    """Return the C type of an address of numbers."""
    if isinstance(word, Code):
        return "kernel_function *"
    item = kind.item if isinstance(kind, Array) and not kind.item.owned else NUMBER
    return f"{'const ' if isinstance(word, Fixed) else ''}{TYPES[item]} *"


def is_static(word: str) -> bool:
    """Return whether a word of an argument is put into the function that takes it."""
    return isinstance(word, Known) or literal_of(word) is not UNKNOWN


@final
class _Statements(Expressions):
    """Translates the statements of one function."""

    def __init__(self, module: Functions, function: Any) -> None:
        super().__init__(module, function)
        self._result: Kind = Group(())
        self._name = ""
        self._names = Names({}, set(), set())
        self._open = True
        self._loops: list[tuple[str, str]] = []

    @property
    def reachable(self) -> bool:
        """See `Translation.reachable`."""
        return self._open

    def function(self, tree: ast.FunctionDef, name: str, given: list[Value]) -> Function:
        """See `translated`."""
        self._result, self._name = result_of(tree.returns), name
        self._names = names_of(tree)
        arguments: list[str] = []
        for argument, value in zip(tree.args.args, given, strict=True):
            if by_reference(value.kind):
                self.fixed[argument.arg] = value
                continue
            base, words = c_name(argument.arg), []
            for number, word in enumerate(value.words):
                if is_static(word):
                    words.append(word)
                    arguments.append("")
                    continue
                own = base if number == 0 else f"{base}_{number}"
                words.append(type(word)(own) if isinstance(word, Pointer) else own)
                arguments.append(f"{self._type(value.kind, number, word)} {own}".replace("* ", "*"))
            self.fixed[argument.arg] = Value(value.kind, tuple(words))
            if argument.arg in self._names.stored:
                self._change_argument(argument.arg)
        self.body(tree.body)
        return self._finished(name, arguments)

    def _change_argument(self, name: str) -> None:
        """Make a variable of an argument that is changed."""
        value = self.variables[name] = self.fixed.pop(name)
        (word,) = value.words
        if is_static(word):
            self.types[c_name(name)] = TYPES[value.kind]  # type: ignore[index]
            self.lines.append(f"{c_name(name)} = {bare(word)};")
            self.variables[name] = Value(value.kind, (c_name(name),))

    @staticmethod
    def _type(kind: Kind, number: int, word: str) -> str:
        if isinstance(word, Pointer):
            return _pointer(kind, word)
        if isinstance(kind, Fields):
            raise TypeError("records are part of the arguments of the loop")
        return TYPES[INTEGER] if isinstance(kind, Array) else TYPES[kind]  # type: ignore[index]

    def _finished(self, name: str, arguments: list[str]) -> Function:
        """Return the function without what has no influence."""
        lines = tidied(self.lines, set(self.types), self.module.functions)
        text = "\n".join(lines)
        names = {name for line in lines for name in names_in(line)}
        kept = tuple(
            i for i, argument in enumerate(arguments) if argument and argument.split("*")[-1].split()[-1] in names
        )
        takes_run = "run->" in text or re.search(r"\brun\b", text) is not None
        found = Function([], kept, takes_run, self._result)
        match lines:
            case []:
                found.empty = not self._result.parts if isinstance(self._result, Group) else False
            case [only] if (given := re.fullmatch(r"return (.*);", only)) and literal_of(given[1]) is not UNKNOWN:
                found.constant = Value(self._result, (given[1],))
        head = [*(["NAME_RUN *run"] if takes_run else []), *(arguments[i] for i in kept)]
        result = self._result_type()
        declared: dict[str, list[str]] = {}
        for variable, kind in self.types.items():
            if variable in names:
                declared.setdefault(kind, []).append(f"*{variable}" if kind.endswith("*") else variable)
        body = [f"{kind.rstrip('* ')} {', '.join(group)};" for kind, group in declared.items()]
        found.lines = [f"static {result} {name}({', '.join(head) or 'void'})", "{", *body, *lines, "}"]
        return found

    def _result_type(self) -> str:
        if isinstance(self._result, Group):
            return f"struct {self._name}_result" if self._result.parts else "void"
        return TYPES[self._result]  # type: ignore[index]

    # -- statements -------------------------------------------------------------------------

    def statement(self, node: ast.stmt) -> None:
        """See `Translation.statement`."""
        tested = node.test if isinstance(node, ast.If | ast.While) else node.iter if isinstance(node, ast.For) else node
        self.fragile = self.calls(tested)
        super().statement(node)

    def together(self, nodes: list[ast.expr], targets: list[ast.expr]) -> list[Value]:
        """See `Translation.together`."""
        found = []
        for number, node in enumerate(nodes):
            value = self.value(node)
            before = targets[:number]
            if len(value.kind.words) == 1 and isinstance(value.kind, Scalar) and self._disturbed(node, before):
                (word,) = value.words
                if not isinstance(word, Pointer):
                    value = Value(value.kind, (self.computed(word, TYPES[value.kind]),))
            found.append(value)
        return found

    @staticmethod
    def _disturbed(node: ast.expr, targets: list[ast.expr]) -> bool:
        """Return whether assignments to targets may change an expression."""
        stored = {name for target in targets for name in read_in(target).names}
        names, memory = read_in(node)
        return bool(names & stored) or (memory and any(not isinstance(target, ast.Name) for target in targets))

    def assign_name(self, name: str, value: Value) -> None:
        """See `Translation.assign_name`. What is known, and where arrays are, is put in where the name is read."""
        if name == "_":
            return
        once = self._names.stored.get(name, 0) == 1 and name not in self.variables
        static = all(is_static(word) for word in value.words)
        if value.base or (once and (static or name in self._names.targets)) or isinstance(value.kind, Fields):
            if name in self.variables or (self.fixed.get(name, value) != value and name not in self._names.targets):
                raise TypeError(f"{name} has another meaning already")
            self.fixed[name] = self._stable(name, value)
            return
        if isinstance(value.kind, Array) or isinstance(value.words[0], Pointer):
            if not once:
                raise TypeError(f"{name} is an array already")
            self.fixed[name] = self._stable(name, value)
            return
        if isinstance(value.kind, Group):
            raise TypeError(f"{name} is a tuple, which has no translation: name its parts")
        if name not in self.variables:
            own = c_name(name)
            self.types[own] = TYPES[value.kind]  # type: ignore[index]
            self.variables[name] = Value(value.kind, (own,))
        held = self.variables[name]
        (word,) = self.converted(value, held.kind).words
        if word != held.words[0]:
            self.lines.append(f"{held.words[0]} = {bare(word)};")

    def _stable(self, name: str, value: Value) -> Value:
        """Return a value whose words mean the same wherever they are read."""
        words = []
        for number, word in enumerate(value.words):
            if is_static(word) or not any(name in self.types for name in names_in(word)):
                words.append(word)
                continue
            own = c_name(name) if number == 0 else f"{c_name(name)}_{number}"
            if isinstance(word, Pointer):
                self.types[own] = _pointer(value.kind, word)
            else:
                self.types[own] = TYPES[INTEGER] if isinstance(value.kind, Array) else TYPES[value.kind]  # type: ignore[index]
            self.lines.append(f"{own} = {bare(word)};")
            words.append(type(word)(own) if isinstance(word, Pointer) else own)
        return Value(value.kind, tuple(words), value.base, value.first)

    def branch_if(self, test: ast.expr, body: list[ast.stmt], other: list[ast.stmt]) -> None:
        """See `Translation.branch_if`."""
        flag = self.truth(test).words[0]
        held = literal_of(flag)
        if held is not UNKNOWN:
            self.body(body if held else other)
            return
        with self.aside() as yes:
            self.body(body)
        ended, self._open = not self._open, True
        with self.aside() as no:
            self.body(other)
        both = ended and not self._open
        self._open = True
        if yes and no:
            self.lines += [f"if ({bare(flag)}) {{", *yes, "} else {", *no, "}"]
        elif yes:
            self.lines += [f"if ({bare(flag)}) {{", *yes, "}"]
        elif no:
            self.lines += [f"if (!{flag}) {{", *no, "}"]
        self._open = not both

    def loop_while(self, test: ast.expr, body: list[ast.stmt]) -> None:
        """See `Translation.loop_while`."""
        with self.aside() as before:
            flag = self.truth(test).words[0]
        if literal_of(flag) is False:
            return
        inside = self._loop(body, "continue;", "break;")
        if before:
            self.lines += ["for (;;) {", *before, f"if (!{flag}) {{", "break;", "}", *inside, "}"]
        else:
            self.lines += [f"while ({bare(flag)}) {{", *inside, "}"]

    def _loop(self, body: list[ast.stmt], again: str, end: str) -> list[str]:
        """Return the lines of the body of a loop, which leaves a round or the loop by these statements."""
        self._loops.append((again, end))
        with self.aside() as lines:
            self.body(body)
        self._loops.pop()
        self._open = True
        return lines

    def loop_range(self, name: str, given: list[Value], body: list[ast.stmt]) -> None:
        """See `Translation.loop_range`."""
        first = given[0].words[0] if len(given) > 1 else "0"
        last = given[min(1, len(given) - 1)].words[0]
        step = given[2].words[0] if len(given) > 2 else "1"
        if not step.lstrip("-").isdigit():
            raise TypeError("the step of a range is a constant")
        bounds = literal_of(first), literal_of(last)
        if UNKNOWN not in bounds and not range(bounds[0], bounds[1], int(step)):
            return
        if not is_atom(last) or any(name in self.types or name == "run" for name in names_in(last)):
            last = self.computed(last, TYPES[INTEGER])
        if name not in self.variables and name not in self.fixed and name != "_":
            self.types[c_name(name)] = TYPES[INTEGER]
            self.variables[name] = Value(INTEGER, (c_name(name),))
        count = c_name(name) if name in self._names.counters and name != "_" else self.fresh(TYPES[INTEGER])
        change = {"1": f"{count}++", "-1": f"{count}--"}.get(step, f"{count} += {step}")
        test = f"{count} {'>' if step.startswith('-') else '<'} {last}"
        self.lines.append(f"for ({count} = {bare(first)}; {test}; {change}) {{")
        if count != c_name(name) and name != "_":
            self.lines.append(f"{c_name(name)} = {count};")
        self.lines += [*self._loop(body, "continue;", "break;"), "}"]

    def loop_each(self, target: ast.expr, elements: list[ast.expr], body: list[ast.stmt]) -> None:
        """See `Translation.loop_each`."""
        leaves = leaves_of(body)
        if ast.Break in leaves:
            raise TypeError("a loop over a tuple is not left before its end")
        for element in elements:
            self.assign(target, self.value(element))
            inside = self._loop(body, "break;", "")
            self.lines += ["do {", *inside, "} while (0);"] if ast.Continue in leaves else inside

    def leave(self, loop: bool) -> None:
        """See `Translation.leave`."""
        self.lines.append(self._loops[-1][loop])
        self._open = False

    def give(self, value: Value | None) -> None:
        """See `Translation.give`."""
        self._open = False
        if value is None:
            self.lines.append("return;")
            return
        value = self.converted(value, self._result)
        if not isinstance(self._result, Group):
            self.lines.append(f"return {bare(value.words[0])};")
            return
        self.types["result"] = f"struct {self._name}_result"
        self.lines += [f"result.part_{i} = {bare(word)};" for i, word in enumerate(value.words)]
        self.lines.append("return result;")
