"""The loops: over lanes (`lane_loop`), of one prepared or recorded run (`prepared_loop`), and those that XLA calls.

It imports `events`, `lanes`, `steps` and `stops`.
"""
