"""`LagrangeView`: the derivations of section 13.4 for any scene."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.physics.mechanics import Point

from ..errors import SceneError, list_names
from ..naming import rate_name
from ..scene import Scene, Unknown
from ..scene.expressions.vector_products import multiplied_out
from .actions import Actions, Screw
from .constraints import Constraint, classify, pfaffian
from .energy import check_kinetic_energy, kinetic_energy, lagrange_operator, readable
from .geometry import Geometry
from .ideal import friction_forces, friction_laws, ideal_conditions, refuse_friction, single_unknowns
from .integrals import FirstIntegrals, first_integrals
from .numeric import PlainSystem, States
from .solution import Solution, reactions_of

if TYPE_CHECKING:
    from .report import Report


@final
class LagrangeView:
    """The Lagrange equations of one scene, derived on demand; made by `dalembert.lagrange`."""

    def __init__(self, scene: Scene, given_energy: Any = None) -> None:
        self.scene = scene
        self.coordinates: tuple[Any, ...] = tuple(scene.coordinates)
        self.geometry = Geometry(scene)
        self.actions = Actions(self.geometry, self.coordinates)
        self.time = self.geometry.time
        if given_energy is not None:
            given = self.geometry.put(given_energy)
            check_kinetic_energy(
                scene.name, given, self.kinetic_energy, self.constraints, self.coordinates, self._states
            )
            self.__dict__["kinetic_energy"] = given

    # -- screws ---------------------------------------------------------------------------

    def kinematic_screw(self, body: Any, point: Point | None = None) -> Screw:
        """Return the kinematic screw of a body (name or object) at its mass centre, or at `point`."""
        screw = self.actions.kinematic_screw(self.actions.body(body))
        return self._tidy(screw if point is None else screw.at(point))

    def partial_kinematic_screw(self, body: Any, coordinate: Any, point: Point | None = None) -> Screw:
        """Return the partial kinematic screw of a body for a coordinate (13.4.2), at its mass centre or at `point`."""
        screw = self.actions.partial_kinematic_screw(self.actions.body(body), self._coordinate(coordinate))
        return self._tidy(screw if point is None else screw.at(point))

    def action_screw(self, joint: Any, body: Any = None) -> Screw:
        """Return the action screw of a joint (name or object) at its reduction point, on its body or on `body`.

        The other body of a joint between two has the opposite screw.
        """
        on = None if body is None else self.actions.body(body)
        return self.actions.action_screw(self.actions.joint(joint), on)

    def slip_velocity(self, joint: Any) -> Any:
        """Return the velocity of the body at the joint, with the constraints used: what friction there opposes.

        At a joint between two bodies it is relative to the other body.
        """
        item = self.actions.joint(joint)
        frame = getattr(self.actions.body(item.body), "frame", self.scene.frame)
        expressed = self.geometry.express(self.actions.relative_screw(item).moment, frame)
        return self.geometry.map(expressed, lambda e: self.on_constraints(e))

    def _tidy(self, screw: Screw) -> Screw:
        move = self.geometry.map
        return Screw(move(screw.resultant, readable), move(screw.moment, readable), screw.point, self.geometry)

    def _coordinate(self, coordinate: Any) -> Any:
        for q in self.coordinates:
            if coordinate == q or str(coordinate) == str(q.func):
                return q
        known = list_names(str(q.func) for q in self.coordinates)
        raise SceneError(self.scene.name, [f"{coordinate} is no coordinate of the scene; known: {known}"])

    # -- energy and power -----------------------------------------------------------------

    @cached_property
    def kinetic_energy(self) -> sp.Expr:
        """Kinetic energy T of all bodies, with every constraint ignored (assumption 13.1.2)."""
        return readable(self._kinetic_energy)

    @cached_property
    def _kinetic_energy(self) -> Any:
        return sum((kinetic_energy(self.geometry, body) for body in self.scene.bodies), sp.S.Zero)

    @cached_property
    def potential_energy(self) -> sp.Expr:
        """Potential energy of gravity."""
        return readable(self.actions.gravity_potential())

    def power_coefficient(self, coordinate: Any, *, ideal: bool = False) -> sp.Expr:
        """Return the power coefficient of a coordinate: gravity, loads and joints, unknowns included.

        Parameters
        ----------
        coordinate : dynamicsymbol or str
        ideal : bool
            Whether unknowns that an ideal joint makes zero are left out.
        """
        q = self._coordinate(coordinate)
        total = self.actions.given_power(q)
        total += sum((self.actions.joint_power(joint, q) for joint in self.scene.joints), sp.S.Zero)
        if ideal:
            total = total.xreplace(dict.fromkeys(self.vanishing, sp.S.Zero))
        return readable(total)

    def lagrange_expression(self, coordinate: Any) -> sp.Expr:
        """Return (d/dt d/dq_dot - d/dq) T."""
        return readable(lagrange_operator(self.kinetic_energy, self._coordinate(coordinate)))

    def equation(self, coordinate: Any, *, ideal: bool = False) -> sp.Eq:
        """Return the Lagrange equation of a coordinate: inertia on the left, power coefficients on the right."""
        right = self.power_coefficient(coordinate, ideal=ideal)
        return sp.Eq(self.lagrange_expression(coordinate), right, evaluate=False)

    # -- constraints ----------------------------------------------------------------------

    @cached_property
    def _vanishing_expressions(self) -> tuple[list[Any], list[Any]]:
        """The expressions of holonomic and nonholonomic constraints."""
        put, scene = self.geometry.put, self.scene
        holonomic = [put(multiplied_out(c)) for c in scene.holonomic_constraints]
        return holonomic, [put(c) for c in scene.nonholonomic_constraints]

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """The constraints, holonomic ones first, nonholonomic ones classified by the Frobenius condition."""
        return classify(*self._vanishing_expressions, self.coordinates, self.time)

    @cached_property
    def unknowns(self) -> tuple[Any, ...]:
        """The unknown components of the joints' action screws, in the order of the scene."""
        found: dict[Any, None] = {}
        for joint in self.scene.joints:
            for vector in (joint.force, joint.torque):
                for matrix, _ in self.geometry.vector(vector).args:
                    found |= dict.fromkeys(
                        x for e in matrix for x in sp.preorder_traversal(e) if isinstance(x, Unknown)
                    )
        return tuple(found)

    def ideal_conditions(self, joint: Any) -> list[sp.Expr]:
        """Return the expressions that must vanish for the joint to be ideal, X = 0 and the like."""
        item = self.actions.joint(joint)
        return ideal_conditions(self.actions, item, self.unknowns, self._solution.free, self._states)

    @cached_property
    def vanishing(self) -> tuple[Any, ...]:
        """The unknowns that ideal joints make zero."""
        held = friction_forces(self.scene.frictions)
        found = (x for joint in self.scene.joints for x in single_unknowns(self.ideal_conditions(joint)))
        return tuple(x for x in found if str(x) not in held)

    @cached_property
    def friction_laws(self) -> dict[Any, Any]:
        """Friction force -> expression in the normal reaction and the rates, while the contact slips: -mu N sign(w).

        The slip velocity w is what the force has power on, so that friction opposes slip and is of size mu N where the
        normal reaction presses (equation (4) of example 13.4.2). Components in two directions are ``-mu N w / |w|``.
        """
        return friction_laws(self.actions)

    def _ideal(self, what: str) -> None:
        refuse_friction(self.scene.name, self.scene.frictions, what)

    # -- what follows ---------------------------------------------------------------------

    @cached_property
    def system(self) -> PlainSystem:
        """The equations in plain symbols, M q_ddot + bias = given + power X, for numbers and algebra."""
        powers = []
        for q in self.coordinates:
            total = sum((self.actions.joint_power(joint, q) for joint in self.scene.joints), sp.S.Zero)
            powers.append([total.diff(x) for x in self.unknowns])
        return PlainSystem(
            self._kinetic_energy,
            [self.actions.given_power(q) for q in self.coordinates],
            powers,
            pfaffian(*self._vanishing_expressions, self.coordinates, self.time),
            self._vanishing_expressions[0],
            self.coordinates,
            self.time,
            {z: self.geometry.put(rate) for z, rate in self.scene.states},
        )

    @cached_property
    def _states(self) -> States:
        return States(self.system)

    @cached_property
    def _solution(self) -> Solution:
        released: dict[Any, Any] = {}
        for item in self.scene.releases:
            if item.coordinate in self.coordinates:
                value = self.geometry.put(item.value).xreplace(released)
                released |= {item.coordinate.diff(self.time): value.diff(self.time), item.coordinate: value}
        return Solution(self.system, self._states, self.unknowns, released)

    @cached_property
    def equations_of_motion(self) -> dict[Any, Any]:
        """q_ddot -> expression in coordinates, rates and time, unknowns eliminated.

        Raises
        ------
        ConstraintError
            For a scene with friction.
        """
        self._ideal("the equations of motion")
        second = [q.diff(self.time, 2) for q in self.coordinates]
        return dict(zip(second, self._solution.accelerations(), strict=True))

    @cached_property
    def state_equations(self) -> dict[Any, Any]:
        """z_dot -> expression in time, coordinates, rates and states, for the first-order states of the scene."""
        put, system = self.geometry.put, self.system
        table = {z.diff(self.time): system.scene(system.plain(put(rate))) for z, rate in self.scene.states}
        return {rate: readable(e) for rate, e in table.items()}

    @cached_property
    def undetermined(self) -> tuple[Any, ...]:
        """The unknowns that no equation determines."""
        return tuple(self.unknowns[i] for i in self._solution.undetermined())

    @cached_property
    def determined(self) -> tuple[Any, ...]:
        """The unknowns that the equations determine."""
        return tuple(x for x in self.unknowns if x not in self.undetermined)

    @cached_property
    def reactions(self) -> Mapping[Any, Any]:
        """Unknown -> expression in coordinates, rates and time, for those that are determined.

        Raises
        ------
        ConstraintError
            When the joints cannot exert the reactions of the constraints, or the scene has friction; and, on access,
            for an unknown that is not determined.
        """
        self._ideal("the reactions")
        return reactions_of(self._solution, self.scene.name)

    @cached_property
    def multipliers(self) -> dict[Any, Any]:
        """Multiplier lambda_i -> expression, for the constraints in their order."""
        self._ideal("the multipliers")
        names = self._multiplier_names()
        return dict(zip(names, self._solution.multipliers(), strict=True)) if names else {}

    def _multiplier_names(self) -> list[Any]:
        return [sp.Symbol(f"lambda_{i + 1}") for i in range(len(self.constraints))]

    def multiplier_equations(self) -> list[sp.Eq]:
        """Return the Lagrange equations with multipliers in place of the unknown reactions (section 13.6)."""
        names, equations = self._multiplier_names(), []
        for i, q in enumerate(self.coordinates):
            right = readable(self.actions.given_power(q))
            right += sum((x * c.form[i] for x, c in zip(names, self.constraints, strict=True)), sp.S.Zero)
            equations.append(sp.Eq(self.lagrange_expression(q), right, evaluate=False))
        return equations

    def maggi_equations(self) -> list[sp.Eq]:
        """Return the equations projected on the virtual motions that the constraints leave free (Maggi, Kane)."""
        self._ideal("Maggi's equations")
        left = sp.Matrix([self.lagrange_expression(q) for q in self.coordinates])
        right = sp.Matrix([readable(self.actions.given_power(q)) for q in self.coordinates])
        free = self._solution.free
        return [sp.Eq(readable((s.T * left)[0]), readable((s.T * right)[0]), evaluate=False) for s in free]

    @cached_property
    def first_integrals(self) -> FirstIntegrals:
        """Expressions that are constant along every motion; `reasons` says why others are none."""
        self._ideal("the first integrals")
        from .printing import text

        moving = [text(c.equation) for c in self.constraints if c.rheonomic or c.form[-1] != 0]
        loads = [
            sum((self.actions.load_power(load, q) for load in self.actions.loads), sp.S.Zero) for q in self.coordinates
        ]
        return first_integrals(
            self.coordinates, self.time, self.kinetic_energy, self.potential_energy, loads, moving, self._states
        )

    def on_constraints(self, expression: Any) -> Any:
        """Return an expression with the rates that the constraints fix in terms of the others."""
        solution = self._solution
        if not solution.rows:
            return readable(expression)
        from .linear import row_echelon

        velocity = [self.system.scene(self.system.velocity[i]) for i in solution.rows]
        rates = [q.diff(self.time) for q in self.coordinates]
        matrix = solution.jacobian.extract(solution.rows, list(range(len(rates))))
        _, pivots = row_echelon(matrix)
        fixed = sp.solve(velocity, [rates[j] for j in pivots], dict=True)
        return readable(sp.sympify(expression).subs(fixed[0])) if fixed else readable(expression)

    # -- display --------------------------------------------------------------------------

    def report(self) -> Report:
        """Return the whole derivation in the order of the text, as text or LaTeX."""
        from .report import Report

        return Report(self)

    def __str__(self) -> str:
        return str(self.report())

    def _repr_markdown_(self) -> str:
        return self.report().markdown()

    def __repr__(self) -> str:
        names = ", ".join(str(q.func) for q in self.coordinates)
        rates = ", ".join(rate_name(str(q.func)) for q in self.coordinates)
        return f"<LagrangeView {self.scene.name!r}: {names}; {rates}>"
