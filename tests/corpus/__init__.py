"""Recorded motions that a redesign must keep: ``make corpus`` compares a tree with them."""
