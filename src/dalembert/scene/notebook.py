"""Text that notebooks show of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from sympy.physics.vector import vlatex

if TYPE_CHECKING:
    from .scene import Scene


def description(scene: Scene) -> str:
    """Return the contents of a scene as Markdown with LaTeX."""
    parts = [
        f"**Scene {scene.name}** in the frame {scene.frame}",
        _line("Coordinates", (f"${vlatex(q)}$" for q in scene.coordinates)),
        _line("Inputs", (f"${vlatex(u)}$" for u in scene.inputs)),
        _line("Bodies", (_body(body) for body in scene.bodies)),
        _line(
            "Joints",
            [*(f"{joint.name} of {joint.body}" for joint in scene.joints), *(item.name for item in scene.connections)],
        ),
        _line("Contacts", (str(contact.name) for contact in scene.contacts)),
        _line("Friction", (str(law.name) for law in scene.frictions)),
        _line("Compliances", (f"{key}: ${vlatex(c)}$" for key, c in scene.compliances)),
        _line("Loads", [f"{len(scene.loads)}"] if scene.loads else []),
        _line("Gravity", [f"${vlatex(scene.gravity)}$"] if scene.gravity is not None else []),
        _line("Holonomic constraints", (f"$0 = {vlatex(e)}$" for e in scene.holonomic_constraints)),
        _line("Nonholonomic constraints", (f"$0 = {vlatex(e)}$" for e in scene.nonholonomic_constraints)),
    ]
    return "\n\n".join(part for part in parts if part)


def _line(title: str, items: Iterable[str]) -> str:
    listed = list(items)
    return f"{title}: {', '.join(listed)}" if listed else ""


def _body(body: Any) -> str:
    name, mass = getattr(body, "name", str(body)), getattr(body, "mass", None)
    return name if mass is None else f"{name} (mass ${vlatex(mass)}$)"
