"""Constants of step size control, projection and events, the same for every loop, generated step and backend.

Source: K. Gustafsson, ACM Transactions on Mathematical Software 17 (1991) 533-554; Hairer and Wanner, Solving
Ordinary Differential Equations II, section IV.2, for the exponents.
"""

from __future__ import annotations

EPSILON = 2.220446049250313e-16
"""Spacing of doubles at 1."""

SMALLEST_NORMAL = 1e-300
"""Stands for zero where a positive number is required: a divisor, or the argument of a logarithm."""

SMALLEST_OF_TIME = 16.0 * EPSILON
"""Share of the time below which a step does not advance it reliably."""

SMALLEST_OF_REST = 1e-30
"""Share of the time that is left, below which a step is too small at time 0."""

STRETCH = 1.0 + 1e-9
"""A step that reaches this close to the end is stretched to end there."""

SMALLEST_SCALE = 1e-150
"""Least absolute tolerance, so that nothing is divided by zero."""

SAFETY = 0.9
"""Safety factor on the step size that the error estimate allows."""

LARGEST_REDUCTION = 0.2
"""Least factor from one step size to the next where the error is known."""

LARGEST_GROWTH = 8.0
"""Largest factor from one step size to the next."""

REDUCTION_BLIND = 0.1
"""Factor for another attempt after a failure that says nothing of a better size: NaN, or a failed projection."""

SMALLEST_PREVIOUS = 1e-4
"""Least error norm that the controller remembers of a step."""

INTEGRAL = 0.2
"""Exponent of the previous error, in units of 1/(order of the error estimate + 1)."""

PROPORTIONAL = 0.75
"""Share of the exponent of the previous error that is taken from the exponent of the error."""

SECOND_ERROR_WEIGHT = 0.01
"""Weight of the second error estimate beside the first, in pairs that have two (DOP853)."""

POLYNOMIAL_ERROR = 10.0
"""Difference of the polynomial of a step and a stage between its ends, over the tolerances, above which the step is
rejected where it is read there. Where stability limits the steps, polynomials may be off by far more than ends."""

FIRST_NEGLIGIBLE = 1e-5
"""Norm of the state or of its slope, over the tolerances, below which they say nothing of the first step."""

FIRST_BLIND = 1e-6
"""Size of the trial step where they say nothing."""

FIRST_SHARE = 0.01
"""Share of the state, over the tolerances, that the trial step may change, and the error aimed at by the first step."""

FIRST_GROWTH = 100.0
"""Largest factor from the trial step to the first step."""

FIRST_SLOPE = 1e-15
"""Slope and curvature, over the tolerances, that count as none."""

BRANCH, ADMITTED_ENERGY = 0.25, 100.0
"""Where a projection changes the velocities by more than the share `BRANCH` of them, or takes more kinetic energy than
`ADMITTED_ENERGY` times what the tolerances are of it, it corrects no error of a step: it takes the motion to another
branch of its constraints, where they lose rank."""

ANY_START = 1.0
"""Stands for rtol in projections of runs whose start may be off the constraints, as that of traced runs: their first
step corrects it, and `BRANCH` alone limits that."""

SMALL_COMPONENT = 1e-3
"""Share of the largest component below which corrections of a component are measured by that share."""

MOST_CORRECTIONS, LINEAR_CORRECTIONS = 10, 2
"""Largest numbers of corrections of positions, which are Newton steps, and of velocities, which are linear."""

QUADRATIC_CHANGE = 1e-8
"""Relative change below which a correction is the last: the next one would change nothing."""

LINEAR_CHANGE = 1e-4
"""Relative change that the last correction allowed may still make."""

FIRST_BLOCK, LARGEST_BLOCK = 64, 8192
"""Steps of the first block of a recorded run, and at most; each block may hold twice as many as the one before."""


# Constants of event location, the same for compiled loops and for NumPy.

RESOLUTION = 64 * EPSILON
"""Share of the time below which two events are simultaneous."""

TOGETHER = 2 * RESOLUTION
"""Share of the time within which events happen together: more than what counts as zero when the motion continues."""

TIME_NOISE = 4.0 * EPSILON
"""Share of the time by which rounding may move an event, and the least length of a piece of a step."""

RESIDUAL = 4.0
"""Multiple of the residual of an expression at its zero, below which it counts as zero when the motion continues."""

SOON, SOON_IN_A_ROW = 1e-9, 4
"""Share of the span below which a jump follows the one before it too soon, and how often that may happen in a row."""

SHORT_SPAN = 1e-3
"""Share of the span that stands for the time, where that is near 0, in judging whether two jumps are distinguished."""

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

ROOT_TRIES, ROOT_PRECISION = 200, 4e-16
"""Largest number of evaluations for one zero, and the relative precision to which it is located."""
