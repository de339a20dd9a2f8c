"""Registers py_trees without its `__init__`, which imports the modules for drawing and demos.

Those import pydot and pyparsing: 2 MB aboard. Imported before all modules that import py_trees; a
py_trees that is imported already stays as it is. For other programs in the
process each of its modules is imported at the first use of its name.
"""

import sys
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from types import ModuleType


def _submodule(name: str) -> ModuleType:
    if name.startswith("_") or find_spec(f"py_trees.{name}") is None:
        raise AttributeError(f"module 'py_trees' has no attribute {name!r}")
    return import_module(f"py_trees.{name}")


if "py_trees" not in sys.modules and (found := find_spec("py_trees")) is not None:
    sys.modules["py_trees"] = module = module_from_spec(found)
    vars(module)["__getattr__"] = _submodule
