"""LLVM assembly: golden files, and memory that is too large for the stack."""

from dataclasses import replace
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from codegen.llvm_texts import FURTHER_TEXTS, TEXTS
from codegen.programs import oscillator
from dalembert.codegen.llvm import target as lane_types
from dalembert.codegen.llvm.backend import LLVMLibrary

PRELUDE = "declare double @sin(double)\n"
"""How modules of kernels and steps begin."""
GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.mark.parametrize("name", TEXTS)
def test_text_is_that_of_the_golden_file(name, request):
    """Renew with ``pytest tests/codegen --update-golden``, and read the difference before it is committed."""
    path = GOLDEN / f"{name}.ll"
    text = TEXTS[name]().replace("llvm.fmuladd", "llvm.fma")  # which of them is a matter of the target
    if request.config.getoption("--update-golden", default=False):
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def test_golden_files_are_those_of_the_texts():
    assert {path.stem for path in GOLDEN.glob("*.ll")} == set(TEXTS)


@pytest.mark.parametrize("write", [*TEXTS.values(), *FURTHER_TEXTS])
def test_text_is_a_valid_module_and_neatly_laid_out(write):
    text = write()
    for module in text.split(PRELUDE)[1:] or [text]:
        llvm.parse_assembly(PRELUDE + module).verify()
    assert text.endswith("\n") and not text.endswith("\n\n")
    assert "\n\n\n" not in text
    assert not [line for line in text.splitlines() if line != line.rstrip()]


@pytest.mark.parametrize("name", ["pendulum_order_loop", "pendulum_series_loop"])
def test_step_whose_memory_is_too_large_for_the_stack_takes_it_and_frees_it(name, monkeypatch):
    monkeypatch.setattr(lane_types, "_LARGEST_FRAME", 0)
    text = TEXTS[name]()
    llvm.parse_assembly(text).verify()
    assert "alloca" not in text
    assert text.count("call ptr @malloc") == text.count("call void @free(ptr %n.memory)\n  ret void") == 1


def test_source_says_what_it_was_made_from():
    program = replace(oscillator(), name='quotes " and\n; lines\ndefine void @f() {')
    text = LLVMLibrary(program, None).source("dop853", 0)
    banner, empty, *_ = text.partition("\n\n")
    assert empty and all(line.startswith("; ") for line in banner.splitlines())
    assert "@f" in banner and "@f" not in text.removeprefix(banner)
    assert text.count("\ndefine void @") == 2
