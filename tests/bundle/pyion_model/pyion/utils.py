"""pyion's working directory, and the lock of the whole process around it."""

import os
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

ion_dir_lock: AbstractContextManager[Any] = threading.Lock()


@contextmanager
def ion_folder(node_dir: str | None) -> Iterator[None]:
    """Be in the folder of a node; nobody else may be in any meanwhile."""
    with ion_dir_lock:
        if node_dir is None:
            yield
            return
        before = os.getcwd()
        os.chdir(node_dir)
        try:
            yield
        finally:
            os.chdir(before)
