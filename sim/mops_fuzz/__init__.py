"""Wrong MOPS strings by the million against all who read them."""
