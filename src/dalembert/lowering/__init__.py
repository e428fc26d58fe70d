"""Reduced systems to programs."""
