"""Constants of the step size control of the explicit Runge-Kutta pairs.

Source: K. Gustafsson, ACM Transactions on Mathematical Software 17 (1991) 533-554; Hairer and Wanner, Solving
Ordinary Differential Equations II, section IV.2, for the exponents.
"""

SAFETY = 0.9
LARGEST_REDUCTION = 0.2
LARGEST_GROWTH = 8.0
REDUCTION_BLIND = 0.1
SMALLEST_PREVIOUS = 1e-4
INTEGRAL = 0.2
PROPORTIONAL = 0.75
SECOND_ERROR_WEIGHT = 0.01
# A remainder of the span below this share of a step is taken along with the step.
STRETCH = 1.0 + 1e-9
# The least absolute tolerance, so that nothing is divided by zero.
SMALLEST_SCALE = 1e-150
# A projection that changes the velocities by more than this share of them, or of 1e-3, corrects no error of a step: it
# takes the motion to another branch of its constraints, where they lose rank.
BRANCH = 0.25
SLOW = 1e-3
