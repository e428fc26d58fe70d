"""Systems of other packages as scenes."""
