"""The operations console: what operators see of rovers in a browser, and command them by."""

from typing import Final

PORT: Final = 21080
"""TCP port of the console, below the ports that Linux hands out by itself (32768 to 60999)."""
PORT_VARIABLE: Final = "ROVER_CONSOLE_PORT"
"""The variable of the environment that names another."""
