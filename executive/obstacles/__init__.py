"""What a motion keeps away from: zones and what the laser has seen, and the ways around them."""
