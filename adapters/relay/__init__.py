"""`rover-relay`, the process aboard between bundles and the MOPS strings of a rover's topics."""
