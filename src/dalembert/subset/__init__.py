"""The language of compiled loops: Python in a small typed subset, and the arguments that loops are given.

`compiled_subset` has the language, `arguments` the types at the boundary between Python and machine code, `packing` the
words that cross it. It imports basic modules alone; `dalembert.codegen.subset` translates it.
"""
