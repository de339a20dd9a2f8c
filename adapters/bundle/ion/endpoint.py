"""An endpoint of the ION node on this machine; everything of pyion, and what it needs to be told.

Read in pyion 4.1 and measured with ION 4.1.3: it changes the working directory around each call
and, in some versions, holds a lock of the whole process, or of the endpoint, while it waits for a
bundle, so that nothing could be sent meanwhile. ION itself allows to send while receiving.
"""

import os
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final

from adapters.bundle.eid import Ipn
from adapters.bundle.ion.frames import Received

_NODE_LIST: Final = "ION_NODE_LIST_DIR"
_BP_VERSION: Final = "PYION_BP_VERSION"


class IonFault(Exception):  # noqa: N818 - the word of the house
    """ION cannot be used.

    Attributes:
        lasting: whether that would be the same the next time.
    """

    def __init__(self, text: str, *, lasting: bool = False) -> None:
        """Say why."""
        super().__init__(text)
        self.lasting = lasting


class IonEndpoint:
    """One endpoint, open to send by one thread and to receive by another.

    Args:
        own: which one.

    Raises:
        IonFault: pyion is missing or too old, ION does not run, or has no such endpoint.
    """

    def __init__(self, own: Ipn) -> None:
        """Attach to ION and open the endpoint."""
        os.environ.setdefault(_BP_VERSION, "BPv7")
        try:
            import pyion
            import pyion.utils
        except (ImportError, ValueError) as error:
            raise IonFault(
                f"{sys.executable} cannot import pyion: {error}. Build the pyion of your ION for"
                " it, or name the interpreter that has it: ion: {python: PATH}",
                lasting=True,
            ) from error
        pyion.utils.ion_dir_lock = nullcontext()
        self._proxy: Any = pyion.get_bp_proxy(own.node)
        _go_to(own.node)
        self._proxy.node_dir = None
        try:
            self._proxy.bp_attach()
            self._endpoint: Any = self._proxy.bp_open(str(own), mem_ctrl=True, return_headers=True)
        except TypeError as error:
            raise IonFault(
                f"this pyion does not say from whom a bundle is: {error}", lasting=True
            ) from error
        except (OSError, SystemError, RuntimeError) as error:
            raise IonFault(str(error)) from error
        self._endpoint._lock = nullcontext()

    def receive(self) -> Received:
        """Wait for a bundle, for ever; ION forgets it with this call.

        Raises:
            IonFault: it was interrupted, ION has ended, or somebody else has the endpoint open.
        """
        try:
            payload, headers = self._endpoint.bp_receive()
        except (OSError, RuntimeError, MemoryError) as error:
            raise IonFault(
                f"nothing can be received: {error}; ION has ended, or another process has the"
                " endpoint open"
            ) from error
        return Received(
            headers["bundleSourceEid"],
            headers["bundleCreationTimeMsec"],
            headers["bundleCreationTimeCount"],
            payload,
        )

    def send(self, destination: str, lifetime_s: int, payload: bytes) -> None:
        """Hand a payload to ION; waits for as long as ION has no room.

        Raises:
            IonFault: ION does not take it.
        """
        try:
            self._endpoint.bp_send(destination, payload, TTL=lifetime_s)
        except (OSError, RuntimeError, MemoryError, ValueError) as error:
            raise IonFault(f"ION: {error}") from error

    def interrupt(self) -> None:
        """Have `receive` end, if it waits."""
        self._proxy.bp_interrupt_all()

    def close(self) -> None:
        """Close the endpoint and detach."""
        self._proxy.bp_close_all()
        self._proxy.bp_detach()


def _go_to(node: int) -> None:
    """Be where ION looks for which of the nodes on a machine is meant."""
    if (folder := os.environ.get(_NODE_LIST)) is None:
        return
    try:
        os.chdir(Path(folder) / str(node))
    except OSError as error:
        raise IonFault(f"{_NODE_LIST}: {error}") from error
