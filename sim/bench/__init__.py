"""What the rover executive costs and reaches, measured against a comparison in the same run."""
