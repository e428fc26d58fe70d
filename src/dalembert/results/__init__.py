"""Results of runs and sweeps."""
