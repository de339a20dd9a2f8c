"""An emulated LEGO NXT brick: MOCUP's firmware, and its end of the USB cable."""
