"""A model of pyion 4.1 for processes that have no ION, with its habits.

What ION would do the node of the test does (`tests/bundle/ion_node.py`), over a socket.
"""

import ctypes
import os
import signal
from typing import Any

from pyion import model, utils
from pyion.bp import Endpoint

ION_NODE_LIST_DIR: str | None = None

if os.environ.get("PYION_BP_VERSION", "").lower() not in ("bpv6", "bpv7"):
    raise ValueError("Environment variable PYION_BP_VERSION is missing. Set it to BPv6 or BPv7")

_before = signal.getsignal(signal.SIGINT)


def _shut_down(number: int, frame: Any) -> None:
    """What pyion does to whoever imports it."""
    print("[pyion] KeyboardInterruption... ")
    for proxy in _proxies.values():
        proxy.bp_close_all()
    if callable(_before):
        _before(number, frame)


signal.signal(signal.SIGINT, _shut_down)

_proxies: dict[int, "BpProxy"] = {}


def get_bp_proxy(node_nbr: int) -> "BpProxy":
    return _proxies.setdefault(node_nbr, BpProxy(node_nbr))


class BpProxy:
    """A node of ION as pyion shows it."""

    def __init__(self, node_nbr: int) -> None:
        folder = os.environ.get("ION_NODE_LIST_DIR")
        self.node_nbr = node_nbr
        self.node_dir = os.path.join(folder, str(node_nbr)) if folder else None
        self.attached = False
        self._open: dict[str, Endpoint] = {}

    def bp_attach(self) -> None:
        with utils.ion_folder(self.node_dir):
            answer = model.request(op="attach", node=self.node_nbr)
            if "error" in answer:
                raise SystemError("Cannot attach to BP engine. Is ION running on this host?")
            ctypes.CDLL(None).shmat(answer["memory"], None, 0)
            self.attached = True

    def bp_detach(self) -> None:
        with utils.ion_folder(self.node_dir):
            self.attached = False

    def bp_open(
        self,
        eid: str,
        TTL: int = 3600,  # noqa: N803
        timeout: float | None = None,
        mem_ctrl: bool = False,
        return_headers: bool = False,
    ) -> Endpoint:
        with utils.ion_folder(self.node_dir):
            if not self.attached:
                raise OSError("Not attached to ION, call ``attach`` first.")
            if eid in self._open:
                return self._open[eid]
            opened = model.request(op="open", node=self.node_nbr, eid=eid, pid=os.getpid())
            if "error" in opened:
                raise ConnectionError(
                    f"Cannot open endpoint '{eid}'. Is it defined in .bprc? Is it already in use?"
                )
            self._open[eid] = Endpoint(self, eid, opened["handle"], TTL, mem_ctrl, return_headers)
            return self._open[eid]

    def bp_interrupt(self, endpoint: Endpoint) -> None:
        with utils.ion_folder(self.node_dir):
            model.request(op="interrupt", node=self.node_nbr, handle=endpoint.handle)

    def bp_interrupt_all(self) -> None:
        for endpoint in list(self._open.values()):
            self.bp_interrupt(endpoint)

    def bp_close(self, endpoint: Endpoint) -> None:
        with utils.ion_folder(self.node_dir):
            self.bp_interrupt(endpoint)
            del self._open[endpoint.eid]
            model.request(op="close", node=self.node_nbr, handle=endpoint.handle)

    def bp_close_all(self) -> None:
        for endpoint in list(self._open.values()):
            self.bp_close(endpoint)
