"""The values that the whole core and its adapters pass around, and its ports."""
