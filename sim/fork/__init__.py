"""`rover whatif`: forks of a recording, which continue it in simulation under a change.

A fork replays the core up to a moment, puts a simulated rover where the recorded one was, and
continues both in lock step. `Forkable` makes forks; `model` has their input and their result.
"""
