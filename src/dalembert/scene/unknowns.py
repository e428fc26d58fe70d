"""Unknown reaction components."""

from __future__ import annotations

from typing import Any

from sympy import Symbol, symbols

from ..errors import OptionError, nesting_named

__all__ = ["Unknown", "unknowns"]


class Unknown(Symbol):  # type: ignore[misc]
    """A component of a reaction that the equations of motion are to determine."""

    __slots__ = ()


@nesting_named
def unknowns(names: str) -> Any:
    """Return reaction components to be solved for, as ``sympy.symbols`` returns symbols.

    Parameters
    ----------
    names : str
        Names separated by spaces or commas.

    Returns
    -------
    Unknown or tuple of Unknown
        One symbol for one name, a tuple for several.

    Raises
    ------
    OptionError
        For an argument that is no text with names.

    Examples
    --------
    ::

        X, Y = da.unknowns("X Y")
    """
    given: Any = names
    if not isinstance(given, str) or not given.strip(" ,"):
        raise OptionError(f"unknowns takes names as one text, such as 'X Y', not {names!r}")
    try:
        return symbols(names, cls=Unknown, real=True)
    except (ValueError, TypeError, UnicodeError) as error:
        raise OptionError(f"unknowns takes names as one text, such as 'X Y', not {names!r}: {error}") from None
