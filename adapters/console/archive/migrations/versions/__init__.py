"""A module for each change of the tables, after the one that its `down_revision` names.

An archive names the last one that it has seen. A migration that was released is not changed.
"""
