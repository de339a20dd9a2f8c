"""Wrong messages by the million against a living provider of the MRS."""
