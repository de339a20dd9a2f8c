"""Bundle Protocol version 7 (RFC 9171): an agent with a durable store; knows nothing of rovers."""
