"""A simulated rover as processes: started and ended, found, listened to."""
