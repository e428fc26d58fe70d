"""Passes on graphs and kernels: derivatives, linear algebra, Taylor and Runge-Kutta steps as kernels."""
