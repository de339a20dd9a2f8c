"""What the rover knows: facts, status, parameters, telemetry, files and pictures."""
