"""Optimal control with CasADi and IPOPT: a cart moves a hanging pole upright with the least effort."""

import casadi as ca
import numpy as np
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x, theta, push = dynamicsymbols("x theta push")
M, m, l, g = symbols("M m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
C = O.locatenew("C", x * N.x)
P = C.locatenew("P", l * sin(theta) * N.x - l * cos(theta) * N.y)
scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, theta])
scene.add_bodies(Particle("cart", C, M), Particle("bob", P, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_inputs(push)
scene.add_loads((C, push * N.x))
model = da.compile_model(scene)
rates = model.to_casadi()["rhs"]

numbers = {"M": 1.0, "m": 0.3, "l": 0.5, "g": 9.81}
p = [numbers[name] for name in model.layout.parameters if name in numbers]
count, end = 60, 2.0
h = end / count

problem = ca.Opti()
y, u = problem.variable(4, count + 1), problem.variable(1, count + 1)
for k in range(count):  # Hermite-Simpson collocation
    a, b = rates(0, y[:, k], p, u[k]), rates(0, y[:, k + 1], p, u[k + 1])
    middle = (y[:, k] + y[:, k + 1]) / 2 + h / 8 * (a - b)
    between = rates(0, middle, p, (u[k] + u[k + 1]) / 2)
    problem.subject_to(y[:, k + 1] == y[:, k] + h / 6 * (a + 4 * between + b))
problem.subject_to(y[:, 0] == [0, 0, 0, 0])
problem.subject_to(y[:, count] == [1, np.pi, 0, 0])
problem.subject_to(problem.bounded(-20, u, 20))
problem.minimize(h * ca.sumsqr(u))
problem.set_initial(y[1, :], np.linspace(0, np.pi, count + 1))
problem.set_initial(y[0, :], np.linspace(0, 1, count + 1))
problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
found = problem.solve()

times, effort = np.linspace(0, end, count + 1), found.value(u)
inputs = {push: da.samples(times, effort, kind="linear")}
run = model.simulate((0, end), {x: 0, theta: 0, x.diff(): 0, theta.diff(): 0}, numbers, inputs=inputs, rtol=1e-10)
print(f"effort: {found.value(problem.f):.1f} N^2 s")
print(f"simulate ends at x = {run['x'][-1]:.3f} m, theta = {run['theta'][-1] / np.pi:.3f} pi")
