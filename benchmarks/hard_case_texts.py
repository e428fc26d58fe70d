"""The words of docs/hard_cases.md and docs/hard_cases_details.md; `hard_case_pages` fills in the figures."""

__all__ = ["DETAILS", "PAGE"]

PAGE = """# Hard cases

These {count} motions pass singular angles, amplify small errors, lock, stick, or strike. You see how far each is from
reference values of closed forms, or of integrations with 20 to 80 digits. Each is a test in `tests/hard_cases`.

![Error of every case against the time of its run](hard_cases_errors.png)

An error is the largest of all observed quantities, relative to max(1, size). "Worst" is over the formulations
`minimal` and `projected` and all their methods: {settings}. "Best" is the run with the smallest error, and its time is
that of one call of `simulate` after compilation. [All runs, and the sources of the
references](hard_cases_details.md).

| case | worst error | best | its error | ms |
| --- | --- | --- | ---: | ---: |
{cases}

![Six of the motions](hard_cases_motions.png)

## Beside other solvers

![Error against time of ten published benchmarks](published_errors.png)

Ten published benchmarks by `simulate`, and by SciPy, SUNDIALS (CVODES) and diffrax on the right-hand side that
dalembert derives for the same scene, compiled for each of them. A point is a tolerance from 1e-4 to 1e-14; points that
another one of the same solver beats in both error and time are left out. The other solvers do not keep the
constraints, and end far from the motion where it passes singular positions (the two windows). Times are the least of
five calls on a shared machine (`python benchmarks/published_peers.py`).

## Friction and contacts

Coulomb's law as a set-valued law ([friction.md](friction.md)), by `method="taylor"` at rtol 1e-14. "Transitions" is the
largest error of the times at which phases begin, relative to max(1, time).

| case | phases | transitions | error |
| --- | ---: | ---: | ---: |
{contacts}

Friction's work on the plate pushed and pulled agrees with the energy lost to {checks[energy]} of itself. Painleve's
paradox of the sliding rod, at mu = 4/3 by theory, is found to {checks[critical]}.

Measured on {machine}, by `python benchmarks/report_hard_cases.py` in some ten minutes.
"""

DETAILS = """# Hard cases in detail

The figures behind [hard_cases.md](hard_cases.md), of the same run ({machine}). `benchmarks/results/hard_cases.json`
also has the time and the change of the first integrals of every run.

## References

| case | compared | at t | source of the reference |
| --- | --- | --- | --- |
{references}

## Errors

Each cell has the largest error of a run; a run that fails has its status instead. Scenes without constraints are
the same in all formulations.

| case | formulation | {methods} |
| --- | --- |{rule}|
{figures}

Scenes that a formulation does not support, with the reason that `compile_model` gives:

{refused}

A rolling sphere whose angles pass theta = 0 ends with `SINGULAR_COORDINATES` by every method, and the message names
the angle and the remedy: `compile_model(scene, orientation="quaternion")`. With a quaternion the same motion has no
singularity.

Where the loops of the four-bar lose rank, no run continues on another branch and reports success. `projected`
passes when a step leads over the singular position; every other run ends with `SINGULAR_CONFIGURATION` or a related
status.

## The smooth friction law

F = -mu N slip / sqrt(slip^2 + eps^2) on the plate pushed and pulled: its error in theta against the set-valued law.
The smooth law creeps
where the set-valued law sticks. With the set-valued law, the plate that sticks for 1e4 s under a push of 4 N or of
4 + 2 sin(t) N moves by
{checks[stuck]}.

{smooth}

## Whipple bicycle

The nine accelerations of the full model (9 coordinates, 6 constraints) at the state of Basu-Mandal et al. (Proc. R.
Soc. A 463 (2007) 1983, table 1) differ from 20-digit values by {checks[bicycle_accelerations]}. The 44 eigenvalues
at 0 to 10 m/s (Meijaard et al., the same volume, table 2), by `model.linearize`, differ by
{checks[bicycle_eigenvalues]}.

## Long runs

Taylor steps at rtol 1e-16. The columns are changes: of the energy, relative to its size or to the largest kinetic
energy; of other first integrals, relative to max(1, size); and the residuals of the constraints in the units of the
scene.

{long}

![Drift of the energy](hard_cases_drift.png)

Use `simulate` for long runs at the tightest tolerance. Single Taylor runs sum time and state with compensation; sweeps,
prepared runs and Runge-Kutta steps do not: over 1e4 time units the energy of the double pendulum in angles is off by
4e-14 in a single run and by 3e-12 in a sweep. The error grows like the square root of the number of steps, as
independent roundings do, or like time where a sum stays just below 1. `projected` keeps the constraints to rounding;
`augmented` drifts.

## Stiff methods

The compiled `radau` beside SciPy's BDF and Radau IIA and RODAS (Rosenbrock, order 4), on the same equations. BDF
needs about as many evaluations as Radau IIA where the stiff modes are damped (governor), and three times as many
where they oscillate (spring). RODAS is level at an error of 1e-5, and needs three times the evaluations at tight
errors. Neither is a method of the library, but the numpy backend offers BDF. "J" counts Jacobians.

{stiff}

## Symmetric and variational methods

RATTLE and a leapfrog of d'Alembert are not part of the library. They bound the change of the energy for any length of
time, but at an error of their order and step. Taylor steps at a tight tolerance bound it at the level of rounding, with
fewer evaluations and a phase that is three decades better.

{symmetric}

The pendulum runs for 100 s, the particle for 1000 s.

## Projection onto first integrals

`project_invariants=True` ([simulate.md](simulate.md)) corrects the state after every step along the gradients of
the first integrals. Figures are without / with. It helps at loose tolerances and with one degree of freedom, where
an error of the energy is an error of the period: one to two decades for the pendulum and the slider-crank. With
more degrees of freedom it gains a factor of three at most (top) or nothing (double pendulum, chaotic). At 1e-06
`taylor` takes twice as many steps of the top without it, and errs less. A tighter tolerance gains more, often with no
further steps. Ratios of time vary by up to a factor of two.

{kept}
"""
