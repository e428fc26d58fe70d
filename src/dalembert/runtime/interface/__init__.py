"""Public methods of models as functions: signatures, docstrings, and frozen options made of the arguments.

`dalembert.runtime.model.CompiledModel` binds them by name; `self` is a model. Where contacts change what a method
computes, it decides so once, and imports what it needs.
"""
