"""Traces of random plans on BehaviorTree.CPP 4.10: how they are recorded, stored and read.

See README.md.
"""
