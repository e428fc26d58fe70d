"""Compiled models and what they need while running."""
