"""The whole derivation of a scene in the order of the text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, final

import sympy as sp

from ..errors import ConstraintError, list_names
from ..frozen import frozen
from .printing import latex, text

if TYPE_CHECKING:
    from .view import LagrangeView

Line = tuple[Any, Any]
"""A sentence (None, text), a labelled expression (label, expression), or an equation (left side, right side)."""

LONG = 600
"""Operations beyond which a closed form is only announced."""


@final
@frozen
class Section:
    """A heading, and lines of which each is a name with an expression, or a sentence."""

    title: str
    lines: tuple[Line, ...]


@final
class Report:
    """The derivation as text (`str`), and as Markdown with LaTeX (in a notebook, or `markdown`)."""

    def __init__(self, view: LagrangeView) -> None:
        self.view = view
        self.sections = tuple(section for section in (build(view) for build in _SECTIONS) if section.lines)

    def __str__(self) -> str:
        title = f"Lagrange equations of {self.view.scene.name}"
        parts = [title, "=" * len(title)]
        for section in self.sections:
            parts += ["", section.title, "-" * len(section.title)]
            for name, item in section.lines:
                if name is None:
                    parts.append(f"  {item}")
                else:
                    parts.append(
                        f"  {name}: {text(item)}" if isinstance(name, str) else f"  {text(name)} = {text(item)}"
                    )
        return "\n".join(parts)

    def markdown(self, level: int = 2) -> str:
        """Return Markdown with LaTeX; `level` is that of the headings."""
        parts = []
        for section in self.sections:
            parts.append(f"{'#' * level} {section.title}\n")
            for name, item in section.lines:
                if name is None:
                    parts.append(f"{item}\n")
                elif isinstance(name, str):
                    parts.append(f"{name[0].upper()}{name[1:]}:\n\n$${latex(item)}$$\n")
                else:
                    parts.append(f"$${latex(name)} = {latex(item)}$$\n")
        return "\n".join(parts)

    def _repr_markdown_(self) -> str:
        return self.markdown()


def _name(coordinate: Any) -> str:
    return str(coordinate.func)


def _constraints(view: LagrangeView) -> Section:
    lines: list[Line] = []
    for c in view.constraints:
        kind = (
            "holonomic"
            if c.holonomic
            else "nonholonomic, integrable"
            if c.integrable
            else "nonholonomic, not integrable"
        )
        kind += ", rheonomic" if c.rheonomic else ""
        why = "" if c.holonomic else f" ({c.reason})"
        lines.append((f"{kind}{why}", c.equation))
    return Section("Constraints", tuple(lines))


def _kinematics(view: LagrangeView) -> Section:
    lines: list[Line] = []
    for body in view.scene.bodies:
        lines.append((f"kinematic screw of {body.name}", view.kinematic_screw(body)))
        for q in view.coordinates:
            screw = view.partial_kinematic_screw(body, q)
            if screw.resultant != 0 or screw.moment != 0:
                lines.append((f"partial kinematic screw of {body.name} for {_name(q)}", screw))
    return Section("Kinematic screws", tuple(lines))


def _actions(view: LagrangeView) -> Section:
    lines: list[Line] = []
    for joint in view.scene.joints:
        name = f"action screw of the joint {joint.name}"
        if joint.other is None:
            lines.append((name, view.action_screw(joint)))
        else:
            for body in (joint.body, joint.other):
                lines.append((f"{name} on {body}", view.action_screw(joint, body)))
        conditions = view.ideal_conditions(joint)
        if not conditions:
            lines.append(
                (None, f"The joint {joint.name} has no power in any motion that the constraints allow: it is ideal.")
            )
        for e in conditions:
            lines.append((f"the joint {joint.name} is ideal when", sp.Eq(e, 0, evaluate=False)))
    return Section("Action screws and ideal joints", tuple(lines))


def _powers(view: LagrangeView) -> Section:
    lines = [(sp.Symbol(f"Q^{_name(q)}"), view.power_coefficient(q)) for q in view.coordinates]
    return Section("Power coefficients", tuple(lines))


def _energy(view: LagrangeView) -> Section:
    return Section("Kinetic energy, all constraints ignored", ((sp.Symbol("2 T"), sp.expand(2 * view.kinetic_energy)),))


def _equations(view: LagrangeView) -> Section:
    lines = [(f"Lagrange equation of {_name(q)}", view.equation(q)) for q in view.coordinates]
    return Section("Lagrange equations", tuple(lines))


def _closed(view: LagrangeView, items: Any) -> list[Line]:
    lines: list[Line] = []
    for name, e in items:
        size = e.count_ops()
        if size > LONG:
            lines.append((None, f"{text(name)}: a closed form of {size} operations, not shown"))
        else:
            lines.append((name, e))
    return lines


def _reactions(view: LagrangeView) -> Section:
    lines: list[Line] = []
    if not view.unknowns:
        return Section("Reactions", ())
    try:
        lines += _closed(view, [(x, e) for x, e in view.reactions.items()])
    except ConstraintError as reason:
        lines.append((None, str(reason)))
    if view.undetermined:
        lost = list_names(str(x) for x in view.undetermined)
        lines.append((None, f"Not determined by these equations: {lost}. Release the coordinate that hides it."))
    return Section("Reactions", tuple(lines))


def _friction(view: LagrangeView) -> Section:
    return Section("Friction, while it slips", tuple(view.friction_laws.items()))


def _motion(view: LagrangeView) -> Section:
    title = "Equations of motion, unknowns eliminated"
    try:
        return Section(title, tuple(_closed(view, view.equations_of_motion.items())))
    except ConstraintError as reason:
        return Section(title, ((None, str(reason)),))


def _states(view: LagrangeView) -> Section:
    return Section("First-order states", tuple(_closed(view, view.state_equations.items())))


def _controllers(view: LagrangeView) -> Section:
    lines: list[Line] = []
    for item in view.scene.controllers:
        when = f"controller {item.name}, every {text(sp.sympify(item.period))}"
        for laws in (item.inputs, item.states):
            if isinstance(laws, Mapping):
                lines += [(f"{when}, sets", sp.Eq(x, sp.sympify(e), evaluate=False)) for x, e in laws.items()]
    return Section("Sampled controllers", tuple(lines))


def _integrals(view: LagrangeView) -> Section:
    if view.scene.frictions:
        return Section("First integrals", ())
    found = view.first_integrals
    lines: list[Line] = [
        (f"{item.name}, because {item.reason}", sp.Eq(item.expression, sp.Symbol("const"), evaluate=False))
        for item in found
    ]
    if found:
        lines.append((None, f"{found.independent} of these are independent on the constraints."))
    lines += [(None, f"None from {reason}.") for reason in found.reasons]
    return Section("First integrals", tuple(lines))


_SECTIONS: tuple[Callable[[Any], Section], ...] = (
    _constraints,
    _kinematics,
    _actions,
    _powers,
    _energy,
    _equations,
    _friction,
    _reactions,
    _motion,
    _states,
    _controllers,
    _integrals,
)
