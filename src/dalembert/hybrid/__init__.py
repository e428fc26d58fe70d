"""Scenes with contacts as hybrid automata: modes, guards, transitions."""

from .automaton import HybridAutomaton
from .modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode

__all__ = ["CLOSED", "OPEN", "SLIP", "SMOOTH", "STICK", "HybridAutomaton", "Mode"]
