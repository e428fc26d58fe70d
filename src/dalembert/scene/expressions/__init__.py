"""SymPy expressions of a scene: their reading onto the graph, functions and tables in them, and tests of identities."""
