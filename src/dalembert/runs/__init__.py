"""Runs of one model: `simulate`, `sweep`, `prepare`, the checks that end them, and their stops.

It imports `starts` and what stands above; runs with contacts are in `phases`, which these functions call.
"""
