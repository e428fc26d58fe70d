"""Write the generated parts of docs/limits.md: ``python docs/generate_limits.py``.

What backends support is what their `serving` and `capabilities` declare, for a small scene in every formulation. The
list of errors is read from the source: every CapabilityError and FormulationError, with its reason.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS, Backend, backend_named
from dalembert.codegen.base import Capability
from dalembert.errors import DalembertError
from dalembert.ir.program import Program
from dalembert.reduction import FORMULATIONS
from dalembert.runs.capabilities import WITHOUT

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "limits.md"
UNSUPPORTED = ("CapabilityError", "FormulationError")
CALLS = {
    Capability.KERNEL_FUNCTIONS: "`model.kernels`",
    Capability.VECTOR_FIELD: "`model.vector_field`",
    Capability.STATE_FUNCTIONS: "`model.functions`",
    Capability.SOLVE_FUNCTION: "`model.solve_fn`",
}
TOPICS = {
    "analysis": "inverse dynamics",
    "codegen": "backends",
    "export": "exports",
    "interop": "CasADi",
    "jax": "JAX",
    "model": "models",
    "phases": "contacts",
    "reduction": "formulations",
    "runs": "controllers",
}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def _methods(backend: Backend, program: Program) -> str:
    try:
        return ", ".join(f"`{name}`" for name in backend.serving(program)) or "-"
    except DalembertError:
        return "-"


def _with_a_compiled_function() -> Program:
    import numba

    @numba.njit  # type: ignore[untyped-decorator]
    def law(x):  # type: ignore[no-untyped-def]
        return -x

    x, m = dynamicsymbols("x"), symbols("m", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("spring", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, da.compiled(law, x) * N.x))
    return da.compile_model(scene, backend="numpy").stages.program


def support() -> str:
    """Return what each backend supports, a row a formulation or a feature."""
    backends = {name: backend_named(name) for name in BACKENDS}
    sleigh = da.scenes.chaplygin_sleigh()
    alike: dict[tuple[str, ...], list[str]] = {}
    for formulation in FORMULATIONS:
        program = da.compile_model(sleigh, backend="numpy", formulation=formulation).stages.program
        methods = tuple(_methods(backend, program) for backend in backends.values())
        alike.setdefault(methods, []).append(f"`{formulation}`")
    rows = [[", ".join(names), *methods] for methods, names in alike.items()]
    program = _with_a_compiled_function()
    rows.append(["`da.compiled` functions", *(_methods(backend, program) for backend in backends.values())])
    for capability, call in CALLS.items():
        rows.append([call, *("yes" if capability in backend.capabilities else "-" for backend in backends.values())])
    largest = (f"{backend.largest:,}" if backend.largest else "no limit" for backend in backends.values())
    rows.append(["operations of a right-hand side before compilation takes minutes", *largest])
    return table(["", *(f"`{name}`" for name in backends)], rows)


def _part(part: ast.expr) -> str:
    if isinstance(part, ast.Constant):
        return str(part.value)
    shared = isinstance(part, ast.FormattedValue) and isinstance(part.value, ast.Name) and part.value.id == "WITHOUT"
    return WITHOUT if shared else "…"


def _messages(tree: ast.Module) -> Iterator[str]:
    """Yield the messages of the errors in a module, with an ellipsis for what a call fills in."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in UNSUPPORTED and node.args:
            message = node.args[0]
            yield "".join(map(_part, message.values if isinstance(message, ast.JoinedStr) else [message]))


def split(message: str) -> tuple[str, str]:
    """Return reason and remedy of a message: a last sentence that begins with a verb, or what follows the colon."""
    text = re.sub(r" \(…\)|, and this model is …|\. Missing: …|^(scene |at t = )?…:? (?=\w+ \w)", "", message)
    for verbs, subject in (("does", "a call that"), ("has|cannot", "a scene that")):
        text = re.sub(rf"^({verbs})\b", rf"{subject} \1", text)
    text = re.sub(r"^… calls\b|^calls\b", "sensitivities, sweeps and prepared runs call", text)
    for mark in (r"\. (?=(?:Use|Compile|Write|Let)\b)", r": (?!…)|; (?=give)"):
        reason, *remedy = re.split(mark, text, maxsplit=1)
        if remedy:
            return reason, remedy[0]
    return text.removesuffix(": …"), "the message names it"


def errors() -> str:
    """Return every error that says that something is not supported, a line an error, without its remedy."""
    found: dict[tuple[str, str], None] = {}
    for path in sorted((ROOT / "src" / "dalembert").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if any(name in text for name in UNSUPPORTED):
            folder = path.relative_to(ROOT / "src" / "dalembert").parts[0]
            for message in (found for found in _messages(ast.parse(text)) if found.strip("…")):
                reason, remedy = split(message)
                found[TOPICS[folder], reason if reason.strip("…") else remedy] = None
    for capability in Capability:
        if capability not in CALLS:  # which the table of backends has
            found["backends", split(capability.value)[0]] = None
    topics = dict.fromkeys(topic for topic, _ in sorted(found))
    lists = ("\n".join(f"- {text}" for own, text in sorted(found) if own == topic) for topic in topics)
    return "\n\n".join(f"**{topic}**\n\n{lines}" for topic, lines in zip(topics, lists, strict=True))


def generated() -> Mapping[str, str]:
    """Return the text of each generated part by its name."""
    return {"support": support(), "errors": errors()}


def filled(page: str) -> str:
    """Return a page with its generated parts anew."""
    for name, text in generated().items():
        begin, end = (f"<!-- {name}: {edge} (docs/generate_limits.py) -->" for edge in ("begin", "end"))
        before, rest = page.split(begin)
        page = f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}"
    return page


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
