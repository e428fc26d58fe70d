"""Kinematics and virtual power on the graph."""
