"""Reading of the contacts and the laws of friction of a scene, with what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, final

import sympy as sp

from ...errors import list_names
from ...ir.node import Node, deps_of
from ..expressions.identity import equal
from ..expressions.reader import short
from ..joints.joints import Unknown
from ..model import ConstraintModel, ContactModel
from .laws import FRICTION_LAWS, CoulombFriction, UnilateralContact, coulomb_law

if TYPE_CHECKING:
    from ..expressions.reader import ExpressionReader
    from ..scene import Scene

Read = Callable[[Any, str], Node]
"""Returns an expression that stands in some place, by its name, as a node."""


@final
class _Reading:
    """One reading of the contacts of a scene."""

    def __init__(
        self, scene: Scene, reading: tuple[ExpressionReader, Read], rates: Sequence[Node], forces: Sequence[str]
    ) -> None:
        self.scene, self.forces = scene, forces
        self.expressions, self.read = reading
        self.rates = rates
        self.faults: list[str] = []

    def unknown(self, symbol: Any, what: str) -> str:
        """Return the name of a reaction component, which some joint must have."""
        name = str(symbol)
        if symbol is None:
            self.faults.append(
                f"{what} is missing: friction needs the normal reaction it is proportional to. Give the joint an"
                " unknown force component along the normal, with da.unknowns, and name it here"
            )
        elif name not in self.forces:
            self.faults.append(
                f"{what} is {name}, which is no unknown of a joint of the scene (they are: {list_names(self.forces)})."
                " Make it with da.unknowns and give it to the Joint of the contact"
            )
        return name

    def normal_of(self, law: CoulombFriction) -> tuple[str, Node | None]:
        """Return the name of the normal reaction of a friction law, and the load where that is given."""
        e, where = self.sympified(law.normal), f"the normal load of friction {law.label!r}"
        if e is None or isinstance(e, Unknown) or str(e) in self.forces:
            return self.unknown(law.normal, f"the normal reaction of friction {law.label!r}"), None
        if reactions := sorted(x.name for x in e.atoms(Unknown)):
            self.faults.append(
                f"{where} contains {list_names(reactions)}, and may contain no unknown unless it is one. A normal force"
                " with two components, as of a ring on a wire, has its size by hand, in coordinates, rates and time"
            )
            return law.label, None
        if law.name is None:
            self.faults.append(f"friction with the normal load {short(e)} has no name; give it one, name=")
        if e.is_negative:
            self.faults.append(f"{where} is {law.normal}; it must not be negative")
        load, own = self.read(e, where), Unknown(f"{law.label}.normal", real=True)
        self.expressions.read(own, where, unknowns=True)
        return own.name, load if e.is_nonnegative else self.expressions.graph.call("abs", load)

    def sympified(self, value: Any) -> Any:
        """Return an expression of SymPy, or None where the value is not one."""
        try:
            e = None if isinstance(value, str | bytes) else sp.sympify(value)
        except (sp.SympifyError, TypeError, ValueError, AttributeError, RecursionError):
            return None
        return e if isinstance(e, sp.Expr) else None

    def number(self, value: Any, what: str, *, most: float | None = None) -> Node:
        """Return a coefficient, which may not be negative."""
        e = self.sympified(value)
        if e is None:
            return self.read(value, what)
        known = e.is_number and e.is_real
        if e.is_negative or (known and most is not None and e > most):
            span = "not be negative" if most is None else f"lie between 0 and {most:g}"
            self.faults.append(f"{what} is {value}; it must {span}")
        return self.read(e, what)

    def friction(self, law: CoulombFriction, held: dict[str, Any]) -> None:
        """Add the fields of a friction law to those of its contact."""
        where = f"friction {law.label!r}"
        pair = law.tangential if isinstance(law.tangential, tuple | list) else (law.tangential,)
        slips = None if law.slip is None else law.slip if isinstance(law.slip, tuple | list) else (law.slip,)
        if len(pair) not in (1, 2) or (slips is not None and len(slips) != len(pair)):
            self.faults.append(f"{where}: tangential and slip must be one expression each, or a pair each")
            return
        names = tuple(self.unknown(symbol, f"the tangential reaction of {where}") for symbol in pair)
        if len({held["normal"], *names}) <= len(names):
            self.faults.append(f"{where}: its normal and tangential reactions must be different unknowns")
        if law.mu is None:
            self.faults.append(f"{where}: mu is missing; give the coefficient of friction, a symbol or a number")
            return
        held["tangential"] = names
        mu, at_rest = self.coefficient(law, held) if callable(law.mu) else (law.mu, law.mu)
        held["mu"] = self.number(mu, f"mu of {where}")
        static = at_rest if law.mu_static is None else law.mu_static
        same = static is mu
        held["mu_static"] = held["mu"] if same else self.number(static, f"mu_static of {where}")
        both = (self.sympified(at_rest), self.sympified(static))
        if all(e is not None and e.is_number and e.is_real for e in both) and both[1] < both[0]:
            self.faults.append(f"{where}: mu_static is {static}, less than mu = {at_rest}; it is at least as large")
        if law.regularization is not None:
            held["regularization"] = self.number(law.regularization, f"regularization of {where}")
            if held["regularization"].is_zero:
                self.faults.append(f"{where}: the slip speed of its regularization is zero; leave it out")
        if slips is not None:
            held["slip"] = tuple(self.slip(slip, where) for slip in slips)

    def coefficient(self, law: CoulombFriction, held: dict[str, Any]) -> tuple[Any, Any]:
        """Return mu as a function of the slip speed, and what it is at rest."""
        speed = sp.Symbol(f"slip speed of {law.label}", nonnegative=True)
        held["slip_speed"] = self.expressions.graph.input(speed.name)
        self.expressions.define({speed: held["slip_speed"]})
        try:
            return law.mu(speed), law.mu(sp.S.Zero)
        except Exception as error:  # whatever a user's function raises
            self.faults.append(f"mu of friction {law.label!r} as a function of the slip speed raised {error!r}")
            return 0, 0

    def slip(self, expression: Any, where: str) -> Node:
        """Return a slip velocity, which must be affine in the rates."""
        from ...transforms.derivatives import tangents

        place = f"slip velocity of {where}"
        before = len(self.expressions.faults)
        node, graph = self.read(expression, place), self.expressions.graph
        slopes = [tangents(graph, [node], {rate: graph.one})[0] for rate in self.rates]
        if len(self.expressions.faults) == before and (
            all(slope.is_zero for slope in slopes) or any(graph.freed_of(slope, self.rates) is None for slope in slopes)
        ):
            self.faults.append(f"the {place}, {expression}, is not affine in the rates; write a velocity component")
        return node

    def gap(self, contact: UnilateralContact, more: list[ConstraintModel], coordinates: int) -> dict[str, Any]:
        """Return gap, number and sense of the holonomic constraint of a contact, a new one in `more` if need be."""
        where = f"gap of contact {contact.label!r}"
        before = len(self.expressions.faults)
        node = self.read(contact.gap, where)
        mask = deps_of(self.rates)
        if len(self.expressions.faults) == before and (node.deps & mask or not node.deps & coordinates):
            self.faults.append(f"the {where}, {contact.gap}, must be in coordinates (and time), without rates")
        readable = len(self.expressions.faults) == before
        for i, constraint in enumerate(self.scene.holonomic_constraints if readable else ()):
            if self.sympified(constraint) is None:
                continue
            for sense in (1, -1):
                if equal(contact.gap, sense * constraint):
                    return {"gap": node, "constraint": i, "sense": sense}
        more.append(ConstraintModel(f"contact {contact.label!r}, {short(contact.gap, 400)} = 0", node))
        return {"gap": node, "constraint": len(self.scene.holonomic_constraints) + len(more) - 1}


def read_contacts(
    scene: Scene,
    reading: tuple[ExpressionReader, Read],
    rates: Sequence[Node],
    coordinates: int,
    forces: Sequence[str],
    fault: Callable[[str], None],
) -> tuple[list[ContactModel], list[ConstraintModel]]:
    """Return the contacts of a scene, and the constraints they add to its holonomic ones.

    `reading` is the reader of the scene, and what reads expressions that the motion depends on with it. `rates` are
    the nodes of the rates, `coordinates` the mask of the coordinates, `forces` the unknowns of joints; what is wrong
    goes to `fault`.
    """
    contacts = _Reading(scene, reading, rates, forces)
    more: list[ConstraintModel] = []
    found: dict[str, dict[str, Any]] = {}
    for contact in scene.contacts:
        if not isinstance(contact, UnilateralContact):
            contacts.faults.append(f"{contact!r} is not a UnilateralContact")
            continue
        normal = contacts.unknown(contact.normal, f"the normal reaction of contact {contact.label!r}")
        if normal in found:
            contacts.faults.append(f"two contacts have the normal reaction {normal}; each needs its own")
            continue
        found[normal] = {
            "name": contact.label,
            "normal": normal,
            **contacts.gap(contact, more, coordinates),
            "restitution": contacts.number(contact.restitution, f"restitution of contact {contact.label!r}", most=1.0),
        }
    opening, further = set(found), dict[str, list[dict[str, Any]]]()
    for given in scene.frictions:
        law = coulomb_law(given)
        if law is None:
            contacts.faults.append(f"{given!r} is not a {' or a '.join(law.__name__ for law in FRICTION_LAWS)}")
            continue
        normal, load = contacts.normal_of(law)
        held = found.setdefault(normal, {"name": law.label, "normal": normal, "normal_load": load})
        named = law.name if isinstance(law.name, str) else None  # any other name is a fault of its own
        own = named is None or named == held["name"] or normal not in opening
        if own and "tangential" in held:
            contacts.faults.append(
                f"two frictions have the normal reaction {normal}: several laws, as of sliding and rolling, need a"
                " UnilateralContact with that normal reaction, and a name= each, but for one with the contact's or none"
            )
            continue
        if not own:
            held = {"name": law.label, "normal": normal, "follows": held["name"]}
            further.setdefault(normal, []).append(held)
        contacts.friction(law, held)
    every = [item for normal, held in found.items() for item in (held, *further.get(normal, ()))]
    owner: dict[str, str] = {}
    for held in every:
        for force in held.get("tangential", ()):
            if force in owner:
                contacts.faults.append(
                    f"two laws of friction have the reaction {force}: {owner[force]!r} and {held['name']!r}; each needs"
                    " an unknown of its own, such as a moment for rolling"
                )
            owner[force] = held["name"]
    names = [held["name"] for held in every]
    for name in sorted({name for name in names if names.count(name) > 1}):
        contacts.faults.append(f"two contacts are called {name!r}; give each its own name=")
    for text in contacts.faults:
        fault(text)
    if contacts.faults:
        return [], []
    return [ContactModel(**held) for held in every], more
