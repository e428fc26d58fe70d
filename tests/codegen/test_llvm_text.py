"""LLVM assembly: golden files, and memory that is too large for the stack."""

from pathlib import Path

import llvmlite.binding as llvm
import pytest

from codegen.llvm_texts import FURTHER_TEXTS, TEXTS
from dalembert.codegen.llvm import order_loops

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
    llvm.parse_assembly(text).verify()
    assert text.endswith("\n") and not text.endswith("\n\n")
    assert "\n\n\n" not in text
    assert not [line for line in text.splitlines() if line != line.rstrip()]


def test_order_loop_whose_rows_are_too_large_for_the_stack_takes_memory_and_frees_it(monkeypatch):
    monkeypatch.setattr(order_loops, "_LARGEST_FRAME", 0)
    text = TEXTS["pendulum_order_loop"]()
    llvm.parse_assembly(text).verify()
    assert "alloca" not in text
    assert text.count("call ptr @malloc") == text.count("call void @free(ptr %n.memory)\n  ret void") == 1
