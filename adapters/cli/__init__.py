"""The command-line tool `rover`, and those of its sub-commands that no other package has."""
