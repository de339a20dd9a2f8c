"""Questions to the node of the test, each over a connection of its own."""

import json
import os
import socket
from typing import Any


def request(**question: Any) -> dict[str, Any]:
    """Ask, and wait for as long as the answer takes."""
    question["folder"] = os.getcwd()
    with socket.socket(socket.AF_UNIX) as connection:
        try:
            connection.connect(os.environ["MODEL_ION"])
        except OSError:
            return {"error": "no ION"}
        with connection.makefile("rw") as lines:
            lines.write(json.dumps(question) + "\n")
            lines.flush()
            answer: dict[str, Any] = json.loads(lines.readline() or '{"error": "no ION"}')
            return answer
