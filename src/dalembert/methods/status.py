"""Statuses of integrations."""

import enum
from collections.abc import Sequence


class Status(enum.IntEnum):
    """Outcome of an integration; the numbers are those the compiled loops return."""

    SUCCESS = 0
    MAX_STEPS = 1
    STEP_TOO_SMALL = 2
    NON_FINITE = 3
    PROJECTION_FAILED = 4
    INITIAL_STATE = 5
    INTERRUPTED = 6
    EVENT = 7
    EVENTS_ACCUMULATE = 8
    EVENT_STATE = 9
    EVENT_NON_FINITE = 10
    SINGULAR_CONFIGURATION = 11
    CONTACT_IMPOSSIBLE = 12
    CONTACT_AMBIGUOUS = 13
    SINGULAR_COORDINATES = 14
    ASSUMPTION = 15
    TIMES_IN_NO_ORDER = 16
    OUTSIDE_TABLE = 17
    DIVERGED = 18
    CONTACT_UNSUPPORTED = 19

    def __str__(self) -> str:
        return self.name

    __format__ = enum.Enum.__format__  # the one of integers prints the number

    @property
    def success(self) -> bool:
        """Whether the run reached the end of its span or a terminal event."""
        return self in (Status.SUCCESS, Status.EVENT)

    @property
    def message(self) -> str:
        """What happened and what to do about it, in one sentence."""
        return _MESSAGES[self]

    def message_for(self, formulations: Sequence[str], methods: str) -> str:
        """Return the message for a run in these formulations by these methods: without advice that it has followed."""
        said = self.message
        projected = "projected" in formulations
        for advice, followed in (
            (_PASSING, projected and "taylor" in methods),
            (_TAYLOR, projected),
            (_IMPLICIT, all(method.strip() in IMPLICIT_METHODS for method in methods.split(","))),
        ):
            if followed:
                said = said.replace(*advice)
        return said


RUNNING = -1
"""The number that compiled loops have in place of a status while a run, or a case, continues."""

SUSPECT = -100.0
"""Mark of the status of a case that checks have to look at: such a case has this number less its status."""

IMPLICIT_METHODS = ("radau", "bdf", "lsoda", "kvaerno5")
"""Integration methods that stiff problems do not slow down."""

_PASSING = 'use formulation="projected" and method="taylor", which pass through most of them, end', "end"
_TAYLOR = _PASSING[0], 'use method="taylor", which passes through most of them, end'
_IMPLICIT = (
    "raise max_steps, loosen rtol and atol, or choose an implicit method if the problem is stiff",
    "raise max_steps, or loosen rtol and atol",
)


_MESSAGES = {
    Status.SUCCESS: "The end of the time span was reached.",
    Status.MAX_STEPS: (
        "The step budget was used up before the end of the time span: raise max_steps, loosen rtol and "
        "atol, or choose an implicit method if the problem is stiff."
    ),
    Status.STEP_TOO_SMALL: (
        "The step size fell to the spacing of floating-point numbers: the solution probably has a "
        "singularity there; end the time span before it, or loosen rtol and atol if they are near "
        "machine precision."
    ),
    Status.NON_FINITE: (
        "The right-hand side returned NaN or infinity however small the step was: check the initial state "
        "and the parameters for a division by zero or a value outside a function's domain."
    ),
    Status.PROJECTION_FAILED: (
        "The state could not be projected back onto the constraints: the constraint Jacobian has probably "
        "lost rank (a singular configuration), or a contact closes where its gap is not zero; check the constraints "
        "there, or tighten rtol and atol."
    ),
    Status.INITIAL_STATE: (
        "The initial state contradicts a constraint, or cannot be formed there; simulate this case alone to see "
        "which constraint, or leave out values that the constraints fix."
    ),
    Status.CONTACT_IMPOSSIBLE: (
        "No normal reactions satisfy the laws of contact and friction here (Painleve's paradox: a body would have to "
        "jam or be struck at once): lower the coefficient of friction, describe the contact by a load of a spring and "
        "a damper, or start elsewhere."
    ),
    Status.CONTACT_AMBIGUOUS: (
        "Several motions satisfy the laws of contact and friction here (Painleve's paradox: a contact may stay closed "
        "or open; or, backwards in time, several pasts lead to a change of contacts): lower the coefficient of "
        "friction, start elsewhere, or run forwards in time."
    ),
    Status.CONTACT_UNSUPPORTED: (
        "The contacts came into a mode, of those that stick, slide or are open, whose equations are not supported, or "
        "a closed contact to a kink of its gap, where velocities would have to jump, as of a disc that comes to lie "
        "flat: simulate this case alone, which says why and what to change."
    ),
    Status.SINGULAR_CONFIGURATION: (
        "The run met a configuration at which the constraints lose rank, and the motion beyond it is not determined by "
        'them alone: use formulation="projected" and method="taylor", which pass through most of them, end the time '
        "span before it, or choose coordinates that are regular there."
    ),
    Status.SINGULAR_COORDINATES: (
        "The run met an attitude at which the angles that orient a body are singular (gimbal lock): two of them turn "
        'it about the same line there. Compile with orientation="quaternion" where the angles only orient the body, '
        "declare the attitude with dalembert.free_orientation, or choose other angles."
    ),
    Status.ASSUMPTION: (
        "A value of this case contradicts what its symbol was declared to be, such as -1 with positive=True, and SymPy "
        "has simplified the scene with that: simulate this case alone to see which, or declare the symbol without "
        "it (real=True) and compile anew."
    ),
    Status.TIMES_IN_NO_ORDER: (
        "The times of the run, or the knots of its samples, are not finite or not monotone: give finite times in "
        "increasing or in decreasing order, and knots in increasing order."
    ),
    Status.OUTSIDE_TABLE: (
        "The argument of a table, or the time of a run with samples, left their knots, outside of which there are no "
        'values: give more knots, or extrapolate="hold" or "linear".'
    ),
    Status.DIVERGED: (
        "The motion of a loop with sampled controllers diverged: the state grew without bound until steps failed. The "
        "loop is unstable at these gains and periods: lower the gains, shorten the period, or look at the eigenvalues "
        "of model.linearize about an equilibrium."
    ),
    Status.INTERRUPTED: "The run was interrupted before this case had ended; run the cases that remain again.",
    Status.EVENT: "A terminal event ended the run.",
    Status.EVENTS_ACCUMULATE: (
        "Events with apply follow each other ever faster, infinitely many within a finite time, or phases of contacts "
        "follow each other too fast to be separated; the run ends where they accumulate: continue from there with a "
        "model of the rest, make the event terminal, describe bounces by a UnilateralContact with restitution in place "
        "of an event, or lower the restitution of contacts between which a body bounces."
    ),
    Status.EVENT_STATE: (
        "The state that an event maps to contradicts a constraint, penetrates a contact or is not finite: let apply "
        "map every coordinate and rate that jumps, in accordance with the constraints and contacts."
    ),
    Status.EVENT_NON_FINITE: (
        "The expression of an event or reduction, or a gap or reaction of a contact, is NaN or infinite during the "
        "run: make expressions finite along the whole motion, or end the run before with a terminal event. Reactions "
        "grow beyond all bounds where friction jams a body (Painleve's paradox): lower the coefficient of friction "
        "there."
    ),
}
