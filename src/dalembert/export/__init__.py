"""Simulators that leave the process: what of a model is exported, and the folder that it is written to.

Their way in is `dalembert.model.exports.export`. They import what makes runs and code, and nothing of models.
"""
