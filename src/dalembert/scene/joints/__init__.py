"""Joints of a scene: unknown reactions, and what holds bodies together, drives them or limits them."""
