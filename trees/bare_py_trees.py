"""Registers py_trees without its `__init__`, which imports the modules for drawing and demos.

Those import pydot and pyparsing: 2 MB aboard. Imported before all modules that import py_trees; a
py_trees that is imported already stays as it is. Its modules are imported by their full names.
"""

import sys
from importlib.util import find_spec, module_from_spec

if "py_trees" not in sys.modules and (found := find_spec("py_trees")) is not None:
    sys.modules["py_trees"] = module_from_spec(found)
