"""An emulated LEGO NXT brick, and the USB cable on which rover-nxt finds it."""
