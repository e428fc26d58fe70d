"""The check of prose finds phrases of tests/phrases.md where readers meet them, and nothing in code."""

import pytest

import prose

KNOWN = prose.phrases()


@pytest.mark.parametrize("phrase", ["It is refused by name.", "what is left\nof the constraint", "the run goes on"])
def test_phrases_in_pages_are_found(phrase):
    page = f"# A page\n\n```python\nx = 'refused'\n```\n\nA `refused` name. {phrase}\n"
    (found,) = prose.findings(page, prose.prose_of_page, KNOWN)
    assert found.startswith("7: ") and "write: " in found


def test_phrases_in_docstrings_and_messages_are_found():
    module = '''"""It is
refused."""


def refuse(refused):
    raise ValueError(f"input {refused!r} cannot"
                     f" serve {refused}")
'''
    found = prose.findings(module, prose.prose_of_module, KNOWN)
    assert [line.split(";")[0] for line in found] == ["1: 'refused'", "6: 'cannot serve'"]
    assert prose.worth_parsing(module, KNOWN)


def test_the_project_has_none(capsys):
    assert prose.main() == 0, capsys.readouterr().out
