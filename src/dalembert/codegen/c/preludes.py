"""Sources in C99 but for their public functions: what is called, tables, printed kernels, and loops."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Any

from ..llvm.vector_functions import shared_constants
from ..rendering import render
from .kernels import elementary_variables, table_variables
from .printing import double


def _numbers(value: Any) -> Any:
    """Return numbers as literals, in tuples and mappings."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    return [_numbers(item) for item in value] if isinstance(value, tuple) else double(value)


def source_of(
    banner: Sequence[str],
    headers: Sequence[str],
    printed: str,
    loops: str = "",
    used: Collection[str] = (),
    run: str = "",
) -> str:
    """Return a source without its public functions: what is called, tables, printed kernels, and loops.

    `used` are the functions of the prelude that the loops call, and `run` is the type of what loops in tables take.
    """
    tables, elementary = table_variables(printed), elementary_variables(printed)
    printed = (render("c/elementary.c.j2", elementary) if elementary else "") + printed
    prelude = {
        "banner": list(banner),
        "headers": list(headers),
        "used": _used(printed + loops, used),
        "runs": [run] if "loop_function" in loops else [],
        "constants": {key: _numbers(value) for key, value in shared_constants().items()},
    }
    text = render("c/prelude.c.j2", prelude)
    return text + (render("c/tables.c.j2", {"tables": tables}) if tables else "") + printed + loops


_PRELUDE = re.compile(r"\b(fused|angle_of|rough_log2|rough_exp2|kernel_function|loop_function|inputs_fit)\b")


def _used(text: str, loops: Collection[str]) -> list[str]:
    """Return the functions of the prelude that a text calls."""
    used = {*loops, *_PRELUDE.findall(text)}
    if used & {"angle_of", "rough_log2", "rough_exp2"}:
        used.add("fused")
    return sorted(used)
