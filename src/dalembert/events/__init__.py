"""Events and reductions: the search within a step, rules that decide which count, and records of what occurred.

The ways in are `event_code`, events with their kernels, and `event_search`. It imports `lanes` and what stands above.
"""
