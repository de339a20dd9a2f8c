"""The client of a uD3TN daemon, by its Application Agent Protocol 2.0."""
