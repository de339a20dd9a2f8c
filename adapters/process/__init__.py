"""What the processes that serve have in common."""
