"""Stops of runs, known before they begin: samples and knots of inputs, conditions on time, instants of controllers.

The way in is `stops`: the table that compiled loops pass in place. It imports `ir`, `methods` and `subset`.
"""
