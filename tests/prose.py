"""Check pages, docstrings and messages for phrases that tests/phrases.md lists: ``python tests/prose.py``.

It prints one line a finding and exits with 1 if there are any. Code and names in backticks are not checked.
"""

import ast
import re
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PHRASES = Path(__file__).with_name("phrases.md")
LATER = ()
"""Pages that are not checked yet."""

ROW = re.compile(r"^\| `(.+)` \| (.+) \|$", re.M)
CODE = re.compile(r"^( *)```.*?^\1```|`[^`\n]*`|\]\([^)\n]*\)|^    [^\n]*$|^\|[-: |]+\|$", re.M | re.S)


def phrases(page=PHRASES):
    """Return pairs of a regular expression and what to write instead."""
    rows = ROW.findall(page.read_text(encoding="utf-8"))
    return [(re.compile(r"\b" + phrase.replace("\\|", "|"), re.I), instead) for phrase, instead in rows]


def prose_of_page(text):
    """Return pairs of a line number and a paragraph of a page, without code."""
    blank = CODE.sub(lambda match: "\n" * match[0].count("\n"), text)
    for match in re.finditer(r"(?:^.*\S.*\n?)+", blank, re.M):
        yield text_line(blank, match.start()), match[0]


def text_line(text, start):
    """Return the number of the line that an index of a text is in."""
    return text.count("\n", 0, start) + 1


def prose_of_module(text):
    """Return pairs of a line number and a string of a module: docstrings and whole messages."""
    tree = ast.parse(text)
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            values = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
            yield node.lineno, "".join(map(str, values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            if id(node) not in parts:
                yield node.lineno, CODE.sub("", node.value) if "\n" in node.value else node.value


def findings(text, prose, known):
    """Return a line of what is found, for each phrase in a text."""
    found = []
    for line, part in prose(text):
        joined = " ".join(part.split())
        found += [
            f"{line}: {match[0]!r}; write: {instead}" for phrase, instead in known for match in phrase.finditer(joined)
        ]
    return found


def worth_parsing(text, known):
    """Return whether a module may contain a phrase, which costs less than its syntax tree."""
    joined = re.sub(r"\"\s+f?\"", "", " ".join(text.split()))
    return _any_phrase(tuple(phrase.pattern for phrase, _ in known)).search(joined) is not None


@cache
def _any_phrase(patterns):
    """Return one expression for all phrases: a search for it takes a fifth of the time of searches for each."""
    return re.compile("|".join(patterns), re.I)


def main():
    """Check everything; return 1 where something is found."""
    known = phrases()
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    pages += (ROOT / "docs" / "inside").glob("*.md")
    kept = [page for page in sorted(pages) if page.name not in LATER]
    found = []
    for path in [*kept, *sorted((ROOT / "src").rglob("*.py"))]:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".md" or worth_parsing(text, known):
            prose = prose_of_page if path.suffix == ".md" else prose_of_module
            found += [f"{path.relative_to(ROOT)}:{line}" for line in findings(text, prose, known)]
    print("\n".join(found), end="\n" if found else "")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
