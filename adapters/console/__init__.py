"""The process `rover-console`: operators monitor and command rovers in a browser."""

from typing import Final

PORT: Final = 21080
"""TCP port of the console, below the ephemeral ports of Linux (32768 to 60999)."""
PORT_VARIABLE: Final = "ROVER_CONSOLE_PORT"
"""Environment variable that overrides the port."""
