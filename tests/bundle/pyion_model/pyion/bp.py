"""pyion's endpoint: each call on a thread of its own, one call at a time."""

import base64
import os
import threading
from typing import Any

from pyion import model, utils


class Endpoint:
    def __init__(
        self, proxy: Any, eid: str, handle: int, ttl: int, mem_ctrl: bool, return_headers: bool
    ) -> None:
        self.proxy, self.eid, self.handle = proxy, eid, handle
        self.node_dir = proxy.node_dir
        self.ttl, self.mem_ctrl, self.return_headers = ttl, mem_ctrl, return_headers
        self._lock: Any = threading.Lock()
        self.tx_result: BaseException | None = None
        self.rx_result: Any = None

    def bp_send(
        self,
        dest_eid: str,
        data: bytes,
        TTL: int | None = None,  # noqa: N803
        priority: int | None = None,
    ) -> None:
        with utils.ion_folder(self.node_dir), self._lock:
            self.tx_result = None
            sending = threading.Thread(target=self._send, args=(dest_eid, data, TTL), daemon=True)
            sending.start()
            sending.join()
            if self.tx_result is not None:
                raise self.tx_result

    def bp_receive(self, timeout: float | None = None) -> Any:
        with self._lock:
            self.rx_result = None
            receiving = threading.Thread(target=self._receive, daemon=True)
            receiving.start()
            receiving.join(timeout)
            if isinstance(self.rx_result, BaseException):
                raise self.rx_result
            return self.rx_result

    def _send(self, dest_eid: str, data: bytes, ttl: int | None) -> None:
        answer = model.request(
            op="send",
            node=self.proxy.node_nbr,
            handle=self.handle,
            source=self.eid,
            to=dest_eid,
            ttl=self.ttl if ttl is None else ttl,
            data=base64.b64encode(data).decode(),
            waits=self.mem_ctrl,
        )
        match answer.get("error"):
            case None:
                return
            case "full":
                self.tx_result = MemoryError("ZCO object creation failed.")
            case _:
                self.tx_result = RuntimeError("Error while sending the bundle (err code=-1).")

    def _receive(self) -> None:
        with utils.ion_folder(self.node_dir):
            answer = model.request(
                op="receive", node=self.proxy.node_nbr, handle=self.handle, pid=os.getpid()
            )
            match answer.get("error"):
                case None:
                    headers = {
                        "timeToLive": 3600,
                        "bundleSourceEid": answer["source"],
                        "metadata": b"",
                        "metadataType": b"\0",
                        "bundleCreationTimeCount": answer["count"],
                        "bundleCreationTimeMsec": answer["msec"],
                    }
                    payload = base64.b64decode(answer["data"])
                    self.rx_result = (payload, headers) if self.return_headers else payload
                case "interrupted":
                    self.rx_result = ConnectionError("ION Connection Interrupted")
                case _:
                    self.rx_result = OSError("ION IO Error")
