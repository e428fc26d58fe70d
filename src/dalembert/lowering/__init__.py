"""Lowering of reduced systems to programs."""
