"""Steps of integrators: acceptance and size, projection, Runge-Kutta and Radau steps, records of single runs.

The way in is `problem`: what every integrator takes, and the solution that it returns. It imports `stops` and
what stands above.
"""
