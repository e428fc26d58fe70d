"""Steps of Taylor's method: recurrences of a right-hand side, their expansion, and where a step ends."""
