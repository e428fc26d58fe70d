"""Contact laws between reaction components of joints: Coulomb friction and unilateral constraints."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, final

from ...frozen import frozen

if TYPE_CHECKING:
    pass


@final
@frozen
class CoulombFriction:
    r"""Coulomb's law of dry friction between two reaction components of a joint, as a set-valued law.

    While the contact slips, the friction force opposes the slip velocity and has the size mu times that of the normal
    reaction; while it sticks, the slip velocity is zero and the friction force is whatever holds it, up to mu_static
    times the normal reaction (equation (4) of example 13.4.2).

    Parameters
    ----------
    normal : Unknown or Expr or number
        Normal reaction, an unknown of a joint [N]; or a given load, such as the preload of a bearing or the force of a
        clamp, of which the size counts. It may depend on the state and on time. The law needs a name then, and
        ``"name.normal"`` is an output. Impacts transmit no friction from a given load.
    tangential : Unknown or (Unknown, Unknown)
        Friction force along one direction, or along two that are perpendicular to each other [N].
    slip : Expr or (Expr, Expr), optional
        Slip velocity of the body along the same directions, affine in the rates [m/s]: the one whose product with
        `tangential` is the power of friction. By default, the body slips on something that rests; a moving belt is
        ``x.diff() - v_b``.
    mu : Expr or number, or function
        Coefficient of friction, not negative; or a function that returns it from the slip speed, such as the Stribeck
        curve ``lambda v: mu_k + (mu_s - mu_k) * sympy.exp(-((v / v_s) ** 2))``.
    mu_static : Expr or number, optional
        Coefficient that holds while the contact sticks; by default, mu, a function of the slip speed at zero. A contact
        that slides into an impact is held by mu.
    regularization : Expr or number, optional
        Slip speed eps [m/s] of the smooth law F = -mu N slip / sqrt(slip^2 + eps^2), which never quite sticks. With it
        the model is an ordinary one on every backend, and has derivatives.
    name : str, optional
        What results call it; by default, the name of `normal`. Where a `UnilateralContact` of another name has that
        normal reaction, it is a further law of the contact, as of rolling beside sliding: `tangential` is a moment, and
        `mu` its lever arm [m].

    Examples
    --------
    A block, whose point P slides on a floor with the normal N.z::

        X, Z = da.unknowns("X Z")
        scene.add_joints(da.Joint("floor", body="block", at=P, force=X * N.x + Z * N.z))
        scene.add_friction(da.CoulombFriction(normal=Z, tangential=X, mu=0.3))

    A bearing, of which T is the moment about its axis and T_0 the most that friction there can hold::

        T = da.unknowns("T")
        scene.add_joints(da.Joint("bearing", body="rotor", at=G, torque=T * N.z))
        scene.add_friction(da.CoulombFriction(normal=T_0, tangential=T, mu=1, name="bearing"))
    """

    normal: Any = None
    tangential: Any = None
    slip: Any = None
    mu: Any = None
    mu_static: Any = None
    regularization: Any = None
    name: str | None = None

    @property
    def label(self) -> str:
        """Name in results."""
        own = "without a normal reaction" if self.normal is None else str(self.normal)
        return own if self.name is None else self.name


@final
@frozen
class UnilateralContact:
    """A unilateral constraint: gap >= 0, normal reaction >= 0, and one of them is zero.

    Parameters
    ----------
    normal : Unknown
        Normal reaction, an unknown of a joint [N]; it is positive where it pushes.
    gap : Expr
        In coordinates and time, positive where the contact is open, with the sign of the distance. Where it is plus or
        minus a holonomic constraint of the scene, that constraint is the one that opens; otherwise it need not be
        added as one.
    restitution : Expr or number
        Newton's coefficient, or Poisson's with ``compile_model(..., impacts="poisson")``, between 0 (default: the
        contact stays closed after an impact) and 1. After infinitely many
        impacts within a finite time the contact stays closed, and the run continues.
    name : str, optional
        What results call it; by default, the name of `normal`. A `CoulombFriction` with that normal belongs to it.

    Examples
    --------
    A ball, whose lowest point P at the height z may touch a floor::

        Z = da.unknowns("Z")
        scene.add_joints(da.Joint("floor", body="ball", at=P, force=Z * N.z))
        scene.add_contacts(da.UnilateralContact(normal=Z, gap=z, restitution=0.8))
    """

    normal: Any
    gap: Any
    restitution: Any = 0
    name: str | None = None

    @property
    def label(self) -> str:
        """Name in results."""
        return str(self.normal) if self.name is None else self.name


FRICTION_LAWS: dict[type, Callable[[Any], CoulombFriction]] = {CoulombFriction: lambda law: law}
"""Laws of friction by their classes, each with the Coulomb law that it stands for; mu may depend on the state."""


def coulomb_law(law: Any) -> CoulombFriction | None:
    """Return the Coulomb law that a law of friction stands for; None for what is no law."""
    found = FRICTION_LAWS.get(type(law))
    return None if found is None else found(law)
