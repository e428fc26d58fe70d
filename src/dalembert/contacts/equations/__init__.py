"""Equations of scenes with contacts: laws, the rows that modes add, and what they solve for, on the graph."""
