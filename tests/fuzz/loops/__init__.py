"""Random closed loops of which some constraints follow from others, against minimal coordinates derived by hand."""
