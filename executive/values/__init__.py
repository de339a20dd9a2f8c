"""Values that the core and its adapters exchange, and the core's ports."""
