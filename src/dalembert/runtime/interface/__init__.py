"""Public methods of models as functions: signatures, docstrings, and frozen options made of the arguments.

`dalembert.runtime.base.Model` and `dalembert.runtime.model.CompiledModel` bind them by name; `self` is a model.
"""
