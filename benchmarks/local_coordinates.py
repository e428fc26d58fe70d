"""Local coordinates against projection: DOP853 with equal steps, on closed loops without a closed form.

In local coordinates of a tangent space each stage lies on the constraints: q is what the coordinates of the chart
say, and the rest follows by Newton's method (Hairer, Lubich and Wanner, Geometric Numerical Integration, section
IV.5.3). A projected step puts its end on them. Series of Taylor steps are the same for both.

    python benchmarks/local_coordinates.py
"""

import numpy as np
from exact import ROOT  # noqa: F401 - puts tests/ on the path
from scipy.integrate._ivp import dop853_coefficients as tableau

from dalembert.ir.interpret import interpret, interpret_rows
from hard_cases import hard_case

STAGES = len(tableau.B)
CASES = {
    "slider-crank": (1.0, (40, 80, 160, 320)),
    "four-bar": (0.5, (5, 10, 20, 40)),
    "Andrews' squeezing mechanism": (0.01, (25, 50, 100, 200)),
}


class Stepper:
    """Equal steps of a projected model, with stages on the constraints or only the ends of steps."""

    def __init__(self, case):
        self.case, self.model = case, case.compile("projected")
        program = self.model.stages.program
        self.kernels = [program.kernel(name) for name in ("rhs", "project_position", "project_velocity")]
        given = {str(name): float(value) for name, value in case.parameters.items()}
        parameters = [given[name] for name in self.model.layout.parameters]
        self.constants = np.array(interpret(program.kernel("prepare"), {"p": parameters}))

    def value(self, number, t, y):
        """Return the rates, or a correction of positions or velocities."""
        return interpret_rows(self.kernels[number], np.array([t]), y[np.newaxis], self.constants)[0]

    def projected(self, t, y):
        """Return a state on the constraints."""
        for number in (1, 1, 1, 2):
            y = y + self.value(number, t, y)
        return y

    def end(self, end, steps, stages):
        """Return the state after so many steps."""
        start = self.model.simulate((0, end), self.case.initial, self.case.parameters, t_eval=[0.0])
        y, h = np.concatenate([start.q[0], start.qdot[0]]), end / steps
        for i in range(steps):
            slopes = np.zeros((STAGES, len(y)))
            for s in range(STAGES):
                t, at = h * (i + tableau.C[s]), y + h * (tableau.A[s, :s] @ slopes[:s])
                slopes[s] = self.value(0, t, self.projected(t, at) if stages and s else at)
            y = self.projected(h * (i + 1), y + h * (tableau.B @ slopes))
        return y


def main():
    """Print the largest relative errors at the ends."""
    for name, (end, numbers) in CASES.items():
        stepper = Stepper(hard_case(name))
        exact = stepper.end(end, 4 * numbers[-1], stages=False)
        for label, stages in (("projected ends of steps", False), ("stages in local coordinates", True)):
            found = [stepper.end(end, steps, stages) for steps in numbers]
            errors = [np.max(np.abs(y - exact) / np.maximum(1.0, np.abs(exact))) for y in found]
            cells = ", ".join(f"{steps}: {error:.0e}" for steps, error in zip(numbers, errors, strict=True))
            print(f"{name}, {label}: errors by steps {cells}")


if __name__ == "__main__":
    main()
