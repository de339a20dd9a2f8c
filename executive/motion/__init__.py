"""How motion goals become commands of the actuators."""
