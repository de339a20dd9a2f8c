"""NASA ION as carrier of bundles: a bridge process attached through pyion, and its client."""
