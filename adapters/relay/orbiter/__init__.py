"""`rover-mops`, the process at the orbiter: the MRS to the ground, MOPS over bundles to rovers."""
