"""Motions in phases: friction that sticks and slips, contacts that open and close."""

from .model import HybridModel

__all__ = ["HybridModel"]
