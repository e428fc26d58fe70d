"""Import of systems of other packages as scenes."""
