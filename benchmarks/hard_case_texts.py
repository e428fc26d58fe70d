"""The words of docs/hard_cases.md and docs/hard_cases_details.md; `hard_case_pages` fills in the figures."""

__all__ = ["DETAILS", "PAGE"]

PAGE = """# Hard cases

Look here for a motion like yours, and see which error to expect. The {count} cases pass singular angles, amplify small
errors, lock, stick, or strike. Each is compared with a closed form, or with an integration in 20 to 80 digits, and is a
test in `tests/hard_cases`.

## Beside other solvers

![Error against time of ten published benchmarks](published_errors.png)

Each point is a tolerance from 1e-4 to 1e-14. SciPy, SUNDIALS (CVODES) and diffrax integrate the right-hand side that
dalembert derives for the same scene, compiled for each of them. They do not keep the constraints, and end far from the
motion where it passes singular positions (the two windows). Points that another one of the same solver beats in both
error and time are left out. Times are the least of five calls on a shared machine
(`python benchmarks/published_peers.py`).

## Every case

An error is the largest of all observed quantities, relative to max(1, size). "Worst" is over the formulations
`minimal` and `projected` and all their methods: {settings}. "Best" is the run with the smallest error. See also [each
method](hard_cases_details.md).

| case | worst error | best |
| --- | --- | --- |
{cases}

![Error of every case against the time of its run](hard_cases_errors.png)

![Six of the motions](hard_cases_motions.png)

## Friction and contacts

Coulomb's law as a set-valued law ([friction.md](friction.md)), by `method="taylor"` at rtol 1e-14. "Transitions" is the
largest error of the times at which phases begin, relative to max(1, time).

| case | phases | transitions | error |
| --- | ---: | ---: | ---: |
{contacts}

The work of friction on the plate pushed and pulled agrees with the energy lost to {checks[energy]} of itself.
Painleve's paradox of the sliding rod, at mu = 4/3 by theory, is found to {checks[critical]}.

Measured on {machine}, by `python benchmarks/report_hard_cases.py` in some ten minutes.
"""

DETAILS = """# Hard cases in detail

Compare methods on the [hard cases](hard_cases.md). [hard_cases.json](../benchmarks/results/hard_cases.json) has the
rest: every run in every formulation with its error, time and change of first integrals; the source of each reference,
and the quantities and times that are compared; all rows of the tables below.

## Errors

An error is the larger of those in the formulations `minimal` and `projected`, at the tightest tolerance of the method.
A run that fails has its status instead.

| case | {methods} |
| --- |{rule}|
{cases}

Where the coordinates of a rolling sphere are singular (theta = 0), every run ends with `SINGULAR_COORDINATES`. Use
`compile_model(scene, orientation="quaternion")`, whose motion has no singularity.

Where the loops of the four-bar lose rank, no run continues on another branch and reports success. `projected`
passes when a step leads over the singular position; every other run ends with `SINGULAR_CONFIGURATION` or a related
status.

## The smooth friction law

F = -mu N slip / sqrt(slip^2 + eps^2) on the plate pushed and pulled, and its error in theta against the set-valued law.
The smooth law creeps where the set-valued law sticks. With the set-valued law, the plate that sticks for 1e4 s under a
push of 4 N or of 4 + 2 sin(t) N moves by {checks[stuck]}.

{smooth}

## Whipple bicycle

The nine accelerations of the full model at the state of Basu-Mandal et al. (Proc. R. Soc. A 463 (2007) 1983, table 1)
differ from 20-digit values by {checks[bicycle_accelerations]}. The 44 eigenvalues at 0 to 10 m/s (Meijaard et al., the
same volume, table 2), by `model.linearize`, differ by {checks[bicycle_eigenvalues]}.

## Long runs

Use `simulate` for long runs, at the tightest tolerance. Here are Taylor steps at rtol 1e-16, with changes of the
energy, relative to its size or to the largest kinetic energy, of other first integrals, relative to max(1, size), and
residuals of the constraints of positions. All end with {ends}.

{long}

![Drift of the energy](hard_cases_drift.png)

The error grows like the square root of the number of steps, as independent roundings do, or like time where a sum stays
just below 1. Single Taylor runs sum time and state with compensation; sweeps, prepared runs and Runge-Kutta steps do
not: over 1e4 time units the energy of the double pendulum in angles is off by 4e-14 in a single run and by 3e-12 in a
sweep. `projected` keeps the constraints to rounding; `augmented` drifts.

RATTLE and a leapfrog of d'Alembert bound the change of the energy for any length of time, but at an error of their
order and step. Taylor steps at a tight tolerance bound it at the level of rounding, with fewer evaluations and a phase
that is three decades better, so the library has no symmetric methods.

## Stiff methods

The compiled `radau` (numba) beside SciPy's BDF and Radau IIA and RODAS (Rosenbrock, order 4), on the same equations at
rtol 1e-8. RODAS is not in the library; the numpy backend offers BDF. "J" counts Jacobians.

{stiff}

## Projection onto first integrals

`project_invariants=True` ([simulate.md](simulate.md)) corrects the state after every step along the gradients of
the first integrals. It helps at loose tolerances and with one degree of freedom, where an error of the energy is an
error of the period. With more degrees of freedom it gains a factor of three at most (top) or nothing (double pendulum,
chaotic). A tighter tolerance gains more, often with no further steps. Figures are without / with:

{kept}
"""
