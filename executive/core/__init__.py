"""The executive: commands in, goals for the tree, reports out."""
