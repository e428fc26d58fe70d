"""Reactions of joints that constrain, by name: unknown components, which cost nothing unless something asks for them.

A SymPy joint, a `Closure` and their like are `Connection`s of a scene. Their coordinates and constraints are in the
scene from the start. Their unknown reactions become `Joint`s when the scene is compiled, where an output, a contact or
a law of friction contains one of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy import Expr
from sympy.physics.mechanics import Particle, Point, ReferenceFrame
from sympy.physics.vector import Vector

from ...errors import ConstraintError, OptionError, SceneError, UnknownNameError, list_names, unknown_name
from ...frozen import frozen
from .joints import Component, Joint, NamedOutput, Unknown

if TYPE_CHECKING:
    from ..scene import Scene

Triple = tuple[Any, Any, Any]
"""Components of a vector on a frame."""


@final
@frozen
class ActionPair:
    """An action on a body at a point, whose opposite acts on another body at the same point.

    A body that the scene does not have is the fixed frame.
    """

    body: Any
    other: Any
    at: Point
    force: Any = 0
    torque: Any = 0


@final
@frozen
class Connection:
    """A joint that constrains, as its scene knows it.

    Attributes
    ----------
    name : str
    actions : tuple of ActionPair
        Its reaction.
    components : mapping of str to Expr
        Named outputs, in unknown components of the reaction and in coordinates.
    force, torque : Vector
        Action on the child, for other axes.
    closes : bool
        Whether constraints of the scene hold it. Those of a tree are held by the coordinates.
    source : object
        The SymPy joint, or what else it was made from.
    text : str
        What it added to the scene, for `explain`.
    others : mapping of str to Expr
        Named outputs that are no reactions.
    """

    name: str
    actions: tuple[ActionPair, ...]
    components: Mapping[str, Any]
    force: Any
    torque: Any
    closes: bool
    source: Any
    text: str = ""
    others: Mapping[str, Any] = field(default_factory=dict)

    @property
    def unknowns(self) -> set[Unknown]:
        """Unknown components of its actions."""
        return {x for pair in self.actions for vector in (pair.force, pair.torque) for x in _unknowns_in(vector)}


# -- components -------------------------------------------------------------------------------------


def unknown(name: str) -> Unknown:
    """Return an unknown reaction component."""
    return Unknown(name, real=True)


def vector_of(components: Triple, frame: ReferenceFrame) -> Any:
    """Return the vector with components on a frame."""
    return Vector([(sp.Matrix(components), frame)])


def orthogonal(axis: Any) -> tuple[Any, Any]:
    """Return two orthonormal matrices (3, 1) across a unit matrix (3, 1), without a division where it allows that."""
    others = [i for i in range(3) if axis[i] == 0]
    if len(others) == 2:
        first, second = (sp.Matrix([int(i == place) for i in range(3)]) for place in others)
        return first, second
    place = min(range(3), key=lambda i: (sp.sympify(axis[i]) != 0, abs(sp.N(axis[i])) if axis[i].is_number else 2, i))
    first = axis.cross(sp.Matrix([int(i == place) for i in range(3)]))
    if axis[place] != 0:
        first = first / sp.sqrt(sp.simplify(first.dot(first)))
    return first, axis.cross(first)


def across(name: str, axis: Any) -> Triple:
    """Return unknown components across a unit matrix (3, 1): two of the axes, or along two directions of their own."""
    along = [i for i in range(3) if axis[i] != 0]
    if len(along) == 1:
        x, y, z = (sp.S.Zero if i in along else unknown(f"{name}_{'xyz'[i]}") for i in range(3))
        return x, y, z
    first, second = orthogonal(axis)
    x, y, z = unknown(f"{name}_1") * first + unknown(f"{name}_2") * second
    return x, y, z


def everything(name: str) -> Triple:
    """Return three unknown components."""
    return unknown(f"{name}_x"), unknown(f"{name}_y"), unknown(f"{name}_z")


NOTHING: Triple = (sp.S.Zero, sp.S.Zero, sp.S.Zero)


def connection(
    name: str, bodies: tuple[Any, Any], at: Point, frame: ReferenceFrame, action: tuple[Triple, Triple], source: Any
) -> Connection:
    """Return a connection whose action on the child has components of force and torque on a frame.

    `bodies` are child and parent. A particle has no orientation, so that no torque is transmitted to it or by it.
    """
    force, torque = action[0], NOTHING if any(isinstance(body, Particle) for body in bodies) else action[1]
    vectors = vector_of(force, frame), vector_of(torque, frame)
    components = {
        f"{name}.{kind}_{'xyz'[i]}": triple[i]
        for kind, triple in (("force", force), ("torque", torque))
        for i in range(3)
    }
    pair = ActionPair(*bodies, at, *vectors)
    return Connection(name, (pair,), components, *vectors, closes=False, source=source)


# -- in a scene -------------------------------------------------------------------------------------


def has_body(scene: Scene, body: Any) -> bool:
    """Whether a body itself is one of the scene."""
    return any(own is body for own in scene.bodies)


def require_new_name(scene: Scene, name: str) -> None:
    """Raise for a joint that has the name of another."""
    if name in [*(item.name for item in scene.connections), *(joint.name for joint in scene.joints)]:
        raise SceneError(scene.name, [f"two joints are called {name!r}; give each its own name"])


def connection_named(scene: Scene, name: str) -> Connection:
    """Return a connection by its name.

    Raises
    ------
    UnknownNameError
    """
    for item in scene.connections:
        if item.name == name:
            return item
    named = [joint for joint in scene.joints if joint.name == name]
    if named:
        vectors = [v for joint in named for v in (joint.force, joint.torque)]
        names = sorted({str(x) for v in vectors if isinstance(v, Vector) for x in _unknowns_in(v)})
        request = f": compile_model(scene, outputs={names!r})" if names else ", and it has none"
        raise UnknownNameError(
            f"scene {scene.name!r}: {name!r} is a plain da.Joint, whose reactions are its unknowns, by their own names"
            f"{request}. scene.reaction takes joints that constrain: those of SymPy, Closure, Rod and their like"
        )
    known = unknown_name("joint", str(name), [item.name for item in scene.connections])
    raise UnknownNameError(
        f"scene {scene.name!r}: {known} Joints that constrain are those of SymPy,"
        " Closure, Rod and their like; the reaction of a Joint consists of its own unknowns"
    )


def reaction(self: Scene, joint: str, frame: ReferenceFrame | None = None) -> dict[str, Expr]:
    """Return the reaction of a joint that constrains, as outputs by name.

    Parameters
    ----------
    joint : str
        Name of a joint of the scene that constrains.
    frame : ReferenceFrame, optional
        Axes of the components, which are called such as "elbow.force_x on N"; by default those of the joint.

    Returns
    -------
    dict of str to Expr
        Forces [N] and torques [N m] on the child at the joint's point, for ``outputs=``.

    Raises
    ------
    UnknownNameError
        For a joint that the scene does not have, or that does not constrain.
    OptionError
        For axes of a joint whose reaction is no force or torque at a point, such as that of a gear.

    Examples
    --------
    ::

        model = da.compile_model(scene, outputs=scene.reaction("elbow", frame=N))
    """
    found = connection_named(self, joint)
    if frame is None:
        return dict(found.components)
    if found.force is None:
        names = list_names(found.components)
        raise OptionError(
            f"scene {self.name!r}: joint {joint!r} has no components on axes, but {names}: leave frame out"
        )
    return {
        f"{joint}.{kind}_{letter} on {frame.name}": vector.dot(axis)
        for kind, vector in (("force", found.force), ("torque", found.torque))
        for letter, axis in zip("xyz", (frame.x, frame.y, frame.z), strict=True)
    }


def joints_of(scene: Scene, item: Connection) -> tuple[Joint, ...]:
    """Return the reaction of a connection as joints of the scene."""
    found = []
    for pair in item.actions:
        names = [str(body.name) if has_body(scene, body) else None for body in (pair.body, pair.other)]
        if names[0] is not None:
            found.append(Joint(item.name, names[0], pair.at, pair.force, pair.torque, names[1]))
        elif names[1] is not None:
            found.append(Joint(item.name, names[1], pair.at, -pair.force, -pair.torque))
    return tuple(found)


def with_closures(scene: Scene) -> Scene:
    """Return a scene with the reactions of its constraints and contacts as joints."""
    wanted = _of_laws(scene)
    return _with(scene, [item for item in scene.connections if item.closes or wanted & item.unknowns])


def with_reactions(scene: Scene, outputs: Sequence[Any]) -> tuple[Scene, tuple[Any, ...]]:
    """Return a scene with the joints whose reactions outputs, contacts and laws of friction need; and the outputs.

    Named components are replaced by their expressions. In a tree a reaction needs no other. Where constraints or
    contacts close loops, or joints share loads by compliances, what joints leave free decides which reactions are
    determined: all are declared.

    Raises
    ------
    UnknownNameError
        For a component that a joint does not have.
    ConstraintError
        For the reaction of a joint between bodies that the scene does not have.
    """
    if not scene.connections:
        return scene, tuple(outputs)
    components = {
        name: value for item in scene.connections for name, value in (*item.components.items(), *item.others.items())
    }
    outputs = [_resolved(scene, output, components) for output in outputs]
    wanted = _of_laws(scene).union(*map(_unknowns_in, outputs))
    own = {x for joint in scene.joints for v in (joint.force, joint.torque) if v != 0 for x in _unknowns_in(v)}
    wanted |= {x for x in own if str(x) in map(str, outputs)}
    closing = scene.holonomic_constraints, scene.nonholonomic_constraints, scene.contacts, scene.compliances
    loops = bool(wanted and any(closing))
    needed = [item for item in scene.connections if loops or wanted & item.unknowns]
    lost = [item.name for item in needed if wanted & item.unknowns and not joints_of(scene, item)]
    if lost:
        raise ConstraintError(
            f"scene {scene.name!r}: the joints {list_names(map(repr, lost))} connect bodies at rest that the scene does"
            " not have; add their bodies to request their reactions"
        )
    return _with(scene, needed), tuple(outputs)


def _with(scene: Scene, needed: Iterable[Connection]) -> Scene:
    twin = scene.copy()
    twin.joints += tuple(joint for item in needed for joint in joints_of(scene, item))
    return twin


def _resolved(scene: Scene, output: Any, components: Mapping[str, Any]) -> Any:
    """Return an output with the expression of a named component in place of its name."""
    name = output.value if isinstance(output, NamedOutput) else output
    if not isinstance(name, str):
        return output
    if name in components:
        value = components[name]
        if isinstance(value, Unknown) and str(value) == name:
            return output
        return replace(output, value=value) if isinstance(output, NamedOutput) else NamedOutput(name, value)
    for item in scene.connections:
        if name.startswith(f"{item.name}."):
            raise UnknownNameError(
                f"scene {scene.name!r}: {unknown_name('output', name, [*item.components, *item.others])}"
            )
    return output


def _unknowns_in(value: Any) -> set[Unknown]:
    """Return the unknowns in an output: a name, an expression, or a vector."""
    if isinstance(value, NamedOutput):
        return _unknowns_in(value.value)
    if isinstance(value, Component):
        return _unknowns_in(value.vector)
    if isinstance(value, str):
        return {unknown(value)}
    if isinstance(value, Vector):
        return {x for matrix, _ in value.args for x in matrix.atoms(Unknown)}
    return value.atoms(Unknown) if isinstance(value, sp.Basic) else set()


def _of_laws(scene: Scene) -> set[Unknown]:
    """Return the unknowns that contacts and laws of friction name."""
    return set().union(*map(_unknowns_of_law, (*scene.contacts, *scene.frictions)))


def _unknowns_of_law(law: Any) -> set[Unknown]:
    """Return the unknowns that a contact or a law of friction names."""
    given = getattr(law, "tangential", None)
    pair = given if isinstance(given, tuple | list) else (given,)
    return {unknown(str(x)) for x in (getattr(law, "normal", None), *pair) if x is not None}
