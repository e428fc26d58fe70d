"""Constants of event location, the same for compiled loops and for NumPy."""

from __future__ import annotations

from .step_constants import EPSILON

RESOLUTION = 64 * EPSILON
"""Share of the time below which two events are simultaneous."""

TOGETHER = 2 * RESOLUTION
"""Share of the time within which events happen together: more than what counts as zero when the motion goes on."""

TIME_NOISE = 4.0 * EPSILON
"""Share of the time by which rounding may move an event, and the least length of a piece of a step."""

RESIDUAL = 4.0
"""Multiple of what is left of an expression at its zero, below which it counts as zero when the motion goes on."""

SOON, SOON_IN_A_ROW = 1e-9, 4
"""Share of the span below which a jump follows the one before it too soon, and how often that may happen in a row."""

SHORT_SPAN = 1e-3
"""Share of the span that stands for the time, where that is near 0, in judging whether two jumps are told apart."""

FLAT, BENT = 1e-12, 1e-9
"""Slope, and bend or dip to the other side, as shares of the values, up to which a function leaves zero as if it had
none."""

STEEP = 1e-3
"""Slope, as a share of the values, from which on neither bends nor errors of polynomials make functions dip at zero."""

SHORT_SHARE = 1e-4
"""Share of a step over which differences of rates give the second derivative of an expression where it begins."""

DOUBT, RESOLVED = 2.0, 0.01
"""Multiple of the error of a polynomial's second derivative up to which it may have made a value near its beginning;
and the share of that error up to which the last coefficients may be, for the error to be known."""

LIKELY = 4.0
"""Multiple of the error of a polynomial's second derivative where a step begins, up to which it may be elsewhere."""

DEEPEST = 44
"""Halvings of a step after which a piece is taken as it is: two zeros closer than that are none."""

BUDGET, DEEP, COARSE = 512, 20, 10
"""Limits of the search in one step of one case: the largest number of deep pieces; the halvings from which a piece is
deep; the halvings of a step once the number is used up.

Smooth functions need few deep pieces, however often they oscillate; jumps and double zeros one or two for each halving;
a function of which nothing but rounding is left needs all that there are, 2**44."""

MOST = 1 << 17
"""Largest number of pieces where the pieces of all steps are cut together, besides some for each step."""

ROOT_TRIES, ROOT_PRECISION = 200, 4e-16
"""Largest number of evaluations for one zero, and the relative precision to which it is located."""
