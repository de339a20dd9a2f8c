"""An agent whose bundles another agent on the machine carries: NASA ION, or a uD3TN daemon."""
