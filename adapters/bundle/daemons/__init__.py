"""NASA ION as daemon: a bridge process attached through pyion, and the client that talks to it."""
