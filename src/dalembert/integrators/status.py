"""How an integration ended."""

import enum


class Status(enum.IntEnum):
    """Outcome of an integration; the numbers are those the compiled loops return."""

    SUCCESS = 0
    MAX_STEPS = 1
    STEP_TOO_SMALL = 2
    NON_FINITE = 3
    PROJECTION_FAILED = 4
    INITIAL_STATE = 5
    INTERRUPTED = 6
    SINGULAR_CONFIGURATION = 11

    @property
    def message(self) -> str:
        """What happened and what to do about it, in one sentence."""
        return _MESSAGES[self]


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
        "lost rank (a singular configuration); check the constraints there, or tighten rtol and atol."
    ),
    Status.INITIAL_STATE: (
        "The initial state contradicts a constraint, or cannot be formed there; simulate this case alone to be told "
        "which constraint, or leave out values that the constraints fix."
    ),
    Status.SINGULAR_CONFIGURATION: (
        "The run met a configuration at which the constraints lose rank, and the motion beyond it is not determined by "
        'them alone: use formulation="projected", which passes through most of them, end the time span before it, or '
        "choose coordinates that are regular there."
    ),
    Status.INTERRUPTED: "The sweep was interrupted before this case was run; run the cases that remain again.",
}
