"""Motions in phases: friction that sticks and slips, contacts that open and close."""
