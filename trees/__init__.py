"""The behaviour tree of the rover. py_trees lives only here."""
