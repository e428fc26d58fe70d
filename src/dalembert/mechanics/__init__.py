"""Derivation of the equations of motion on the expression graph."""
