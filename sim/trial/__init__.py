"""`rover plan try`: executes a plan many times in lock step, and reports its outcomes.

Input are a plan, a scenario as its environment, and the varied quantities of a campaign; output is
a `TrialReport`. `python -m sim.trial` is the same for other processes, with JSON on both pipes.
"""
