"""`CompiledModel`, and its public methods as functions: signatures, docstrings, and frozen options.

`dalembert.model.model.CompiledModel` binds the methods by name; `self` is a model. Where contacts change what a method
computes, it decides so once, and imports what it needs.
"""
