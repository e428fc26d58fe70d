"""Options of scenes from files of robots, and their checks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from ..errors import OptionError
from ..frozen import frozen
from ..values import flag

PARAMETERS = "numbers", "symbols"
"""Forms of masses, inertias and lengths of a file in a scene."""

LOADS = "damping", "friction"
"""Loads of joints that can be chosen by name."""


@final
@frozen
class RobotOptions:
    """Options of `Scene.from_urdf` and `Scene.from_mjcf`.

    Attributes
    ----------
    floating_base : bool
    symbols : bool
        Whether masses, inertias and lengths become symbols.
    damping, friction : bool
        Which loads of joints the scene has.
    limits : bool
        Whether limits of joints become stops.
    actuated : bool or tuple of str
        Joints that get an input, by name; all or none of them.
    gravity : tuple of float or None
        Acceleration [m/s^2]; None takes that of the file, or 9.81 downwards.
    """

    floating_base: bool = False
    symbols: bool = False
    damping: bool = True
    friction: bool = True
    limits: bool = False
    actuated: bool | tuple[str, ...] = False
    gravity: tuple[float, float, float] | None = None

    @classmethod
    def of(
        cls,
        *,
        floating_base: Any,
        parameters: Any,
        joint_loads: Any,
        limits: Any,
        actuated: Any,
        gravity: Any,
    ) -> RobotOptions:
        """Return the options from what a user gave.

        Raises
        ------
        OptionError
            For values that are not allowed.
        """
        if parameters not in PARAMETERS:
            raise OptionError(f'parameters must be "numbers" or "symbols", not {parameters!r}')
        if not isinstance(joint_loads, bool) and joint_loads not in LOADS:
            raise OptionError(f'joint_loads must be True, False, "damping" or "friction", not {joint_loads!r}')
        return cls(
            flag("floating_base", floating_base),
            parameters == "symbols",
            joint_loads in (True, "damping"),
            joint_loads in (True, "friction"),
            flag("limits", limits),
            _actuated(actuated),
            _gravity(gravity),
        )


def _actuated(given: Any) -> bool | tuple[str, ...]:
    if isinstance(given, bool):
        return given
    names = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else None
    if names is None or not all(isinstance(name, str) for name in names):
        raise OptionError(f'actuated must be True, False or names of joints such as ["elbow"], not {given!r}')
    if len(set(names)) < len(names):
        raise OptionError(f"actuated names a joint twice: {', '.join(names)}")
    return names


def _gravity(given: Any) -> tuple[float, float, float] | None:
    if given is None:
        return None
    try:
        values = np.array(given, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise OptionError(f"gravity must be three numbers [m/s^2], such as (0, 0, -9.81), not {given!r}")
    x, y, z = (float(value) for value in values)
    return x, y, z
