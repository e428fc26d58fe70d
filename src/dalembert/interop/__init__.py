"""Import of systems of other packages, and of files of robots, as scenes."""
