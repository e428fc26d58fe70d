"""Files of robots: XML elements with their line numbers, and values read from them with all faults collected."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, final
from xml.parsers import expat

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, SceneError, list_names


@final
class IncludedLine(int):
    """A line of a file that another one includes; its text names the file."""

    file: str

    @classmethod
    def of(cls, file: str, line: int) -> IncludedLine:
        """Return a line of a file, from 1."""
        made = cls(line)
        made.file = file
        return made

    def __str__(self) -> str:
        return f"{int(self)} of {self.file!r}"

    __format__ = object.__format__


@final
@dataclass(eq=False)
class Element:
    """An XML element.

    Attributes
    ----------
    tag : str
    attributes : dict of str to str
    line : int
        Line of the file, from 1; an `IncludedLine` in included files.
    children : list of Element
    text : str
        Between its tags.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> list[Element]:
        """Return the children with a tag."""
        return [child for child in self.children if child.tag == tag]

    def __iter__(self) -> Iterator[Element]:
        return iter(self.children)


@final
class FileReader:
    """Reads the elements of one file; faults are collected with their lines, and raised together.

    Parameters
    ----------
    path : path-like
        The file.
    root : str
        Tag of its outermost element.

    Raises
    ------
    OptionError
        For a path that is no readable file.
    SceneError
        For text that is no XML, with the line.
    """

    def __init__(self, path: str | PathLike[str], root: str) -> None:
        if not isinstance(path, str | PathLike):
            raise OptionError(f"path must be the path of a file, not {path!r}")
        self.path = Path(path)
        self._faults: list[tuple[int, str]] = []
        try:
            data = self.path.read_bytes()
        except OSError as reason:
            raise OptionError(f"{self.path.name!r} cannot be read: {reason.strerror or reason}") from None
        self.root = self._parsed(data, int)
        if self.root.tag != root:
            self.fault(self.root, f"the outermost element is <{self.root.tag}>; expected <{root}>")
            self.raise_faults()

    def include(self, tag: str) -> None:
        """Replace elements with a tag by what stands in the outermost element of their ``file=``.

        Files are looked for beside the first file, then beside the one that includes them; each is included once.
        """
        self._include(self.root, tag, self.path, {self.path.resolve()})

    def _include(self, element: Element, tag: str, within: Path, known: set[Path]) -> None:
        children, element.children = element.children, []
        for child in children:
            if child.tag != tag:
                self._include(child, tag, within, known)
                element.children.append(child)
                continue
            name = self.text(child, "file")
            path = next((p for p in (self.path.parent / name, within.parent / name) if name and p.is_file()), None)
            if path is None:
                if name:
                    self.fault(child, f"<{tag}> of {name!r}: there is no such file beside {within.name!r}")
            elif path.resolve() in known:
                self.fault(child, f"<{tag}> of {name!r}: a file is included once, and may not include itself")
            else:
                known.add(path.resolve())
                root = self._parsed(path.read_bytes(), partial(IncludedLine.of, name))
                self._include(root, tag, path, known)
                element.children += root.children

    def _parsed(self, data: bytes, line_of: Callable[[int], int]) -> Element:
        parser, open_elements = expat.ParserCreate(), [Element("", {}, 0)]

        def start(tag: str, attributes: dict[str, str]) -> None:
            element = Element(tag, attributes, line_of(parser.CurrentLineNumber))
            open_elements[-1].children.append(element)
            open_elements.append(element)
            texts.append([])

        def end(_: str) -> None:
            element = open_elements.pop()
            element.text = "".join(texts.pop())

        texts: list[list[str]] = [[]]
        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.CharacterDataHandler = lambda text: texts[-1].append(text)
        try:
            parser.Parse(data, True)
        except expat.ExpatError as reason:
            self.fault(line_of(reason.lineno), f"the file is no well-formed XML: {expat.ErrorString(reason.code)}")
            self.raise_faults()
        return open_elements[0].children[0]

    # -- faults -------------------------------------------------------------------------------------

    def fault(self, element: Element | int, text: str) -> None:
        """Record a fault at an element, or at a line; a fault of something that is read twice is recorded once."""
        found = (element if isinstance(element, int) else element.line, text)
        if found not in self._faults:
            self._faults.append(found)

    def raise_faults(self) -> None:
        """Raise all faults together, in the order of the lines.

        Raises
        ------
        SceneError
        """
        if self._faults:
            raise SceneError(
                self.path.name, [f"line {line}: {text}" for line, text in sorted(dict.fromkeys(self._faults))]
            )

    def misspelt(self, element: Element, known: Sequence[str], ignored: Iterable[str] = ()) -> None:
        """Record children whose tag is nearly one of the known; others are extensions, and ignored."""
        for child in element:
            close = get_close_matches(child.tag, known, n=1, cutoff=0.75)
            if child.tag not in known and child.tag not in ignored and close:
                self.fault(child, f"unknown element <{child.tag}> in <{element.tag}>; did you mean <{close[0]}>?")

    # -- values -------------------------------------------------------------------------------------

    def only(self, element: Element, tag: str, *, needed: bool = False) -> Element | None:
        """Return the child with a tag, of which there may be one."""
        found = element.all(tag)
        if len(found) > 1:
            self.fault(found[1], f"a second <{tag}> in <{element.tag}> {self.named(element)}; give one")
        if not found and needed:
            self.fault(element, f"<{element.tag}> {self.named(element)} has no <{tag}>")
        return found[0] if found else None

    @staticmethod
    def named(element: Element) -> str:
        """Return the name of an element in quotes, as far as it has one."""
        return repr(element.attributes.get("name", ""))

    def text(self, element: Element, attribute: str, *, allowed: Sequence[str] = ()) -> str:
        """Return an attribute that must be there; empty where it is not."""
        value = element.attributes.get(attribute, "").strip()
        if not value:
            self.fault(element, f"<{element.tag}> has no attribute {attribute}=")
        elif allowed and value not in allowed:
            self.fault(element, f"{attribute}={value!r} of <{element.tag}>: known are {list_names(allowed)}")
            return ""
        return value

    def number(self, element: Element | None, attribute: str, default: float | None) -> float:
        """Return a number; without a default it must be there."""
        return float(self.numbers(element, attribute, 1, None if default is None else [default])[0])

    def numbers(
        self, element: Element | None, attribute: str, count: int, default: Sequence[float] | None
    ) -> FloatArray:
        """Return numbers (count,) separated by blanks; without a default they must be there."""
        given = None if element is None else element.attributes.get(attribute)
        if given is None or element is None:
            if default is None and element is not None:
                self.fault(element, f"<{element.tag}> has no attribute {attribute}=")
            return np.zeros(count) if default is None else np.array(default, dtype=float)
        try:
            values = [float(word) for word in given.split()]
        except ValueError:
            values = []
        if len(values) != count or not all(math.isfinite(value) for value in values):
            what = "a finite number" if count == 1 else f"{count} finite numbers separated by blanks"
            self.fault(element, f"{attribute}={given!r} of <{element.tag}> must be {what}")
            return np.zeros(count) if default is None else np.array(default, dtype=float)
        return np.array(values)

    def unique(self, elements: Iterable[Element]) -> dict[str, Element]:
        """Return elements by their names, which must be different."""
        found: dict[str, Element] = {}
        for element in elements:
            name: Any = self.text(element, "name")
            if name in found:
                first = found[name].line
                self.fault(element, f"a second <{element.tag}> is called {name!r}; the first is in line {first}")
            elif name:
                found[name] = element
        return found
