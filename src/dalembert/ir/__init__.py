"""The expression graph, the programs lowered from it, and what is done to them."""
