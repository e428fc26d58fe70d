"""Cases side by side in lanes: their arguments, loading, steps, stops and records.

The way in is `sweep_arguments`: what the loop over lanes is given. It imports `steps` and what stands above.
"""
